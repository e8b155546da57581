"""Frames of a video and its time in milliseconds: frame f is shown from f / rate seconds on until the next one is."""

import math

_ROUNDING = 0.5
"""Milliseconds by which a whole number of them may be off."""
_TINY = 1e-6


def milliseconds_of(frames: range, frame_rate: float) -> tuple[int, int]:
    """When frames begin to be shown, and when they end.

    Args:
        frames: Their numbers in the video, at least one.
        frame_rate: Frames per second.
    """
    return round(1000 * frames.start / frame_rate), round(1000 * frames.stop / frame_rate)


def frames_of(start: float, end: float, frame_rate: float) -> range:
    """The frames that are shown in a stretch of time, at least one: what `milliseconds_of` gives, comes back.

    Args:
        start: Milliseconds.
        end: Milliseconds.
        frame_rate: Frames per second.
    """
    first = math.floor((start + _ROUNDING) * frame_rate / 1000 + _TINY)
    stop = math.ceil((end - _ROUNDING) * frame_rate / 1000 - _TINY)
    return range(first, max(stop, first + 1))
