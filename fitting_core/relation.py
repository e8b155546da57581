"""How the camera and the clock of one view relate to those of another."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Matrix, Vector


@dataclass(frozen=True, kw_only=True)
class Relation:
    """Pose and clock of another view relative to the first: x_other = rotation x_first + translation."""

    rotation: Matrix
    """By rows."""
    translation: Vector
    """In metres if the person is as tall as the average adult; proportional to the height."""
    offset: float
    """Seconds: what is at a time in the first clip is at this much later a time in the other, each counted from its
    first frame."""
    rotation_deviation: float
    """Standard deviation, degrees."""
    direction_deviation: float
    """Standard deviation of the direction from camera to camera, degrees."""
    offset_deviation: float
    """Standard deviation, seconds."""
    disagreement: float
    """Median angle by which viewing rays of the same keypoint miss each other, radians."""
    overlap: float
    """Seconds that both show."""
    vertical_off: float
    """Degrees between what both views say is up."""

    @property
    def angle(self) -> float:
        """Between the directions of both cameras, degrees."""
        return float(np.degrees(np.arccos(np.clip(self.rotation[2][2], -1.0, 1.0))))

    @property
    def turn(self) -> Float[np.ndarray, "3 3"]:
        """`rotation` as an array."""
        return np.array(self.rotation, float)

    @property
    def shift(self) -> Float[np.ndarray, "3"]:
        """`translation` as an array."""
        return np.array(self.translation, float)
