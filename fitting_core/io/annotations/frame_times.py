"""Frames of a video and their time in milliseconds: frame f is shown from f / rate seconds until the next one."""

import math

_ROUNDING = 0.5
"""Rounding error of a whole number of milliseconds."""
_TINY = 1e-6


def milliseconds_of(frames: range, frame_rate: float) -> tuple[int, int]:
    """When frames begin to be shown, and when they end.

    Args:
        frames: Their numbers in the video, at least one.
        frame_rate: Frames per second.
    """
    return round(1000 * frames.start / frame_rate), round(1000 * frames.stop / frame_rate)


def frames_of(start: float, end: float, frame_rate: float) -> range:
    """The frames shown in a stretch of time, at least one; the inverse of `milliseconds_of`.

    Args:
        start: Milliseconds.
        end: Milliseconds.
        frame_rate: Frames per second.
    """
    first = math.floor((start + _ROUNDING) * frame_rate / 1000 + _TINY)
    stop = math.ceil((end - _ROUNDING) * frame_rate / 1000 - _TINY)
    return range(first, max(stop, first + 1))
