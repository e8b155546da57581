"""What a detection has found so far, in files, each of which is whole or not there: it can go on after any end."""

import json
import shutil
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fitting_core.detect.boxes import Boxes
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.files.regular import regular_file

_SETTINGS = "settings.json"
_VERSION = 1
"""Another one for every change of what the files mean, or of what the same models find."""


@dataclass(frozen=True, kw_only=True)
class DetectionSettings:
    """All that the result depends on: a stored beginning is gone on with only if all of it is the same."""

    video: str
    """Hash of its first frame, size and length."""
    first_frame: int
    last_frame: int
    pose_model: str
    """SHA-256 of the file."""
    box_model: str
    """SHA-256 of the file; empty without one."""
    person: int
    version: int = _VERSION

    def differences(self, other: "DetectionSettings") -> list[str]:
        """The names of what is not the same, in words."""
        names = [field.name for field in fields(self)]
        return [name.replace("_", " ") for name in names if getattr(self, name) != getattr(other, name)]


class StoredDetection:
    """A folder with the parts of a detection.

    Args:
        folder: Made by `begin`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def begin(self, settings: DetectionSettings) -> bool:
        """Make the folder, or go on with what lies in it, and say whether that is so.

        Raises:
            InputError: It holds the beginning of a detection with other settings.
        """
        known = self.settings()
        if known == settings:
            return True
        if known is not None:
            what = ", ".join(known.differences(settings))
            raise InputError(
                f"{self.folder}: holds the beginning of a detection with another {what}. Finish that one first, or "
                "start anew (--restart), which deletes it."
            )
        self.discard()
        self.folder.mkdir(parents=True, exist_ok=True)
        with replacing(self.folder / _SETTINGS) as draft:
            draft.write_text(json.dumps(asdict(settings), indent=1), encoding="utf-8")
        return False

    def settings(self) -> DetectionSettings | None:
        """Those of the detection that was begun here; None without one that can be gone on with."""
        try:
            return DetectionSettings(**json.loads(regular_file(self.folder / _SETTINGS).read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError):
            return None

    def discard(self) -> None:
        """Delete everything."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def write_boxes(self, part: int, found: list[Boxes]) -> None:
        """Store the people of each frame of a part."""
        corners, scores = ([getattr(boxes, name) for boxes in found] for name in ("corners", "scores"))
        counts = np.array([len(boxes) for boxes in found])
        self._write(f"boxes-{part:06}", counts=counts, corners=np.concatenate(corners), scores=np.concatenate(scores))

    def read_boxes(self, part: int) -> list[Boxes] | None:
        """What `write_boxes` stored; None where there is nothing."""
        arrays = self._read(f"boxes-{part:06}", ("counts", "corners", "scores"))
        if arrays is None:
            return None
        ends = np.cumsum(arrays["counts"])[:-1]
        pairs = zip(np.split(arrays["corners"], ends), np.split(arrays["scores"], ends), strict=True)
        return [Boxes(corners=corners, scores=scores) for corners, scores in pairs]

    def write_points(self, part: int, points: Float[np.ndarray, "n 133 3"]) -> None:
        """Store the points of each frame of a part."""
        self._write(f"points-{part:06}", points=points)

    def read_points(self, part: int) -> Float[np.ndarray, "n 133 3"] | None:
        """What `write_points` stored; None where there is nothing."""
        arrays = self._read(f"points-{part:06}", ("points",))
        return None if arrays is None else arrays["points"]

    def _write(self, name: str, **arrays: np.ndarray) -> None:
        try:
            write_npz(self.folder / f"{name}.npz", arrays)
        except OSError as error:
            raise InputError(
                f"{self.folder}: cannot be written ({error.strerror or error}). Free space there."
            ) from error

    def _read(self, name: str, keys: tuple[str, ...]) -> dict[str, np.ndarray] | None:
        try:
            arrays = read_npz(self.folder / f"{name}.npz", keys)
            return {key: arrays[key] for key in keys}
        except (OSError, KeyError, ValueError):
            return None  # not there, or damaged: it is made again
