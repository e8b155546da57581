"""JSON from other programs, and the keypoints in it: read and checked, with errors in the user's words."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.keypoint_noise import DETECTOR_TITLES
from fitting_core.video.frame_names import natural_key

# OpenPose interpolates its heat maps bicubically, which overshoots: real files hold face confidences up to 1.006.
MAX_CONFIDENCE = 1.25
MIN_CONFIDENCE = -1e-3
"""Its heat maps undershoot as well: -2e-6 is common in real files, and means 0."""
MAX_POSITION = 1e6
_START = 65536
"""Bytes of a file that its format is recognised by: COCO's annotation files can start with a list of licences."""


def first_bytes(path: Path) -> bytes:
    """The start of a file. Raises InputError if it cannot be read."""
    try:
        with regular_file(path).open("rb") as file:
            return file.read(_START)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error


def is_json(start: bytes) -> bool:
    """Whether a file with this start is a JSON object or list."""
    return start.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"[")


def json_files(folder: Path) -> list[Path]:
    """Ordered by name, without hidden files that operating systems add."""
    files = [file for file in folder.iterdir() if file.suffix.lower() == ".json" and not file.name.startswith(".")]
    return sorted(files, key=lambda file: natural_key(file.stem))


def read_keypoint_json(file: Path, *, advice: str) -> Any:
    """The content of a JSON file. Raises InputError if it is missing, unreadable, damaged, or nested deeper than Python
    can read.

    Args:
        file: UTF-8, with or without a byte order mark.
        advice: What to do if it is damaged.
    """
    try:
        return json.loads(regular_file(file).read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError(f"{file} does not exist; expected a keypoint file or a folder of them.") from None
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror or error}.") from error
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file} is not readable as JSON ({error}). It may be cut off: {advice}.") from error


def kind(value: Any) -> str:
    """A JSON value described in words."""
    return {dict: "an object", list: "a list", str: "a text", bool: "a truth value", type(None): "null"}.get(
        type(value), f"the number {value:g}" if isinstance(value, float) else f"the number {short(value)}"
    )


def short(value: object) -> str:
    """A value's text, shortened for a message."""
    said = repr(value) if not isinstance(value, int) or value.bit_length() < 200 else "of hundreds of digits"
    return said if len(said) <= 60 else f"{said[:57]}..."


def numbers(where: str, values: Sequence[Any], names: Sequence[str], *, each: int = 3) -> Float[np.ndarray, "n"]:
    """A JSON list as floats. Raises InputError if one of them is not a number; the message names its keypoint.

    Args:
        where: File, person and list, for the message.
        values: The list.
        names: Of the keypoints, `each` values apiece.
        each: Values of one keypoint.
    """
    if not set(map(type, values)) <= {int, float}:
        k = next(k for k, value in enumerate(values) if type(value) not in (int, float))
        raise InputError(f"{where}, {names[k // each]}: found {short(values[k])}; expected a number.")
    # Python's integers have no limit, but floats do: an integer of 400 digits is a wrong position, not an overflow.
    try:
        return np.array(values, dtype=float)
    except OverflowError:
        return np.array([math.inf if abs(value) > 1e300 else value for value in values], dtype=float)


def checked_points(
    where: str, points: Float[np.ndarray, "K 3"], names: Sequence[str], *, most: float = MAX_CONFIDENCE
) -> Float[np.ndarray, "K 3"]:
    """Usable positions and confidences: x, y, and confidence up to 1; (0, 0, 0) where not detected. Raises InputError
    if a value is not finite, too large, or a negative confidence; the message names its keypoint.

    Args:
        where: File, person and list, for the message.
        points: x, y, confidence as read; a confidence down to MIN_CONFIDENCE counts as 0.
        names: Of the keypoints.
        most: The largest confidence that is clipped to 1 instead of refused.
    """
    wrong_position = ~np.all(np.abs(points[:, :2]) <= MAX_POSITION, axis=1)
    wrong_confidence = ~((points[:, 2] >= MIN_CONFIDENCE) & (points[:, 2] <= most))
    if (wrong_position | wrong_confidence).any():
        k = int(np.argmax(wrong_position | wrong_confidence))
        x, y, confidence = points[k]
        found = f"position ({x:g}, {y:g})" if wrong_position[k] else f"confidence {confidence:g}"
        expected = f"numbers up to {MAX_POSITION:g}" if wrong_position[k] else "0 (not detected) to 1"
        raise InputError(f"{where}, {names[k]}: found {found}; expected {expected}.")
    confidence = points[:, 2].clip(0.0, 1.0)
    return np.column_stack([points[:, :2], confidence]) * (confidence > 0)[:, None]


def stray_confidences(path: Path, confidences: Float[np.ndarray, "n"]) -> tuple[str, ...]:
    """A note on the confidences that `checked_points` clipped to 0 to 1, if any.

    Args:
        path: Where they were read.
        confidences: As read, all of the clip.
    """
    stray = confidences[(confidences < 0) | (confidences > 1)]
    if not len(stray):
        return ()
    found = f"{stray.min():.4g}" if len(stray) == 1 else f"{len(stray)} from {stray.min():.4g} to {stray.max():.4g}"
    return (f"{path.name} has confidences outside 0 to 1 ({found}); they count as 0 or 1.",)


def stated_detector(path: Path, stated: Any) -> tuple[str, tuple[str, ...]]:
    """The name in `keypoint_noise.DETECTOR_TITLES` that a file states, and a note if the detector is unknown."""
    name = stated.strip().lower() if isinstance(stated, str) else ""
    if name in DETECTOR_TITLES:
        return name, ()
    known = ", ".join(DETECTOR_TITLES)
    return "", (
        f"{path.name} states the detector {short(stated)}; known are {known}. Its keypoints are weighted "
        "as if they were OpenPose's.",
    )
