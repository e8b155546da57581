"""Runs of consecutive frames, from their numbers or from a condition per frame."""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool


def runs(frames: Iterable[int]) -> list[range]:
    """Ascending frame numbers as runs that follow each other."""
    found: list[range] = []
    for frame in frames:
        if found and frame == found[-1].stop:
            found[-1] = range(found[-1].start, frame + 1)
        else:
            found.append(range(frame, frame + 1))
    return found


def runs_where(true: Bool[np.ndarray, "T"]) -> list[range]:
    """The longest runs of frames for which it is true, in order; frames count from 0."""
    return runs(np.flatnonzero(true).tolist())
