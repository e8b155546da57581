"""tcfit's own format for a calibrated camera: an npz with OpenCV's arrays, x_camera = R x_world + t.

| key | shape | |
|---|---|---|
| K | (3, 3) | focal lengths and principal point, pixels; as in OpenCV, the middle of the first pixel is (0, 0) |
| dist | (n,) | optional: OpenCV's distortion coefficients, 4, 5, 8 or 12 |
| size or image_size | (2,) | optional: width and height of the images that were calibrated |
| R | (3, 3) or (3,) | optional: rotation from the world to the camera, as a matrix or as a rotation vector |
| t | (3,) | with R: translation, metres |
| up | () | optional: the world's axis against gravity: x, y, z, -x, -y or -z |
| names | (N,) | optional: names of N cameras; the arrays above then have N rows, but for up |
| frames | (N,) | optional, of one camera that moves: numbers of the frames that R and t are of |

A moving camera has N rows in R, (N, 3, 3) or (N, 3), and in t, and no names. Without `frames` they are those of all
frames in order.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.errors import some_of
from fitting_core.files.npz import npz_names, read_npz
from fitting_core.files.regular import legible
from fitting_core.io.cameras.calibration import OPENCV_FIRST_PIXEL, Calibration, calibration, pose_of
from fitting_core.io.cameras.moving import Poses

_ROWS = {"K": "matrix", "dist": "distortion", "size": "size", "image_size": "size", "R": "rotation", "t": "translation"}
"""Arrays with a row for each camera, and what `calibration` calls them."""
_KEYS = (*_ROWS, "up", "names", "frames")
_MAX_BYTES = 2**24


def read_camera_npz(path: Path) -> list[Calibration]:
    """All cameras of the file.

    Raises:
        ValueError: It is not such an npz, or has a camera that cannot be used.
        OSError: It cannot be read.
    """
    cameras = _cameras(read_npz(path, _KEYS, most=_MAX_BYTES))
    # A distortion under another name, ignored in silence, would bend every result.
    if other := [name for name in npz_names(path) if name not in _KEYS]:
        note = f"{', '.join(map(legible, other[:5]))}: passed over; expected {', '.join(_KEYS)}."
        return [replace(camera, notes=(note,)) for camera in cameras]
    return cameras


def _cameras(arrays: dict[str, np.ndarray]) -> list[Calibration]:
    if "K" not in arrays:
        raise ValueError(f"has no camera matrix K (it has {some_of(arrays)})")
    up: Any = str(arrays["up"]) if "up" in arrays else None
    given: dict[str, Any] = {what: arrays[key] for key, what in _ROWS.items() if key in arrays}
    if "names" not in arrays:
        moves = "t" in arrays and arrays["t"].ndim == 2 and arrays["t"].shape[1] == 3 and len(arrays["t"]) > 1
        return [_moving(given, up, arrays.get("frames")) if moves else _standing(given, up)]
    names = np.atleast_1d(arrays["names"])
    if wrong := [what for what, values in given.items() if values.ndim < 2 or len(values) != len(names)]:
        raise ValueError(f"has {len(names)} names, but not so many rows of {wrong[0]}")
    rows = ({what: values[i] for what, values in given.items()} for i in range(len(names)))
    return [_one(str(name), up, row) for name, row in zip(names, rows, strict=True)]


def _one(name: str, up: Any, given: dict[str, Any], poses: Poses | None = None) -> Calibration:
    return calibration(name, up=up, poses=poses, first_pixel=OPENCV_FIRST_PIXEL, **given)


def _standing(given: dict[str, Any], up: Any) -> Calibration:
    if given["matrix"].ndim == 3:
        raise ValueError("has several cameras without names, or a zooming one; expected one K, or names")
    return _one("", up, given)


def _moving(given: dict[str, Any], up: Any, frames: np.ndarray | None) -> Calibration:
    matrix = np.unique(given["matrix"], axis=0) if given["matrix"].ndim == 3 else given["matrix"]
    if matrix.ndim == 3 and len(matrix) > 1:
        raise ValueError(
            "has several cameras without names, or a zooming one; expected names, or one K for all frames of a camera "
            "that moves"
        )
    if "rotation" not in given or len(given["rotation"]) != len(given["translation"]):
        found = len(given["rotation"]) if "rotation" in given else 0
        raise ValueError(f"has {len(given['translation'])} rows of t and {found} of R; expected as many")
    places = []
    for row, (rotation, translation) in enumerate(zip(given["rotation"], given["translation"], strict=True)):
        try:
            places.append(pose_of(rotation, translation))
        except ValueError as error:
            raise ValueError(f"row {row} of R and t: {error}") from error
    rest = {what: given[what] for what in ("distortion", "size") if what in given}
    rotations, translations = (np.stack(part) for part in zip(*places, strict=True))
    numbers = None if frames is None else _numbers_of(frames, len(places))
    poses = Poses(rotation=rotations, translation=translations, numbers=numbers)
    return _one("", up, {"matrix": matrix, **rest}, poses)


def _numbers_of(frames: np.ndarray, count: int) -> tuple[int, ...]:
    if frames.dtype.kind not in "iu" or frames.shape != (count,):
        raise ValueError(f"has 'frames' of the shape {frames.shape} ({frames.dtype}); expected {count} whole numbers")
    return tuple(frames.tolist())
