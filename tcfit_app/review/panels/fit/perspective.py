"""What a focal length means in words: lens, field of view, and distance of the person."""

import math
from dataclasses import dataclass

import numpy as np

from fitting_core.camera import FULL_FRAME_DIAGONAL_MM, focal_from_35mm
from fitting_core.keypoints import INDEX, Keypoints

LENSES = {"wide 24": 24.0, "phone 28": 28.0, "35": 35.0, "50": 50.0, "portrait 85": 85.0}
"""Usual lenses by name: 35 mm equivalents."""
_TRUNK, _SHOULDERS = 0.5, 0.37
"""Typical distances in metres: shoulders to hips, and shoulder to shoulder."""
_REACH = 0.6
"""How far a hand reaches forward, metres."""
_SURE = 0.3


@dataclass(frozen=True, kw_only=True)
class Perspective:
    """How a clip was filmed if this is the focal length."""

    focal: float
    """Pixels."""
    size: tuple[int, int]
    """Width and height of the image in pixels."""
    metre: float | None
    """Pixels per metre at the person's distance, median over frames; None if the keypoints do not tell."""

    @property
    def millimetres(self) -> float:
        """The 35 mm equivalent."""
        return self.focal * FULL_FRAME_DIAGONAL_MM / math.hypot(*self.size)

    @property
    def angle(self) -> float:
        """Horizontal field of view, radians."""
        return 2 * math.atan(self.size[0] / 2 / self.focal)

    @property
    def distance(self) -> float | None:
        """Metres from the camera to the person."""
        return None if self.metre is None else self.focal / self.metre

    @property
    def words(self) -> str:
        """Lens, field of view, distance, and how much it enlarges a hand that reaches forward."""
        said = f"{self.millimetres:.0f} mm (35 mm equivalent), {math.degrees(self.angle):.0f}° wide"
        if self.distance is None:
            return said
        said += f"; the person is about {self.distance:.1f} m away"
        if self.distance < 1.5 * _REACH:
            return f"{said}, which is hardly possible"
        larger = self.distance / (self.distance - _REACH) - 1
        return f"{said}. An outstretched hand looks {100 * larger:.0f} % larger"


def metre_in_pixels(keypoints: Keypoints) -> float | None:
    """Pixels per metre at the person's distance, by trunk or shoulders, median over frames; None without any."""

    def lengths(a: str, b: str) -> np.ndarray:
        i, j = INDEX[a], INDEX[b]
        seen = np.minimum(keypoints.confidence[:, i], keypoints.confidence[:, j]) > _SURE
        return np.linalg.norm(keypoints.xy[seen, i] - keypoints.xy[seen, j], axis=-1)

    trunk = np.concatenate([lengths(f"{side}_shoulder", f"{side}_hip") for side in ("left", "right")])
    for found, metres in ((trunk, _TRUNK), (lengths("left_shoulder", "right_shoulder"), _SHOULDERS)):
        if len(found) and (middle := float(np.median(found))) > 1:
            return middle / metres
    return None


def focal_of_lens(name: str, size: tuple[int, int]) -> float:
    """Pixels, of one of LENSES in an image of that size."""
    return focal_from_35mm(LENSES[name], size)
