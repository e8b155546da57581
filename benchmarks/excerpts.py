"""Clips made of the frames of another one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Int

from fitting_core.clip import Clip


def picked(clip: Clip, frames: Sequence[int] | Int[np.ndarray, "n"]) -> Clip:
    """The clip made of these frames alone, in this order."""
    chosen = np.asarray(frames)
    return replace(clip, keypoints=clip.keypoints[chosen], camera=clip.camera[chosen.tolist()])


def mirrored(clip: Clip, base: int, frames: int) -> Clip:
    """A clip of `frames` frames that plays the first `base` frames forwards, backwards, forwards, ...

    So clips of different length show the same images equally often, and differ in nothing but their length.
    """
    there_and_back = np.concatenate([np.arange(base), np.arange(base)[::-1]])
    return picked(clip, np.resize(there_and_back, frames))
