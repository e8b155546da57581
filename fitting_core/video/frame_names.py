"""Frames by their numbers: in file names, in words, and of two recordings whose frame rates differ."""

import re
from collections.abc import Iterable, Sequence
from typing import Any

from fitting_core.frame_runs import runs

_NUMBERED = re.compile(r"^(?P<prefix>.*?)(?P<number>\d+)$", re.DOTALL)
_DIGITS = re.compile(r"(\d{1,40})")


def natural_key(name: str) -> tuple[tuple[int, str], ...]:
    """Sort key under which ``frame2`` comes before ``frame10``; upper and lower case count as the same."""
    parts = re.split(r"(\d+)", name.lower())
    return tuple((int(part), "") if k % 2 else (-1, part) for k, part in enumerate(parts))


def split_number(stem: str) -> tuple[str, int | None]:
    """What stands before the number at the end of a file's stem, and that number: ``walk_0012`` is ("walk_", 12).

    The number is None where the stem does not end in digits.
    """
    match = _NUMBERED.match(stem)
    return (match["prefix"], int(match["number"])) if match else (stem, None)


def frame_numbers(stems: Sequence[str]) -> tuple[int, ...] | None:
    """The one number by which names differ, wherever it stands: 0 and 1 of ``walk_0000_30fps`` and ``walk_0001_30fps``.

    Of a single name, and of names with the same numbers, it is the one at the end. None unless nothing else differs.
    """
    parts = [_DIGITS.split(stem) for stem in stems]
    if len({tuple(part[::2]) for part in parts}) != 1:
        return None
    columns = [tuple(map(int, column)) for column in zip(*(part[1::2] for part in parts), strict=True)]
    found = {column for column in columns if len(set(column)) > 1} or {c for c in columns[-1:] if not parts[0][-1]}
    return found.pop() if len(found) == 1 else None


def image_numbers(stems: Iterable[str]) -> dict[int, int]:
    """Places of images by the numbers in their names; empty unless these alone differ."""
    return {number: t for t, number in enumerate(frame_numbers(list(stems)) or ())}


def among_images(
    stems: Sequence[str], numbers: Sequence[int] | None, images: Sequence[str]
) -> tuple[dict[int, int], str] | None:
    """By the file: the place of its image, as their names or else the numbers in them tell; and how, in words.

    One side must have all that the other has. Where frames are missing on both, more than half of the fewer must be
    shared, and the images' numbers must have gaps: those that are merely counted from another number share most, too.

    Args:
        stems: The files' names.
        numbers: In these, if only they differ.
        images: Their names, in order; none for a video.
    """
    numbered = image_numbers(images)
    gaps = bool(numbered) and max(numbered) - min(numbered) >= len(numbered)
    late = bool(numbered) and min(numbered) > 1

    def shared(keys: Sequence[Any], places: dict[Any, int], sure: bool) -> dict[int, int]:
        both = {k: places[key] for k, key in enumerate(keys) if key in places}
        whole = len(both) == len(keys) or (sure and len(both) == len(places))
        return both if whole or (gaps and 2 * len(both) > min(len(keys), len(places))) else {}

    if pairs := shared(stems, {stem: t for t, stem in enumerate(images)}, True):
        return pairs, "by the images' names"
    if pairs := shared(numbers or (), numbered, gaps or late):
        return pairs, "by the numbers in the images' names"
    return None


def spans(frames: list[int], most: int = 5) -> str:
    """Ascending frame numbers in words: ``3, 7-12``; after ``most`` spans, how many follow."""
    words = [str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs(frames)]
    return ", ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")


_SAME = 1.5e-3
"""Share by which two frame rates that mean the same may differ: 29.97 and 30 do, by 1.001e-3."""


def frames_for_one(rate: float, clip_rate: float) -> float:
    """How many frames of a recording at `rate` pass in one frame of a clip; whole, or one by a whole number, if nearly.

    59.94 beside 30 frames per second is 2: taken as 1.998, frame 4000 would be 8 frames off.

    Args:
        rate: Frames per second, above 0.
        clip_rate: The same of the clip.
    """
    ratio = rate / clip_rate
    whole = float(round(max(ratio, 1 / ratio)))
    near = whole if ratio >= 1 else 1 / whole
    return near if abs(ratio / near - 1) < _SAME else ratio
