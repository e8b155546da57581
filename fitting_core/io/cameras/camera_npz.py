"""tcfit's own form of a calibrated camera: an npz with OpenCV's arrays, x_camera = R x_world + t.

| key | shape | |
|---|---|---|
| K | (3, 3) | focal lengths and principal point, pixels |
| dist | (n,) | optional: OpenCV's distortion coefficients, 4, 5, 8 or 12 |
| size | (2,) | optional: width and height of the images that were calibrated |
| R | (3, 3) or (3,) | optional: rotation from the world to the camera, as a matrix or as a rotation vector |
| t | (3,) | with R: translation, metres |
| up | () | optional: the world's axis against gravity: x, y, z, -x, -y or -z |
| names | (N,) | optional: names of N cameras; the arrays above then have N rows, but for up |
"""

from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.files.npz import read_npz
from fitting_core.io.cameras.calibration import Calibration, calibration

_ROWS = {"K": "matrix", "dist": "distortion", "size": "size", "R": "rotation", "t": "translation"}
"""Arrays with a row for each camera, and what `calibration` calls them."""
_MAX_BYTES = 2**24


def read_camera_npz(path: Path) -> list[Calibration]:
    """All cameras of the file.

    Raises:
        ValueError: It is no such npz, or has a camera that cannot be used.
        OSError: It cannot be read.
    """
    arrays = read_npz(path, (*_ROWS, "up", "names"), most=_MAX_BYTES)
    if "K" not in arrays:
        raise ValueError(f"has no camera matrix K (it has {', '.join(arrays) or 'none of the keys of a camera'})")
    up: Any = str(arrays["up"]) if "up" in arrays else None
    given = {what: arrays[key] for key, what in _ROWS.items() if key in arrays}
    if "names" not in arrays:
        if arrays["K"].ndim == 3 or ("t" in arrays and arrays["t"].ndim == 2 and len(arrays["t"]) > 1):
            raise ValueError(
                "has several cameras, or one that moves, and no names; expected one that stands still, or names"
            )
        return [calibration("", up=up, **given)]
    names = np.atleast_1d(arrays["names"])
    if wrong := [what for what, values in given.items() if values.ndim < 2 or len(values) != len(names)]:
        raise ValueError(f"has {len(names)} names, but not so many rows of {wrong[0]}")
    rows = ({what: values[i] for what, values in given.items()} for i in range(len(names)))
    return [calibration(str(name), up=up, **row) for name, row in zip(names, rows, strict=True)]
