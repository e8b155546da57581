"""Put keypoint files and video frames together, frame by frame."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT
from fitting_core.video.frame_names import among_images

# Two stray files numbered 0 and 1000000 are no clip of a million frames.
_MOST_MISSING = 1000
_MOST_MISSING_PER_FILE = 10
_BY_NUMBER, _FROM_FIRST = "by the numbers in their names", "by their numbers, from the first file on"
_PERHAPS_FROM_1 = (
    ", counted from 0. Counted from 1 they fit as well: if the points come a frame after the person, number them from 0"
)
_LISTED = 12
IN_ORDER = "in their order, from the start"


@dataclass(frozen=True, kw_only=True)
class Timeline:
    """The frames of a clip before a part of it is selected."""

    numbers: range
    """How frames are counted: from 0 in a video, as the files are numbered without one."""
    stems: tuple[str, ...] | None = None
    """Per frame the image's name, if frames are image files."""
    source: Path | None = None
    """The video or the folder of images, if any."""


def timeline_of_keypoints(detections: Detections) -> Timeline:
    """The frames from the first to the last keypoint file, where there is no video. Raises InputError if there are
    files of several clips, or numbers too far apart to be one."""
    _forbid_mixed_clips(detections)
    numbers = detections.numbers
    if numbers is None:
        return Timeline(numbers=range(len(detections)))
    span = range(min(numbers), max(numbers) + 1)
    if len(span) - len(numbers) > _MOST_MISSING + _MOST_MISSING_PER_FILE * len(numbers):
        raise InputError(
            f"The {len(numbers)} keypoint files in {detections.source} are numbered from {span[0]} to {span[-1]}: "
            "too few for so many frames. Remove the files that do not belong to the clip, or renumber them."
        )
    return Timeline(numbers=span)


def align(detections: Detections, timeline: Timeline) -> tuple[Detections, tuple[str, ...]]:
    """Detections of every frame of the timeline, and notes on how they were put together where it was not plain.

    The first of these that fits is used: the images' names; the numbers in them; the files' numbers, as frames counted
    from 0, from 1, or from the first file on. Numbers that run past the clip are kept where most of them follow each
    other; else the files are taken in their order. Frames without a file have no people, and files without a frame are
    named.

    Raises:
        InputError: Files of several clips in one folder.
    """
    places, how = _places(detections, timeline)
    count = len(timeline.numbers)
    kept = {place: k for k, place in places.items() if 0 <= place < count}
    used = set(kept.values())
    left_out = [stem for k, stem in enumerate(detections.stems) if k not in used]
    nobody = np.zeros((0, COUNT, 3))
    frames = tuple(detections.frames[kept[t]] if t in kept else nobody for t in range(count))
    stems = tuple(detections.stems[kept[t]] if t in kept else "" for t in range(count))
    plain = list(places.values()) == list(range(count)) and not left_out
    notes = () if plain else _notes(detections, left_out, timeline, how)
    return replace(detections, frames=frames, stems=stems), notes


def chosen(timeline: Timeline, first_frame: int | None, last_frame: int | None) -> slice:
    """Places in the timeline of the frames from first_frame to last_frame, both included; None: its first, its last.
    Raises InputError if the frames asked for are not in the clip."""
    numbers = timeline.numbers
    first = numbers[0] if first_frame is None else first_frame
    last = numbers[-1] if last_frame is None else last_frame
    if first not in numbers or last not in numbers or first > last:
        raise InputError(
            f"Frames {first} to {last} were asked for (`first_frame`, `last_frame`); expected two frames in order out "
            f"of {numbers[0]} to {numbers[-1]}, which the clip has."
        )
    return slice(first - numbers[0], last - numbers[0] + 1)


def _places(detections: Detections, timeline: Timeline) -> tuple[Mapping[int, int], str]:
    """By the file: the place of its frame in the timeline; and how that was found, in words."""
    numbers = detections.numbers
    if pairs := among_images(detections.stems, numbers, timeline.stems or ()):
        return pairs
    _forbid_mixed_clips(detections)
    if numbers is None:
        return {k: k for k in range(len(detections))}, IN_ORDER
    return counted(numbers, timeline.numbers)


def counted(numbers: tuple[int, ...], frames: range) -> tuple[dict[int, int], str]:
    """Places of files whose numbers count frames, from where these fit into the clip; and how, in words.

    IN_ORDER where they count something else.
    """
    lowest, highest = min(numbers), max(numbers)
    starts = ((frames[0], _BY_NUMBER), (1, "by their numbers, counted from 1"), (lowest, _FROM_FIRST))
    fitting = [start for start, _ in starts if start <= lowest and highest - start < len(frames)]
    # Every tenth frame of another clip may be every frame of this one; gaps here and there are people not found.
    if not fitting and np.median(np.diff(sorted(numbers))) > 1:
        return {k: k for k in range(len(numbers))}, IN_ORDER
    # Past the clip's end: numbers from 1 on count from 1, and those that begin outside from wherever they begin.
    past_end = frames[0] if frames[0] + 1 < lowest <= frames[-1] else lowest
    start = fitting[0] if fitting else past_end
    how = next(how for s, how in starts if s == start)
    # Result lists leave out frames without people: without the last one, 1 to 119 fit 120 frames either way.
    doubtful = bool(fitting) and start == frames[0] == 0 < lowest
    return {k: number - start for k, number in enumerate(numbers)}, how + _PERHAPS_FROM_1 * doubtful


def _notes(detections: Detections, left_out: list[str], timeline: Timeline, how: str) -> tuple[str, ...]:
    count, files = len(timeline.numbers), len(detections)
    one_file = detections.source.is_file()
    there = f"{detections.source.name} has {files} frames" if one_file else f"There are {files} keypoint files"
    frames = (
        f"{timeline.source.name} has {count} frames" if timeline.source else f"the files' numbers span {count} frames"
    )
    sentences = [f"{there}, {frames}; they were aligned {how}."]
    if left_out:
        what = "its frames" if one_file else "the files"
        has, are = ("have", "are") if len(left_out) > 1 else ("has", "is")
        more = f" and {len(left_out) - _LISTED} more" if len(left_out) > _LISTED else ""
        names = ", ".join(left_out[:_LISTED])
        sentences.append(f"{len(left_out)} of {what} {has} no frame of the clip and {are} left out: {names}{more}.")
    if without := count - (files - len(left_out)):
        sentences.append(f"{without} frames have no keypoints and count as not detected.")
    return (" ".join(sentences),)


def _forbid_mixed_clips(detections: Detections) -> None:
    if detections.numbers is None and len(detections) > 1 and len(detections.prefixes) > 1:
        names = ", ".join(f"{prefix}..." for prefix in detections.prefixes[:3])
        if len({re.sub(r"\d+", "0", stem) for stem in detections.stems}) == 1:
            raise InputError(
                f"{detections.source}: the names of its files differ in several numbers ({detections.stems[0]}, "
                f"{detections.stems[1]}); expected one, which counts the frames. Rename them, or move the clips apart."
            )
        raise InputError(
            f"{detections.source} holds keypoint files of {len(detections.prefixes)} clips ({names}); expected one "
            "clip per folder. Move them apart."
        )
