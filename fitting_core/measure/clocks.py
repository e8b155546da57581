"""The clock offset of a reference and a video, from the movement in both.

Distances between points show how a body moves, independently of world and camera. Those that change most in the fit are
correlated with the reference's at every offset (normalised, over what is known of both;
Padfield, 2012, "Masked object registration in the Fourier domain"), and the best offset is refined between frames.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.errors import InputError
from fitting_core.measure.pairing import PosedMotion, comparable
from fitting_core.measure.references.reference import Reference
from fitting_core.measure.references.resampling import interpolated

_DISTANCES = 60
"""Those that change most."""
_STILL = 0.01
"""Metres: least standard deviation of the distance that changes most."""
_LEAST_SHARE, _LEAST_SECONDS = 0.5, 1.0
"""Minimum overlap: fraction of the shorter recording, and seconds."""
_ALIKE = 0.7
"""Correlation below which it is another movement."""
_APART, _MARGIN = 1.5, 0.02
"""The runner-up's unexplained variance must exceed the best one's by this factor and this margin."""
_STEPS = 10
"""Into which a frame is divided before the parabola through the best three."""
_SHIFTS = np.arange(-2 * _STEPS, 2 * _STEPS + 1) / _STEPS
"""Frames from the best whole one."""
_BLOCKS = 4
"""Sub-intervals whose separate offsets give the standard error."""


@dataclass(frozen=True, kw_only=True)
class ClockOffset:
    """Where a reference lies in the time of a video."""

    seconds: float
    """Of the video, at which the reference's first frame was taken; below 0 if that was before."""
    deviation: float | None
    """Seconds: standard error, by parts of the clip; None where too few of them move."""
    correlation: float
    """Of distances, at this offset."""
    second: float
    """The same at the best of all other offsets."""

    @property
    def text(self) -> str:
        """In words."""
        sure = "" if self.deviation is None else f" (standard error {1e3 * self.deviation:.1f} ms)"
        return (
            f"The reference's clock was set by the movement: its first frame lies at {self.seconds:.4f} s of the "
            f"video{sure}; correlation {self.correlation:.3f}, at the next best offset {self.second:.3f}."
        )


def found_offset(estimate: PosedMotion, reference: Reference) -> ClockOffset:
    """When a reference begins, by its movement and the fit's. Raises InputError if too little moves, or other
    movements, or several offsets fit about as well.

    Args:
        estimate: The fit; its frames say when it is in the video.
        reference: At its own rate; where it says that it begins does not count.
    """
    fitted, true, _ = comparable(estimate, reference)
    rate, own_rate = estimate.frame_rate, reference.frame_rate or estimate.frame_rate
    ours, theirs = _moving_distances(reference.name, fitted, true)
    begin = estimate.first_frame / rate
    count = max(1, round((len(theirs) - 1) * rate / own_rate) + 1)
    coarse = interpolated(theirs[..., None], np.arange(count) * own_rate / rate)[..., 0]
    lag, second = _best_lag(reference.name, ours, coarse, rate)

    found, moments = begin - lag / rate, begin + np.arange(len(ours)) / rate
    common = np.flatnonzero((moments >= found) & (moments <= found + (len(theirs) - 1) / own_rate))
    edges = np.linspace(common[0], common[-1] + 1, _BLOCKS + 1).round().astype(int)
    stretches = [slice(None), *(slice(*ends) for ends in pairwise(edges))]
    scores = []
    for shift in _SHIFTS / rate:
        there = interpolated(theirs[..., None], (moments - found - shift) * own_rate)[..., 0]
        scores.append([_correlation(ours[stretch], there[stretch]) for stretch in stretches])
    whole, *parts = (_peak(course) for course in np.array(scores).T)
    shifts = [part.shift / rate for part in parts if part.correlation >= _ALIKE and part.inside]
    deviation = float(np.std(shifts, ddof=1) / np.sqrt(len(shifts))) if len(shifts) > 1 else None
    return ClockOffset(
        seconds=found + whole.shift / rate, deviation=deviation, correlation=whole.correlation, second=second
    )


def _moving_distances(
    name: str, fitted: Float[np.ndarray, "T K 3"], true: Float[np.ndarray, "R K 3"]
) -> tuple[Float[np.ndarray, "T P"], Float[np.ndarray, "R P"]]:
    """Between the pairs of points that move most against each other, in the fit and in the reference."""
    seen = np.isfinite(true).all(-1).mean(0) > 0
    a, b = np.triu_indices(fitted.shape[1], 1)
    both = seen[a] & seen[b]
    a, b = a[both], b[both]
    changes = np.array([_distances(fitted, i, j).std() for i, j in zip(a, b, strict=True)])
    chosen = np.argsort(-changes, kind="stable")[:_DISTANCES]
    if not len(chosen) or changes[chosen[0]] < _STILL:
        raise InputError(
            f"{name}: cannot estimate the time offset, because hardly anything moves in the fit; expected distances "
            "between its points that change. Say it with --reference-offset SECONDS."
        )
    a, b = a[chosen], b[chosen]
    return _distances(fitted, a, b), _distances(true, a, b)


def _distances(points: Float[np.ndarray, "T K 3"], a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, a] - points[:, b], axis=-1)


