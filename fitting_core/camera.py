"""The pinhole camera: intrinsics, where they come from, and projection; its lens, where it stands, how it moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.config.choices import Up

if TYPE_CHECKING:  # Reading a clip needs a camera and must not load torch.
    from torch import Tensor

FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)
DEFAULT_FOCAL = "not known: assumed to be the image diagonal, a 43 mm equivalent (diagonal field of view 53 degrees)"
"""`Camera.source` of the image's diagonal."""


class FocalFrom(StrEnum):
    """Where a focal length comes from."""

    GIVEN = "given"
    """By the user."""
    FILE = "file"
    """A calibration."""
    PHOTOGRAPHS = "photographs"
    """Metadata of the images or the video."""
    ESTIMATED = "estimated"
    """Estimated from the clip, or what is likely of any camera."""
    DIAGONAL = "diagonal"
    """Unknown; the image diagonal is used."""
    PROGRAM = "program"
    """Another program assumed it without saying why: most use one value for all cameras."""


SURE_FOCAL = 0.12
"""Standard deviation of the logarithm of a focal length up to which it counts as known."""
_KNOWN = (FocalFrom.GIVEN, FocalFrom.FILE, FocalFrom.PHOTOGRAPHS)
_IN_OLD_WORDS = {
    "not known: assumed": FocalFrom.DIAGONAL,
    "estimated from the clip": FocalFrom.ESTIMATED,
    "camera file ": FocalFrom.FILE,
    "35 mm equivalent of ": FocalFrom.PHOTOGRAPHS,
}


def focal_from_words(source: str) -> FocalFrom:
    """Where a focal length comes from by `Camera.source`, in files of versions that kept only that."""
    for begins, found in _IN_OLD_WORDS.items():
        if source.startswith(begins):
            return found
    given = source.endswith((", as given", "own camera")) or source in (
        "given",
        "as given",
        "as given when it was imported",
        "set in the review",
    )
    return FocalFrom.GIVEN if given else FocalFrom.PROGRAM


Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
COEFFICIENTS = (4, 5, 8, 12)
"""Numbers of coefficients that OpenCV's distortion has without tilted sensors."""
_ROUNDED = 1e-3
"""Largest difference of R R^T from the identity: files have rounded numbers."""


@dataclass(frozen=True, kw_only=True)
class Lens:
    """The lens through which a clip was filmed. What it bends is straightened where a clip comes in (see lens.py)."""

    focal: tuple[float, float]
    """Of the calibration, pixels along x and y; straightened pictures keep it."""
    center: tuple[float, float]
    """Principal point of the calibration, pixels."""
    distortion: tuple[float, ...]
    """OpenCV's coefficients: k1, k2, p1, p2, then k3, then k4 to k6, then s1 to s4; COEFFICIENTS of them."""


@dataclass(frozen=True, kw_only=True)
class Vertical:
    """The vertical of a camera that stands still, estimated from its pictures."""

    up: Vector
    """Against gravity: a unit vector in camera space."""
    deviation: float
    """Standard deviation of its direction, degrees."""

    def __str__(self) -> str:
        return f"vertical from straight lines in the picture, ± {self.deviation:.1f}°"


@dataclass(frozen=True, kw_only=True)
class World:
    """Where a camera stands in a world of the user's own: x_camera = rotation x_world + translation.

    That is OpenCV's convention. Of a camera that moves: in still space (see `CameraPath`).
    """

    rotation: Matrix
    """By rows."""
    translation: Vector
    """Metres."""
    up: Up | None = None
    """None if unknown."""

    @property
    def from_camera(self) -> Float[np.ndarray, "3 3"]:
        """Rotation of camera space into the world."""
        return np.array(self.rotation, float).T

    @property
    def place(self) -> Float[np.ndarray, 3]:
        """Where the camera stands in the world, metres."""
        return -self.from_camera @ np.array(self.translation, float)

    @property
    def up_in_world(self) -> Float[np.ndarray, 3] | None:
        """Unit vector against gravity in the world's axes."""
        if self.up is None:
            return None
        return np.eye(3)["xyz".index(self.up[-1])] * (-1.0 if self.up.startswith("-") else 1.0)

    @property
    def up_in_camera(self) -> Float[np.ndarray, 3] | None:
        """The same in camera axes."""
        return None if self.up_in_world is None else self.up_in_world @ self.from_camera


@dataclass(frozen=True, kw_only=True)
class CameraPath:
    """How a camera moves through T frames: x_camera = rotation x_still + translation.

    Still space is that of a camera which stands still where this one stood in the first frame that was fitted. In it
    the floor is one plane, and who stands stays where he is; of a camera that does not move it is camera space.
    """

    rotation: tuple[Matrix, ...]
    """Of each frame, by rows."""
    translation: tuple[Vector, ...]
    """Metres."""

    def __len__(self) -> int:
        return len(self.rotation)

    def __getitem__(self, frames: slice | Sequence[int]) -> CameraPath:
        """Of some frames, from the same still space."""
        chosen = range(len(self))[frames] if isinstance(frames, slice) else frames
        return CameraPath(
            rotation=tuple(self.rotation[i] for i in chosen), translation=tuple(self.translation[i] for i in chosen)
        )

    @cached_property
    def to_still(self) -> Float[np.ndarray, "T 3 3"]:
        """Rotations of camera space into still space."""
        return np.array(self.rotation, float).reshape(-1, 3, 3).swapaxes(1, 2)

    @cached_property
    def places(self) -> Float[np.ndarray, "T 3"]:
        """Where the camera is in still space, metres."""
        return -(self.to_still @ np.array(self.translation, float).reshape(-1, 3, 1))[..., 0]


