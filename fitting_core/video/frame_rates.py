"""Frame rates of two recordings of one motion: which mean the same although their numbers differ."""

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
