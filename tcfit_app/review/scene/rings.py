"""Rings around a joint in 3D, by which the user turns it: viser's transform controls."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import viser

TurnPhase = Literal["start", "update", "end"]
Quaternion = tuple[float, float, float, float]
"""w, x, y, z."""
_SIZE = 0.22
"""Radius, metres: beyond a hand, and well within an arm's length."""


@dataclass(frozen=True, kw_only=True)
class Rings:
    """Where they are, in camera space."""

    position: tuple[float, float, float]
    """The joint, metres."""
    wxyz: Quaternion
    """How the joint is turned."""


class RingsNode:
    """The rings in one browser tab. Created when first shown."""

    def __init__(self, client: viser.ClientHandle, name: str) -> None:
        self._client, self._name = client, name
        self._node: viser.TransformControlsHandle | None = None
        self._held = False
        self.turned: Callable[[TurnPhase, Quaternion], None] = lambda phase, wxyz: None
        """Called as the user turns them, on viser's thread."""

    def draw(self, rings: Rings | None) -> None:
        """Show or hide them. While they are held, they are where the pointer has turned them."""
        if rings is None:
            if self._node is not None:
                self._node.visible = False
            return
        if self._node is None:
            self._node = self._client.scene.add_transform_controls(
                self._name, _SIZE, disable_axes=True, disable_sliders=True, depth_test=False
            )
            self._node.on_update(self._updated)
        self._node.visible = True
        if not self._held:
            self._node.position, self._node.wxyz = rings.position, rings.wxyz

    async def _updated(self, event: viser.TransformControlsEvent) -> None:
        # A coroutine: viser calls these in order of arrival.
        self._held = event.phase != "end"
        w, x, y, z = (float(value) for value in event.target.wxyz)
        self.turned(event.phase, (w, x, y, z))