@dataclass(frozen=True, kw_only=True)
class PathScale:
    """How long the unit of a path is, as estimated."""

    metres: float
    """The likeliest."""
    deviation: float
    """Standard deviation of its logarithm: 0.1 is about 10 %."""
    by: str
    """From what, in words for the user."""


def with_focal_from(stored: Any) -> Any:
    """The JSON of a camera with where its focal length comes from, which earlier versions kept in words only."""
    if not isinstance(stored, dict) or "focal_from" in stored:
        return stored
    return {**stored, "focal_from": focal_from_words(str(stored.get("source")))}


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
    focal_from: FocalFrom = FocalFrom.GIVEN
    source: str = "given"
    """The same in words for the user."""
    focal_deviation: float | None = None
    """Standard deviation of the logarithm of an estimated focal length; None for all others."""
    vertical: Vertical | None = None
    """None if the pictures do not tell it."""
    lens: Lens | None = None
    """What bent the pictures as they were filmed; None for nothing. Keypoints and frames of a clip are straightened."""
    world: World | None = None
    """The camera's pose in the user's world; None if unknown."""
    path: CameraPath | None = None
    """Its path, one pose per frame of the clip; None if static."""
    notes: tuple[str, ...] = field(default=(), compare=False)
    """Notes for the user on how it was read; dropped when the clip gets another camera."""

    def __getitem__(self, frames: slice | Sequence[int]) -> Camera:
        """Of some frames."""
        return self if self.path is None else replace(self, path=self.path[frames])

    def resized(self, size: tuple[int, int]) -> Camera:
        """Of the same images, resized to this width and height."""
        x, y = size[0] / self.size[0], size[1] / self.size[1]
        focal, center = self.focal, self.center
        return replace(self, focal=(focal[0] * x, focal[1] * y), center=(center[0] * x, center[1] * y), size=size)

    def to_still(self, points: Float[np.ndarray, "T *n 3"]) -> Float[np.ndarray, "T *n 3"]:
        """Points of camera space, of each frame, in still space (see `CameraPath`), metres."""
        if self.path is None:
            return points
        turned = np.einsum("tij,t...j->t...i", self.path.to_still, points)
        return turned + self.path.places.reshape(-1, *(1,) * (points.ndim - 2), 3)

    def from_still(self, points: Float[np.ndarray, "T *n 3"]) -> Float[np.ndarray, "T *n 3"]:
        """Points of still space in the camera space of each frame, metres."""
        if self.path is None:
            return points
        moved = points - self.path.places.reshape(-1, *(1,) * (points.ndim - 2), 3)
        return np.einsum("tji,t...j->t...i", self.path.to_still, moved)

    def turned_to_still(self, vectors: Float[np.ndarray, "T *n 3"]) -> Float[np.ndarray, "T *n 3"]:
        """Directions of camera space in still space."""
        return vectors if self.path is None else np.einsum("tij,t...j->t...i", self.path.to_still, vectors)

    @property
    def calibrated(self) -> bool:
        """Whether the focal length is known, or estimated to within SURE_FOCAL."""
        return self.focal_from in _KNOWN or (self.focal_deviation is not None and self.focal_deviation < SURE_FOCAL)


def path_of(rotation: Float[np.ndarray, "T 3 3"], translation: Float[np.ndarray, "T 3"]) -> CameraPath:
    """A path from arrays: x_camera = rotation x_still + translation, metres."""
    return CameraPath(rotation=tuple(map(matrix_of, rotation)), translation=tuple(map(vector_of, translation)))


def matrix_of(values: Float[np.ndarray, "3 3"]) -> Matrix:
    """An array's rows."""
    a, b, c = map(vector_of, values)
    return a, b, c


def vector_of(values: Float[np.ndarray, 3]) -> Vector:
    """An array's three numbers."""
    x, y, z = values.tolist()
    return x, y, z


def is_rotation(matrix: Float[np.ndarray, "3 3"]) -> bool:
    """Whether a matrix of finite numbers turns and does nothing else."""
    return bool(are_rotations(matrix))


def are_rotations(matrices: Float[np.ndarray, "*n 3 3"]) -> Bool[np.ndarray, "*n"]:
    """Which matrices of finite numbers turn and do nothing else."""
    off = abs(matrices @ matrices.swapaxes(-1, -2) - np.eye(3)).max((-1, -2))
    return (off <= _ROUNDED) & (np.linalg.det(matrices) > 0)


def is_possible(camera: Camera) -> bool:
    """Whether a camera that was stored can be one."""
    lens, world, path = camera.lens, camera.world, camera.path
    focals, numbers = list(camera.focal), [*camera.focal, *camera.center, *camera.size]
    if lens is not None:
        focals += lens.focal
        numbers += [*lens.focal, *lens.center, *lens.distortion]
    if world is not None:
        numbers += [*np.ravel(world.rotation), *world.translation]
    if camera.vertical is not None:
        numbers += [*camera.vertical.up, camera.vertical.deviation]
    if camera.focal_deviation is not None:
        numbers.append(camera.focal_deviation)
    if path is not None:
        numbers += [*np.ravel(path.rotation), *np.ravel(path.translation)]
    return (
        bool(np.isfinite(numbers).all())
        and min(focals) > 0
        and 0 < min(camera.size) <= max(camera.size) < 1e5
        and (lens is None or len(lens.distortion) in COEFFICIENTS)
        and (world is None or is_rotation(np.array(world.rotation, float)))
        and (camera.vertical is None or abs(math.hypot(*camera.vertical.up) - 1) < _ROUNDED)
        and (path is None or (len(path.translation) == len(path) and bool(are_rotations(path.to_still).all())))
    )


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
