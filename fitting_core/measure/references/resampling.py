"""Resampling of reference points at a video's frames, for any clock and rate."""

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from fitting_core.frame_runs import runs_where
from fitting_core.measure.references.reference import Reference

_TINY = 1e-6
"""Of a frame: moments that are as near to a known one are it."""
_CUBIC = 4
"""Known frames in a row from which splines are laid through them; through fewer, lines."""


def interpolated(values: Float[np.ndarray, "T N D"], moments: Float[np.ndarray, "M"]) -> Float[np.ndarray, "M N D"]:
    """Values between frames; NaN before the first frame, behind the last one, and within gaps.

    Cubic splines through the known frames of each stretch without a gap. At 120 per second they leave less than 0.1 mm
    of a fast movement of the hand, where lines leave 0.4 mm.

    Args:
        values: NaN where nothing is known.
        moments: In frames, from 0.
    """
    found = np.full((len(moments), *values.shape[1:]), np.nan)
    known = np.isfinite(values).all(-1)
    patterns, owners = np.unique(known, axis=1, return_inverse=True)
    for i, pattern in enumerate(patterns.T):
        points = np.flatnonzero(owners.ravel() == i)
        for run in runs_where(pattern):
            inside = np.flatnonzero((moments >= run.start - _TINY) & (moments <= run.stop - 1 + _TINY))
            if len(inside):
                within = (moments[inside] - run.start).clip(0, len(run) - 1)
                found[np.ix_(inside, points)] = _between(values[run][:, points], within)
    return found


def _between(run: Float[np.ndarray, "T N D"], moments: Float[np.ndarray, "M"]) -> Float[np.ndarray, "M N D"]:
    if len(run) >= _CUBIC:
        from scipy.interpolate import CubicSpline  # the app need not wait for it

        return CubicSpline(np.arange(len(run)), run)(moments)
    below = np.floor(moments).astype(int).clip(0, max(len(run) - 2, 0))
    above = np.minimum(below + 1, len(run) - 1)
    share = (moments - below)[:, None, None]
    return (1 - share) * run[below] + share * run[above]


def at_frames_of(reference: Reference, frame_rate: float, *, start: float | None = None) -> Reference:
    """The same at the frames of a video.

    Args:
        reference: Of points alone it is interpolated; of a body, whose poses are not, the nearest frame counts.
        frame_rate: Frames per second of the video.
        start: Second of the video at which its first frame lies; None: as the reference says.
    """
    own_rate = reference.frame_rate or frame_rate
    begin = reference.first_frame / own_rate if start is None else start
    known = reference.first_frame_known or start is not None
    if reference.params is not None or reference.joints is not None:
        first = round(begin * own_rate)
        off = 1e3 * abs(first / own_rate - begin)
        note = f"Poses of a body are not interpolated: the reference is {off:.0f} ms off its place in time."
        notes = (*reference.notes, note) if off >= 1 else reference.notes
        return replace(reference, first_frame=first, first_frame_known=known, notes=notes)
    first = math.ceil(begin * frame_rate - _TINY)
    last = math.floor((begin + (len(reference) - 1) / own_rate) * frame_rate + _TINY)
    frames = np.arange(first, max(last, first) + 1)
    moments = (frames / frame_rate - begin) * own_rate
    places = None if reference.marker_places is None else interpolated(reference.marker_places, moments)
    return replace(
        reference,
        points=interpolated(reference.points, moments),
        marker_places=places,
        others={name: interpolated(points, moments) for name, points in reference.others.items()},
        frame_rate=frame_rate,
        first_frame=first,
        first_frame_known=known,
    )
