"""Which frames are fitted again where some were edited."""

from collections.abc import Iterable


def around(frames: Iterable[int], reach: int, length: int) -> tuple[range, ...]:
    """Frames with their neighbours, as ranges that do not touch."""
    merged: list[range] = []
    for frame in sorted(frames):
        window = range(max(0, frame - reach), min(length, frame + reach + 1))
        if merged and window.start <= merged[-1].stop:
            merged[-1] = range(merged[-1].start, window.stop)
        else:
            merged.append(window)
    return tuple(merged)
