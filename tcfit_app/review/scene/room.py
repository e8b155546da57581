"""Where a clip's person moves: which way is up, where the floor is, and where the body goes. No viser here.

Level space has the camera in its origin and looks where the camera looks, but is upright: x right, y along gravity,
z ahead, metres. A camera that moves is there in the clip's first frame.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera
from fitting_core.ground.level import Level

_STRAY = 2.0
"""Percent of the frames that need not be in view."""
_FLOOR_PERCENTILE = 95.0
"""Of the lowest vertex's height over the frames: a foot that the fit pushes through the floor now and then is none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Room:
    """The space of a clip, as one fit has it."""

    turn: Float[np.ndarray, "3 3"]
    """x_level = turn @ x_camera + place; of a camera that moves, from still space (see `CameraPath`)."""
    floor: float
    """y of the floor in level space."""
    boxes: Float[np.ndarray, "T 2 3"]
    """Least and greatest coordinates of the body in some frames, in level space. One at least."""
    level: bool = True
    """Whether gravity is known; else the room is held as the camera is."""
    place: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Of the camera, in level space."""

    def before(self, camera: Camera, frame: int) -> "Room":
        """The same room as the camera of a frame is in it."""
        if camera.path is None:
            return self
        return replace(self, turn=self.turn @ camera.path.to_still[frame], place=self.turn @ camera.path.places[frame])

    @property
    def extent(self) -> Float[np.ndarray, "2 3"]:
        """Where the body is in the whole clip, in level space."""
        return extent(self.boxes)


def room_around(vertices: Float[np.ndarray, "T V 3"], level: Level | None) -> Room:
    """The room of a body.

    Args:
        vertices: Of some of its frames, in still space, metres.
        level: How the camera is held; None where that is not known.
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
    """Least and greatest coordinates of a body's frames, but for the few in which a fit throws it far away."""
    least, most = vertices.min(1), vertices.max(1)
    usual = np.isfinite(least + most).all(1)
    least, most = least[usual], most[usual]
    if not len(least):
        return np.zeros((2, 3))
    return np.stack([np.percentile(least, _STRAY, axis=0), np.percentile(most, 100 - _STRAY, axis=0)])
