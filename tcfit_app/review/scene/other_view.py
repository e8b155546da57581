"""Another view of the person: the picture's bodies before its camera. No viser."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera
from fitting_core.clip import OtherView


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherCamera:
    """Maps the first camera's space to another one's picture: a poster of its own."""

    camera: Camera
    turn: Float[np.ndarray, "3 3"]
    place: Float[np.ndarray, "3"]
    """x_other = turn x_first + place, metres."""

    @property
    def width(self) -> float:
        """Width of the picture, in its heights."""
        return self.camera.size[0] / self.camera.size[1]

    def seen(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points of the first camera's space in this one's."""
        return points @ self.turn.T + self.place


def other_camera(view: OtherView, scale: float) -> OtherCamera:
    """That of another view, whose translation is scaled (see `view_scale.scale_of`)."""
    relation = view.relation
    assert relation is not None, "views of a project are related to its clip"
    return OtherCamera(camera=view.clip.camera, turn=relation.turn, place=scale * relation.shift)
