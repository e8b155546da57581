"""Cameras in nested tables: TOML of Pose2Sim, caliscope and Anipose; OpenCV's YAML, XML and JSON, and ROS's YAML.

Any table that holds a camera matrix is a camera, at any depth. Programs spell the same names with other capitals,
underscores and words: NAMES has those that are read.

- Pose2Sim, Anipose: a section for each camera: name, size, matrix, distortions, rotation (vector), translation.
- caliscope: `[cameras.N]` with cam_id, size, matrix, distortions, rotation (matrix), translation.
- Gyroflow's lens profiles: fisheye_params with camera_matrix and distortion_coeffs, calib_dimension beside them.
- OpenCV's FileStorage: camera_matrix, distortion_coefficients, image_width, image_height, sometimes R and T; matrices
  are tables of rows, cols and data. ROS's camera_info has the same without types.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import msgspec

from fitting_core.errors import some_of
from fitting_core.files.regular import parsed_toml
from fitting_core.io.cameras.calibration import OPENCV_FIRST_PIXEL, Calibration, calibration, text_of
from fitting_core.io.cameras.transforms import is_transforms, read_transforms

NAMES: dict[str, tuple[str, ...]] = {
    "matrix": ("matrix", "cameramatrix", "intrinsicmatrix", "intrinsics", "k", "mtx", "m"),
    "distortion": (
        *("distortions", "distortion", "distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoefs"),
        *("distcoeff", "dist", "d"),
    ),
    "size": ("size", "imagesize", "imgsize", "resolution", "calibdimension"),
    "width": ("imagewidth", "width"),
    "height": ("imageheight", "height"),
    "rotation": ("rotation", "rotationmatrix", "rotationvector", "rvec", "r"),
    "translation": ("translation", "translationvector", "tvec", "t"),
    "name": ("name", "cameraname", "camid"),
    "up": ("up",),
    "fisheye": ("fisheye", "fisheyemodel"),
    "model": ("distortionmodel",),
}
"""Without capitals, hyphens and underscores."""
_INHERITED = ("size", "width", "height", "fisheye", "model")
"""Entries that also count for the cameras in the tables within: lens profiles of Gyroflow have their size outside."""
_MODELS = ("plumbbob", "rationalpolynomial", "radtan", "opencv", "brownconrady", "none", "")
_DEEPEST = 8
"""Tables within tables."""
_NESTED = 256
"""Nesting allowed to OpenCV's parsers, which crashed at 30,000 levels."""
_XML = re.compile(r"(?P<opens><[^/!?][^<>]*+(?<!/)>)|</")
_YAML = re.compile(r"(?P<opens>[\[{])|[\]}]")
_INDENTED = re.compile(rf"[ \t?-]{{{_NESTED}}}")
_MOST_BYTES = 4 * 2**20
"""Limit for TOML, YAML and XML of cameras, which take a few kilobytes."""
_MOST = 100
"""Elements of a matrix."""
_TOML_UP = "z"
"""Pose2Sim's worlds have z up, and so do those that caliscope's users level."""


def read_toml(path: Path) -> list[Calibration]:
    """All cameras of a TOML file. Raises ValueError if it has none, or an unusable one; OSError."""
    try:
        table = parsed_toml(text_of(path, most=_MOST_BYTES))
    except ValueError as error:
        raise ValueError(f"is not TOML ({error})") from error
    return _cameras(table, up=_TOML_UP)


def read_json(path: Path) -> list[Calibration]:
    """All cameras of a JSON file. Raises ValueError if it has none, or an unusable one; OSError."""
    try:
        table = msgspec.json.decode(text_of(path))
    except (msgspec.DecodeError, RecursionError) as error:
        raise ValueError(f"is not JSON ({error})") from error
    return read_transforms(table) if is_transforms(table) else _cameras(table)


def read_yaml(path: Path) -> list[Calibration]:
    """All cameras of OpenCV's or ROS's YAML. Raises ValueError if it has none, or an unusable one; OSError."""
    text = text_of(path, most=_MOST_BYTES)
    _forbid_depth("YAML", text, _YAML)
    if deep := _INDENTED.search(text):
        raise ValueError(
            f"is not a camera's YAML: line {text.count(chr(10), 0, deep.start()) + 1} is nested too deeply"
        )
    # OpenCV needs the YAML header, which ROS does not write.
    return _cameras(_stored(text if text.startswith("%YAML") else f"%YAML:1.0\n---\n{text}", "YAML"))


def read_xml(path: Path) -> list[Calibration]:
    """All cameras of OpenCV's XML. Raises ValueError if it has none, or an unusable one; OSError."""
    text = text_of(path, most=_MOST_BYTES)
    _forbid_depth("XML", text, _XML)
    return _cameras(_stored(text, "XML"))


