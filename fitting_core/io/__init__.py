"""Formats in and out. READERS holds one line per format that keypoints are read from."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.io.coco_wholebody import holds_coco
from fitting_core.io.detections import Detections
from fitting_core.io.pose_binary import starts_as_pose

_START = 65536
"""Bytes of a file by which its format is told: COCO's annotation files can start with a list of licences."""


def _holds_people(path: Path, start: bytes) -> bool:
    return path.is_dir() or path.name.endswith("_keypoints.json") or (_is_json(start) and b'"people"' in start)


def _holds_coco(path: Path, start: bytes) -> bool:
    return _is_json(start) and holds_coco(start)


def _holds_pose(path: Path, start: bytes) -> bool:
    return path.suffix.lower() == ".pose" or starts_as_pose(start)


def _is_json(start: bytes) -> bool:
    return start.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"[")


READERS: dict[Callable[[Path, bytes], bool], str] = {
    _holds_people: "fitting_core.io.openpose:read_openpose",
    _holds_coco: "fitting_core.io.coco_wholebody:read_coco_wholebody",
    _holds_pose: "fitting_core.io.pose_file:read_pose",
}
"""What recognises a format by the path and its first bytes (none of a folder) -> the function Path -> Detections.

The first that recognises a path reads it, so narrow ones stand above broad ones; it is imported when it is used.
"""


def read_detections(path: Path) -> Detections:
    """Read all people in all frames from a keypoint file or folder of any known format.

    Raises:
        InputError: There is no such path, its format is not known, or its content is broken.
    """
    if not path.exists():
        raise InputError(f"No keypoints at {path}: there is no such file or folder.")
    try:
        start = b"" if path.is_dir() else _first_bytes(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    for recognises, reader in READERS.items():
        if recognises(path, start):
            module, function = reader.split(":")
            return getattr(import_module(module), function)(path)
    found = "is empty" if not start else "starts as none of these"
    raise InputError(
        f"{path} is no keypoint format that can be read: it {found}. Expected a folder of OpenPose JSON files or one "
        "of them, a COCO-WholeBody JSON, or a .pose file."
    )


def _first_bytes(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_START)
