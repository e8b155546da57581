"""Frames in words, with the clip's own numbers starting at its `first_frame`."""

from collections.abc import Iterable

from fitting_core.video.frame_names import spans


def numbers(frames: Iterable[int], first: int, *, most: int = 5) -> str:
    """Ascending frames: "3, 7–12"; after `most` runs, how many more."""
    if isinstance(frames, range) and len(frames) > 1:
        return f"{first + frames[0]}–{first + frames[-1]}"  # fast, however long
    return spans([first + frame for frame in frames], most).replace("-", "–")


def in_words(frames: Iterable[int], first: int) -> str:
    """Ascending frames with their noun: "frame 3", "frames 7–12"."""
    known = frames if isinstance(frames, range) else list(frames)
    return f"frame{'s' if len(known) > 1 else ''} {numbers(known, first)}"