def _correlation(ours: Float[np.ndarray, "T P"], theirs: Float[np.ndarray, "T P"]) -> float:
    """Over all distances together, each from its own mean, where both are known."""
    known = np.isfinite(theirs)
    count = np.maximum(known.sum(0), 1)
    x, y = np.where(known, ours, 0.0), np.where(known, theirs, 0.0)
    x, y = np.where(known, x - x.sum(0) / count, 0.0), np.where(known, y - y.sum(0) / count, 0.0)
    scale = float(np.sqrt((x**2).sum() * (y**2).sum()))
    return float((x * y).sum()) / scale if scale > 0 else -1.0


def _best_lag(
    name: str, ours: Float[np.ndarray, "T P"], theirs: Float[np.ndarray, "R P"], rate: float
) -> tuple[int, float]:
    """The fit's first frame in the reference's frames at the same rate, and the second best one's correlation. Raises
    InputError if no offset fits, or several fit about as well."""
    scores, lags = _correlations(ours, theirs, rate)
    if not np.isfinite(scores).any():
        raise InputError(
            f"{name}: cannot estimate the time offset, because fit and reference have too little in common; expected "
            f"{_LEAST_SECONDS:g} s and half of the shorter one. Say it with --reference-offset SECONDS."
        )
    place = int(np.nanargmax(scores))
    others = np.where(_on_peak(scores, place), -np.inf, np.nan_to_num(scores, nan=-np.inf))
    other = int(others.argmax())
    best, second = float(scores[place]), max(float(others[other]), -1.0)
    if best < _ALIKE:
        raise InputError(
            f"{name}: cannot estimate the time offset, because no offset makes it move like the fit: the best has a "
            f"correlation of {best:.2f}; expected {_ALIKE:g} or more. Give the reference of this clip, or say the "
            "offset with --reference-offset SECONDS."
        )
    if 1 - second < _APART * (1 - best) + _MARGIN:
        apart = abs(lags[other] - lags[place]) / rate
        raise InputError(
            f"{name}: its offset in time is not clear, as in movements that repeat themselves: one has a correlation "
            f"of {best:.3f}, and another, {apart:.2f} s away, {second:.3f}. Say it with --reference-offset SECONDS, or "
            "compare more of the clip."
        )
    return int(lags[place]), second


def _correlations(
    ours: Float[np.ndarray, "T P"], theirs: Float[np.ndarray, "R P"], rate: float
) -> tuple[Float[np.ndarray, "L"], np.ndarray]:
    """For each lag, NaN where too little lies in both; what `_correlation` gives, of all lags at once."""
    from scipy.signal import fftconvolve  # with it comes scipy.stats, for which the app need not wait

    known = np.isfinite(theirs)
    middle = np.where(known, theirs, 0.0).sum(0) / np.maximum(known.sum(0), 1)
    x, y = ours - ours.mean(0), np.where(known, theirs - middle, 0.0)
    ones = np.ones(len(x))

    def summed(of_x: np.ndarray, of_y: np.ndarray) -> Float[np.ndarray, "L"]:
        return fftconvolve(of_y, of_x[::-1])

    lags = np.arange(-(len(x) - 1), len(y))
    product, ours_square, theirs_square, most = (np.zeros(len(lags)) for _ in range(4))
    for p in range(x.shape[1]):
        seen = known[:, p].astype(float)
        count = np.maximum(summed(ones, seen), 0.5)
        sum_x, sum_y = summed(x[:, p], seen), summed(ones, y[:, p])
        product += summed(x[:, p], y[:, p]) - sum_x * sum_y / count
        ours_square += np.maximum(summed(x[:, p] ** 2, seen) - sum_x**2 / count, 0.0)
        theirs_square += np.maximum(summed(ones, y[:, p] ** 2) - sum_y**2 / count, 0.0)
        most = np.maximum(most, count)
    least = max(_LEAST_SHARE * min(len(x), len(y)), _LEAST_SECONDS * rate)
    scale = np.sqrt(ours_square * theirs_square)
    valid = (most > least - 0.5) & (scale > 1e-6 * max(float(scale.max()), 1e-12))
    return np.where(valid, product / np.where(valid, scale, 1.0), np.nan), lags


def _on_peak(scores: Float[np.ndarray, "L"], place: int) -> Bool[np.ndarray, "L"]:
    """Lags from which the correlation only rises up to the best one."""
    found = np.zeros(len(scores), bool)
    found[place] = True
    for step in (-1, 1):
        at = place + step
        while 0 <= at < len(scores) and scores[at] <= scores[at - step]:
            found[at] = True
            at += step
    return found


class _Peak(NamedTuple):
    """The best of all shifts."""

    shift: float
    """Frames, between those of _SHIFTS by a parabola through the best three."""
    correlation: float
    inside: bool
    """Whether it lies between the first and the last shift."""


def _peak(scores: Float[np.ndarray, "S"]) -> _Peak:
    best = int(scores.argmax())
    if not 0 < best < len(scores) - 1:
        return _Peak(_SHIFTS[best], float(scores[best]), False)
    before, at, after = scores[best - 1 : best + 2]
    bend = before - 2 * at + after
    shift = 0.0 if bend >= 0 else 0.5 * (before - after) / bend
    return _Peak(_SHIFTS[best] + shift / _STEPS, float(at), True)