def _forbid_depth(form: str, text: str, marks: re.Pattern) -> None:
    """Raises ValueError for a text so deeply nested that OpenCV's recursive parsers would crash the process."""
    depth = 0
    for mark in marks.finditer(text):
        depth += 1 if mark["opens"] else -1
        if depth > _NESTED:
            raise ValueError(f"is not a camera's {form}: it is nested more than {_NESTED} deep")


def _stored(text: str, form: str) -> Any:
    """The text parsed by OpenCV, which neither runs nor resolves anything in it."""
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        return _plain(storage.root())
    except (cv2.error, SystemError, UnicodeDecodeError) as error:
        reason = str(error.__cause__ or error).strip().rpartition("error: ")[2].replace("\n", " ")
        raise ValueError(f"is not {form} that OpenCV can read ({reason[:200]})") from error


def _plain(node: Any, depth: int = 0) -> Any:
    """A node as dicts, lists, numbers and texts; what is nested too deeply is left out."""
    if depth > _DEEPEST:
        return None
    if node.isMap():
        return {key: _plain(node.getNode(key), depth + 1) for key in list(node.keys())}
    if node.isSeq():
        return [_plain(node.at(i), depth + 1) for i in range(min(node.size(), _MOST))]
    if node.isString():
        return node.string()
    return node.real() if node.isReal() or node.isInt() else None


def _cameras(table: Any, *, up: str | None = None) -> list[Calibration]:
    found = list(_within(table, "", 0, up, {}))
    if not found:
        raise ValueError(f"has no camera matrix in it (it has {some_of(table if isinstance(table, dict) else ())})")
    return found


def _within(table: Any, key: str, depth: int, up: str | None, around: dict[str, Any]) -> Iterator[Calibration]:
    """The cameras in a table and in those inside it; `around` are entries that it inherits."""
    if not isinstance(table, dict) or depth > _DEEPEST:
        return
    known = around | {what: table[name] for what, name in _names(table)}
    if "fisheye" in key.lower() and "model" not in known:
        known["fisheye"] = True
    if "matrix" in known and not _is_table_of_cameras(known["matrix"]):
        yield _camera(key, known, up)
        return
    for name, inner in table.items():
        yield from _within(inner, str(name), depth + 1, up, {k: v for k, v in known.items() if k in _INHERITED})


def _is_table_of_cameras(value: Any) -> bool:
    """A table such as "intrinsics" may hold the matrix, or be it: that has data."""
    return isinstance(value, dict) and "data" not in value


def _names(table: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """The entries of NAMES that a table has, with their keys; the first of several spellings."""
    keys = {re.sub("[-_ ]", "", str(key)).lower(): key for key in reversed(table)}
    for what, spellings in NAMES.items():
        for spelling in spellings:
            if spelling in keys:
                yield what, keys[spelling]
                break


def _camera(key: str, known: dict[str, Any], up: str | None) -> Calibration:
    name = key or str(known.get("name", ""))
    model = re.sub("[-_ ]", "", str(known.get("model", ""))).lower()
    try:
        if known.get("fisheye") or model not in _MODELS:
            raise ValueError(
                f"has a lens of another model ({known.get('model', 'fisheye')}); expected OpenCV's with radial and "
                "tangential distortion. Undistort the video, and leave the distortion out of the file"
            )
        size = known.get("size")
        if isinstance(size, dict) and {"w", "h"} <= set(size):
            size = (size["w"], size["h"])
        if size is None and {"width", "height"} <= set(known):
            size = (known["width"], known["height"])
        rotation, translation = _array(known.get("rotation")), _array(known.get("translation"))
        return calibration(
            name,
            matrix=_array(known["matrix"]),
            distortion=_array(known.get("distortion")),
            size=_array(size),
            rotation=rotation,
            translation=translation,
            up=known.get("up", up if rotation is not None else None),
            first_pixel=OPENCV_FIRST_PIXEL,
        )
    except ValueError as error:
        raise ValueError(f"{f'camera {name!r} ' if name else ''}{error}") from error


def _array(value: Any) -> Any:
    """The numbers of a matrix given as a table of rows, cols and data; other values unchanged."""
    if not isinstance(value, dict):
        return value
    data = value.get("data")
    shape = [value.get(side, 0) for side in ("rows", "cols")]
    if not isinstance(data, list) or not all(isinstance(side, int | float) for side in shape):
        raise ValueError(f"has a matrix without data (it has {', '.join(map(str, value))[:100]})")
    if len(data) != shape[0] * shape[1]:
        raise ValueError(f"has a matrix of {shape[0]:g} x {shape[1]:g} with {len(data)} numbers")
    return data


TABLES: dict[str, Callable[[Path], list[Calibration]]] = {
    ".toml": read_toml,
    ".json": read_json,
    ".yml": read_yaml,
    ".yaml": read_yaml,
    ".xml": read_xml,
}
"""By the file's suffix."""
