"""The 3D mode: bodies in metres, the ground, and the camera that filmed them with its image.

Its world is level space (room.py): bodies are sent in camera space, under a node that turns them upright.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Literal

import numpy as np
import viser
from jaxtyping import Float
from viser.transforms import SO3

from fitting_core.camera import Camera
from tcfit_app.review.scene.layers import MOST_OTHERS, BodyLayer
from tcfit_app.review.scene.nodes import BodyNode, ImageNode, MeshDressing
from tcfit_app.review.scene.poster import PLATE
from tcfit_app.review.scene.room import extent

TurnPhase = Literal["start", "update", "end"]
Quaternion = tuple[float, float, float, float]
"""w, x, y, z."""
_RINGS_SIZE = 0.22
"""Radius of the rings, metres: beyond a hand, and well within an arm's length."""
FRUSTUM_DEPTH = 0.9
"""Metres from the video camera to its image."""
_SLOTS = 2
_ROOT = "/space"
_FILMED = f"{_ROOT}/filmed"
"""The node for what is in camera space."""
_CELLS, _SECTIONS, _FRUSTUM = (
    {True: (62, 66, 74), False: (210, 215, 222)},
    {True: (104, 110, 122), False: (168, 176, 187)},
    {True: (190, 196, 206), False: (96, 104, 116)},
)
"""Colours of the ground's lines and of the video camera, in the dark theme and in the light one."""


@dataclass(frozen=True, kw_only=True)
class Rings:
    """Rings around a joint, by which the user turns it; in camera space."""

    position: tuple[float, float, float]
    """The joint, metres."""
    wxyz: Quaternion
    """How the joint is turned."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Space:
    """What the 3D mode shows."""

    camera: Camera
    """The clip's."""
    bodies: tuple[BodyLayer, ...] = ()
    """At most two, drawn opaque: in 3D transparency would show a body's far side, not the video. The last one is B."""
    ghost: bool = False
    """The first of two bodies is drawn faintly, so that it does not hide the other one in the same place."""
    others: tuple[BodyLayer, ...] = ()
    """Of other people, at most MOST_OTHERS."""
    image: bytes | None = None
    """The frame as a JPEG, drawn in the camera's frustum. None: not ready."""
    turn: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    """From camera space to the upright world: x_world = turn @ x_camera + place."""
    place: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """The camera's position in the world, metres."""
    ground: float | None = None
    """Height of the ground grid: y in the world, downwards, metres. None: no grid."""
    extents: tuple[Float[np.ndarray, "2 3"] | None, ...] = ()
    """The extent of each body over the whole clip in the world (see `extent`), so that the viewer's camera need not
    move. None or empty: not known yet."""
    rings: Rings | None = None
    """Around a joint of the last body."""
    dark: bool = True
    """The theme."""

    def __post_init__(self) -> None:
        assert len(self.bodies) <= _SLOTS and len(self.others) <= MOST_OTHERS
        assert len(self.extents) in (0, len(self.bodies))

    def obstacles(self) -> Float[np.ndarray, "n 3"]:
        """Vertices of the bodies as drawn, but for a ghost, in the world."""
        found = [body.vertices @ self.turn.T + self.place for body in self.bodies[int(self.ghost) :]]
        return np.concatenate([np.zeros((0, 3)), *found])

    def bounds(self) -> Float[np.ndarray, "2 3"] | None:
        """Least and greatest coordinates of the bodies as drawn, over the clip as far as known; None without any."""
        extents = self.extents or (None,) * len(self.bodies)
        corners = [
            extent((body.vertices @ self.turn.T + self.place)[None]) if known is None else known
            for body, known in zip(self.bodies, extents, strict=True)
        ]
        return np.stack([np.min(corners, (0, 1)), np.max(corners, (0, 1))]) if corners else None


