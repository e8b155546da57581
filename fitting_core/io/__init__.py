"""Formats in and out. READERS holds one line per format that keypoints are read from."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.io.detections import Detections


def _holds_people(path: Path) -> bool:
    if path.is_dir() or path.name.endswith("_keypoints.json"):
        return True
    if path.suffix.lower() != ".json":
        return False
    with path.open("rb") as file:
        return b'"people"' in file.read(4096)


READERS: dict[Callable[[Path], bool], str] = {
    _holds_people: "fitting_core.io.openpose:read_openpose",
}
"""What recognises a format by a look at the path -> the function Path -> Detections, imported when it is used.

The first that recognises a path reads it, so narrow ones stand above broad ones.
"""


def read_detections(path: Path) -> Detections:
    """Read all people in all frames from a keypoint file or folder of any known format.

    Raises:
        InputError: There is no such path, its format is not known, or its content is broken.
    """
    if not path.exists():
        raise InputError(f"No keypoints at {path}: there is no such file or folder.")
    for recognises, reader in READERS.items():
        if recognises(path):
            module, function = reader.split(":")
            return getattr(import_module(module), function)(path)
    raise InputError(
        f"{path.name} is no keypoint format that can be read; expected a folder of OpenPose JSON files, or one."
    )
