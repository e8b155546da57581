"""What detections have found, in files that are whole or absent, so that a detection can be resumed after any crash.

They are kept in the user's cache, so that nothing is found twice in the same frames by the same detector.
"""

import hashlib
import json
import os
import shutil
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import platformdirs

from fitting_core.detect.part import Part
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.npz import read_npz, write_npz

_SETTINGS, _MEMORY = "settings.json", "memory_"
_DIGEST = "digest"
_VERSION = 3
"""Raised whenever the meaning of the files changes."""
_MOST_KEPT = 2 << 30
"""Bytes of detections kept, about a million frames of one person; the least recently used are deleted first."""


@dataclass(frozen=True, kw_only=True)
class DetectionSettings:
    """All that the result depends on."""

    video: str
    """`fingerprint` of the file or folder."""
    first_frame: int
    last_frame: int
    detector: str
    """Its version."""
    version: int = _VERSION


def users_folder() -> Path:
    """Where detections are kept for the user."""
    return platformdirs.user_cache_path("tcfit", appauthor=False) / "keypoints"


class StoredDetection:
    """The parts of a detection on the disk.

    Args:
        settings: Of the detection.
        kept_in: Folder of all detections; None: `users_folder`.
    """

    def __init__(self, settings: DetectionSettings, kept_in: Path | None = None) -> None:
        self._settings = json.dumps(asdict(settings), indent=1)
        self._kept_in = kept_in or users_folder()
        self.folder = (
            self._kept_in / f"{settings.video[:16]}-{hashlib.sha256(self._settings.encode()).hexdigest()[:16]}"
        )

    def begin(self) -> None:
        """Make the folder, or continue in an existing one; those that were used longest ago are deleted to make room.
        Raises InputError if it cannot be written."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with replacing(self.folder / _SETTINGS) as draft:
                draft.write_text(self._settings, encoding="utf-8")
        except OSError as error:
            raise self._unwritable(error) from error
        room = _MOST_KEPT
        for settings in sorted(self._kept_in.glob(f"*/{_SETTINGS}"), key=_used, reverse=True):
            room -= _size(settings.parent)
            if room < 0 and settings.parent != self.folder:
                shutil.rmtree(settings.parent, ignore_errors=True)

    def _unwritable(self, error: OSError) -> InputError:
        reason = error.strerror or error
        return InputError(
            f"{self.folder}: cannot be written ({reason}). Detected keypoints are kept there: free "
            "space, or allow writing."
        )

    def discard(self) -> None:
        """Delete everything."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def write(self, number: int, part: Part) -> None:
        """Store a part."""
        arrays = {f"{_MEMORY}{name}": array for name, array in part.memory.items()}
        arrays["counts"] = np.array([len(people) for people in part.people])
        arrays["people"] = np.concatenate(part.people)
        arrays["numbers"] = np.concatenate(part.numbers)
        arrays["silhouettes"] = np.concatenate(part.silhouettes)
        arrays[_DIGEST] = _digest(arrays)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)  # another process may have made room
            write_npz(self._path(number), arrays)
        except OSError as error:
            raise self._unwritable(error) from error

    def read(self, number: int) -> Part | None:
        """What `write` stored; None where there is nothing."""
        try:
            arrays = read_npz(self._path(number))
        except (OSError, ValueError):
            return None  # missing or damaged: it is made again
        stated = arrays.pop(_DIGEST, np.zeros(0))
        return _part(arrays) if np.array_equal(stated, _digest(arrays)) else None

    def _path(self, number: int) -> Path:
        return self.folder / f"part-{number:06}.npz"


def _used(settings: Path) -> float:
    """When a detection was used last; other processes delete old ones, too."""
    try:
        return settings.stat().st_mtime
    except OSError:
        return 0.0


def _size(folder: Path) -> int:
    """Bytes of the files in a folder, which another process may just be deleting."""
    with suppress(OSError), os.scandir(folder) as files:
        return sum(file.stat().st_size for file in files)
    return 0


def _digest(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """SHA-256 of arrays with their names, types and shapes: a part that was not written by `write` is not used."""
    found = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        found.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        found.update(np.ascontiguousarray(array).data)
    return np.frombuffer(found.digest(), np.uint8)


def _part(arrays: dict[str, np.ndarray]) -> Part:
    ends = np.cumsum(arrays["counts"])[:-1]
    return Part(
        people=tuple(np.split(arrays["people"], ends)),
        numbers=tuple(np.split(arrays["numbers"], ends)),
        silhouettes=tuple(np.split(arrays["silhouettes"], ends)),
        memory={name.removeprefix(_MEMORY): array for name, array in arrays.items() if name.startswith(_MEMORY)},
    )
