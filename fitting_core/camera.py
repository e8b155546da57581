"""The pinhole camera: intrinsics, where they come from, and projection."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from jaxtyping import Float

if TYPE_CHECKING:  # Reading a clip needs a camera and must not load torch.
    from torch import Tensor

FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)
DEFAULT_FOCAL = "not known: assumed to be the image diagonal, a 43 mm equivalent (diagonal field of view 53 degrees)"
"""`Camera.source` of a guess."""
FocalRule = Literal["auto", "diagonal"]
"""What stands in for a focal length that nobody gave: what the images tell, or else an estimate from the clip; or the
image's diagonal."""
ESTIMATED = "estimated from the clip"
"""How `Camera.source` begins where the focal length was estimated from what the person does."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Pinhole camera without distortion. Camera space: x right, y down, z away from the camera, metres.

    The camera has no rotation: the body's global orientation is relative to the camera.
    """

    focal: tuple[float, float]
    """Focal length in pixels, along x and y."""
    center: tuple[float, float]
    """Principal point in pixels."""
    size: tuple[int, int]
    """Image width and height in pixels."""
    source: str = "given"
    """Where the focal length comes from, in words for the user."""

    @property
    def calibrated(self) -> bool:
        """Whether the focal length is known. Estimates are not: half of them are off by a factor of 1.4 or more."""
        return self.source != DEFAULT_FOCAL and not self.source.startswith(ESTIMATED)


def focal_from_fov(degrees: float, width: int) -> float:
    """Focal length in pixels from the horizontal field of view."""
    return width / 2 / math.tan(math.radians(degrees) / 2)


def focal_from_35mm(millimetres: float, size: tuple[int, int]) -> float:
    """Focal length in pixels from the 35 mm equivalent, by the diagonals of image and full frame (43.27 mm)."""
    return millimetres / FULL_FRAME_DIAGONAL_MM * math.hypot(*size)


def default_focal(size: tuple[int, int]) -> float:
    """The image diagonal in pixels: a 43 mm equivalent, a diagonal field of view of 53 degrees.

    A far better guess for phones and camcorders than SMPLify-X's 5000 px, which puts a person at 11 m instead of 4.
    """
    return math.hypot(*size)


def project(camera: Camera, points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 2"]:
    """Pixels of points in camera space (metres). Points must lie in front of the camera (z > 0)."""
    focal, center = points.new_tensor(camera.focal), points.new_tensor(camera.center)
    return focal * points[..., :2] / points[..., 2:] + center
