"""The space in which a clip's person moves: up direction, floor, and extent. No viser here.

Level space has the camera at its origin and the camera's heading, but is upright: x right, y along gravity, z ahead,
metres. A moving camera is there in the clip's first frame.
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera

if TYPE_CHECKING:
    from fitting_core.ground.level import Level

_STRAY = 2.0
"""Percentage of frames that need not be in view."""
_FLOOR_PERCENTILE = 95.0
"""Percentile over frames of the lowest vertex's height: a foot sometimes fitted below the floor is no floor."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Room:
    """The space of a clip according to one fit."""

    turn: Float[np.ndarray, "3 3"]
    """x_level = turn @ x_camera + place; for a moving camera, x_still instead of x_camera (see `CameraPath`)."""
    floor: float
    """y of the floor in level space."""
    boxes: Float[np.ndarray, "T 2 3"]
    """Least and greatest coordinates of the body in some frames, at least one, in level space."""
    level: bool = True
    """Whether gravity is known; otherwise the room has the camera's orientation."""
    place: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Camera position in level space."""

    def before(self, camera: Camera, frame: int) -> "Room":
        """The same room relative to the camera of a frame."""
        if camera.path is None:
            return self
        return replace(self, turn=self.turn @ camera.path.to_still[frame], place=self.turn @ camera.path.places[frame])

    @property
    def extent(self) -> Float[np.ndarray, "2 3"]:
        """The extent of the body over the whole clip, in level space."""
        return extent(self.boxes)


UNKNOWN = Room(turn=np.eye(3), floor=1.0, boxes=np.array([[(-1.0, -1.0, 2.0), (1.0, 1.0, 4.0)]]))
"""While the side view is empty."""


def room_around(vertices: Float[np.ndarray, "T V 3"], level: "Level | None") -> Room:
    """The room of a body.

    Args:
        vertices: Of some frames, in still space, metres.
        level: The camera's tilt and the floor; None if unknown.
    """
    turn = np.eye(3) if level is None else level.turn
    found = boxes(vertices @ turn.T.astype(vertices.dtype))
    usual = found[np.isfinite(found).all((1, 2))]
    usual = usual if len(usual) else np.zeros((1, 2, 3))
    known = None if level is None else level.height
    floor = float(np.percentile(usual[:, 1, 1], _FLOOR_PERCENTILE)) if known is None else known
    return Room(turn=turn, floor=floor, boxes=usual, level=level is not None)


def boxes(vertices: Float[np.ndarray, "T V 3"]) -> Float[np.ndarray, "T 2 3"]:
    """Least and greatest coordinates of each frame's vertices."""
    return np.stack([vertices.min(1), vertices.max(1)], 1).astype(float)


def extent(vertices: Float[np.ndarray, "T V 3"]) -> Float[np.ndarray, "2 3"]:
    """Least and greatest coordinates over frames, except for the few in which a fit puts the body far away."""
    least, most = vertices.min(1), vertices.max(1)
    usual = np.isfinite(least + most).all(1)
    least, most = least[usual], most[usual]
    if not len(least):
        return np.zeros((2, 3))
    return np.stack([np.percentile(least, _STRAY, axis=0), np.percentile(most, 100 - _STRAY, axis=0)])
