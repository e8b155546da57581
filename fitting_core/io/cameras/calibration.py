"""One camera of a calibration file, as in the file, checked."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.camera import COEFFICIENTS, is_rotation
from fitting_core.config.choices import Up
from fitting_core.files.regular import refusal
from fitting_core.io.cameras.moving import Poses

OPENCV_FIRST_PIXEL = 0.0
"""OpenCV counts from the middle of the first pixel (`cornerSubPix`, `calibrateCamera`)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """A camera of a file, in the file's units."""

    name: str
    """Empty if the file does not name it."""
    focal: tuple[float, float]
    """Pixels of an image of `size`."""
    center: tuple[float, float]
    """Pixels from the image's corner: the middle of the first pixel is (0.5, 0.5)."""
    distortion: tuple[float, ...]
    """As of `Lens`; empty for none."""
    size: tuple[int, int] | None
    """Width and height of the images that were calibrated; None if the file does not give it."""
    rotation: Float[np.ndarray, "3 3"] | None = None
    """x_camera = rotation x_world + translation; both given, or neither."""
    translation: Float[np.ndarray, "3"] | None = None
    up: Up | None = None
    """Of the world, as the file states or its program's convention has it."""
    has_unit: bool = True
    """Whether lengths of the world have a unit; a reconstruction from images alone has none."""
    poses: Poses | None = None
    """Of a moving camera, in place of rotation and translation."""
    notes: tuple[str, ...] = ()
    """Notes for the user on how it was read."""


def calibration(
    name: str,
    *,
    matrix: Any,
    distortion: Any = None,
    size: Any = None,
    rotation: Any = None,
    translation: Any = None,
    up: Any = None,
    poses: Poses | None = None,
    has_unit: bool = True,
    first_pixel: float = 0.5,
) -> Calibration:
    """A camera from what a file has, in any of the usual shapes. Raises ValueError if it is not a camera, or is one
    that tcfit cannot use; the message says what was found and expected.

    Args:
        name: In the file.
        matrix: 3 x 3: focal lengths and principal point, pixels.
        distortion: 4, 5, 8 or 12 of OpenCV's coefficients, in any shape.
        size: Width and height in pixels.
        rotation: 3 x 3, or OpenCV's rotation vector (axis times angle in radians).
        translation: 3 numbers.
        up: One of `Up`.
        poses: Of a moving camera, checked, in place of rotation and translation.
        has_unit: As of `Calibration`.
        first_pixel: What the file's principal point counts as the middle of the first pixel: OPENCV_FIRST_PIXEL, or 0.5
            in COLMAP and others that count from the image's corner, as tcfit does.
    """
    k = finite_numbers("the camera matrix", matrix, 9).reshape(3, 3)
    if not (min(k[0, 0], k[1, 1]) > 0 and np.allclose(k[2], (0, 0, 1)) and abs(k[1, 0]) < 1e-6):
        raise ValueError(
            f"has the camera matrix {k.tolist()}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], focal lengths above 0"
        )
    if abs(k[0, 1]) > 1e-3 * k[0, 0]:
        raise ValueError(f"has skewed pixels (skew {k[0, 1]:g} in the camera matrix), expected 0")
    if (rotation is None) != (translation is None):
        there, missing = ("translation", "rotation") if rotation is None else ("rotation", "translation")
        raise ValueError(f"has a {there} but no {missing}; expected both or neither")
    if up is not None and up not in get_args(Up):
        raise ValueError(f"says that up is {up!r}; expected one of {', '.join(get_args(Up))}")
    pose = None if rotation is None else pose_of(rotation, translation)
    return Calibration(
        name=name,
        focal=(float(k[0, 0]), float(k[1, 1])),
        center=(float(k[0, 2]) + 0.5 - first_pixel, float(k[1, 2]) + 0.5 - first_pixel),
        distortion=_coefficients(distortion),
        size=None if size is None else _size(size),
        rotation=None if pose is None else pose[0],
        translation=None if pose is None else pose[1],
        up=up,
        has_unit=has_unit,
        poses=poses,
    )


def pose_of(rotation: Any, translation: Any) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Rotation and translation of a camera, checked. Raises ValueError."""
    return _rotation(rotation), finite_numbers("the translation", translation, 3)


def _coefficients(values: Any) -> tuple[float, ...]:
    """Without trailing zeros; empty for a lens without distortion."""
    if values is None:
        return ()
    found = finite_numbers("the distortion", values)
    if not found.any():
        return ()
    if len(found) == 14 and not found[12:].any():
        found = found[:12]
    if len(found) == 14:
        raise ValueError(
            "has 14 distortion coefficients, of a tilted sensor; expected up to 12, of a sensor that is not"
        )
    if len(found) not in COEFFICIENTS:
        expected = f"{', '.join(map(str, COEFFICIENTS[:-1]))} or {COEFFICIENTS[-1]}"
        raise ValueError(
            f"has {len(found)} distortion coefficients; expected {expected} of OpenCV's (k1, k2, p1, p2, k3 ...)"
        )
    return tuple(found.tolist())


def _size(value: Any) -> tuple[int, int]:
    width, height = finite_numbers("the image size", value, 2).tolist()
    if not all(1 <= side < 100_000 and side == int(side) for side in (width, height)):
        raise ValueError(f"has the image size {width:g} x {height:g}; expected width and height in whole pixels")
    return int(width), int(height)


def _rotation(value: Any) -> Float[np.ndarray, "3 3"]:
    numbers = finite_numbers("the rotation", value)
    if len(numbers) == 3:
        return Rotation.from_rotvec(numbers).as_matrix()
    if len(numbers) != 9:
        raise ValueError(
            f"has a rotation of {len(numbers)} numbers; expected a matrix (3 x 3) or a rotation vector (3)"
        )
    matrix = numbers.reshape(3, 3)
    if is_rotation(-matrix):
        raise ValueError("has a rotation that mirrors (determinant -1); expected determinant 1")
    if not is_rotation(matrix):
        raise ValueError("has an invalid rotation (R R^T is not the identity)")
    return matrix


def finite_numbers(what: str, value: Any, count: int | None = None) -> Float[np.ndarray, "n"]:
    """A row of finite numbers of the given length. Raises ValueError that names them `what`."""
    try:
        found = np.asarray(value)
    except ValueError:  # rows of different lengths
        raise ValueError(f"{what} has rows of different lengths") from None
    if found.dtype.kind not in "fiu":
        raise ValueError(f"{what} is not an array of numbers")
    found = found.astype(float).ravel()
    if count is not None and len(found) != count:
        raise ValueError(f"{what} has {len(found)} numbers, expected {count}")
    if not np.isfinite(found).all() or (abs(found) > 1e9).any():
        raise ValueError(f"{what} has numbers that are not finite or far too large")
    return found


_MAX_BYTES = 256 * 2**20
"""COLMAP's list of images includes their points: some 100 kB per image."""


def text_of(path: Path, *, most: int = _MAX_BYTES) -> str:
    """The file's text.

    Args:
        path: The file.
        most: Largest size in bytes.

    Raises:
        ValueError: It is not a file, is too large, or is not text.
        OSError: It does not exist, or cannot be read.
    """
    if why := refusal(path, most=most):
        raise ValueError(why)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("is not UTF-8 text") from None