class RingsNode:
    """The rings in one browser tab, viser's transform controls. Created when first shown."""

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
                self._name, _RINGS_SIZE, disable_axes=True, disable_sliders=True, depth_test=False
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


class SpaceNodes:
    """The 3D scene in one browser tab."""

    def __init__(self, client: viser.ClientHandle, dressing: MeshDressing) -> None:
        self._client = client
        self._root = client.scene.add_frame(_ROOT, show_axes=False, visible=False)
        self._filmed = client.scene.add_frame(_FILMED, show_axes=False)
        self._bodies = [BodyNode(client, f"{_FILMED}/body{i}", dressing) for i in range(_SLOTS + MOST_OTHERS)]
        self._image = ImageNode(client, f"{_FILMED}/image", dressing, PLATE)
        self.rings = RingsNode(client, f"{_FILMED}/rings")
        self._filmed_by: tuple[Camera, bool] | None = None
        """The camera drawn last, and the theme."""
        self._grid: viser.GridHandle | None = None

    def draw(self, snapshot: Space) -> None:
        """Send what changed."""
        shown = snapshot.bodies
        self._filmed.wxyz = SO3.from_matrix(snapshot.turn).wxyz
        self._filmed.position = snapshot.place
        everybody = (*shown, *[None] * (_SLOTS - len(shown)), *snapshot.others)
        for i, (node, body) in enumerate(zip_longest(self._bodies, everybody)):
            if body:
                node.draw(body, body.vertices, solid=True, ghost=snapshot.ghost and i == 0)
            else:
                node.hide()
        self.rings.draw(snapshot.rings)
        self._draw_camera(snapshot.camera, dark=snapshot.dark)
        corners = frustum(snapshot.camera)
        size, middle = corners[2] - corners[0], (corners[0] + corners[2]) / 2
        self._image.draw(snapshot.image or PLATE, (size[0], size[1]), tuple(middle))
        self._draw_ground(snapshot.ground, dark=snapshot.dark)

    def set_visible(self, visible: bool) -> None:
        """Show or hide all of it."""
        self._root.visible = visible
        if not visible:
            self.rings.draw(None)

    def _draw_camera(self, camera: Camera, *, dark: bool) -> None:
        if (camera, dark) == self._filmed_by:
            return
        self._filmed_by = camera, dark
        corners = frustum(camera)
        edges = [(np.zeros(3), corner) for corner in corners] + list(zip(corners, np.roll(corners, -1, 0), strict=True))
        self._client.scene.add_line_segments(
            f"{_FILMED}/frustum", np.array(edges, np.float32), _FRUSTUM[dark], thickness=1.5, thickness_units="screen"
        )

    def _draw_ground(self, ground: float | None, *, dark: bool) -> None:
        if ground is None:
            if self._grid is not None:
                self._grid.visible = False
            return
        if self._grid is None:
            self._grid = self._client.scene.add_grid(
                f"{_ROOT}/ground",
                width=10,
                height=10,
                plane="xz",
                infinite_grid=True,
                cell_size=0.25,
                cell_thickness=0.6,
                section_size=1.0,
                section_thickness=1.0,
                fade_distance=14.0,
                fade_strength=1.6,
                fade_from="camera",
                shadow_opacity=0.0,
                plane_opacity=0.0,
            )
        self._grid.visible = True
        self._grid.cell_color, self._grid.section_color = _CELLS[dark], _SECTIONS[dark]
        self._grid.position = (0.0, ground, 0.0)


def frustum(camera: Camera) -> Float[np.ndarray, "4 3"]:
    """The image's corners at FRUSTUM_DEPTH (camera space, metres): left top, right top, right bottom, ..."""
    width, height = camera.size
    pixels = np.array([(0, 0), (width, 0), (width, height), (0, height)], float)
    rays = (pixels - np.array(camera.center)) / np.array(camera.focal)
    return np.hstack([rays, np.ones((4, 1))]) * FRUSTUM_DEPTH
