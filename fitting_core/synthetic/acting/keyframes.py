"""Keyframes: values at some times, and smooth motion through them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

Key = tuple[float, Sequence[float] | np.ndarray]
"""A time in seconds and the value there."""


def through(keys: Sequence[Key], times: Float[np.ndarray, "T"], *, smoothing: float = 0.04) -> Float[np.ndarray, "T D"]:
    """Values at `times` (seconds, evenly spaced) of a smooth path through the keys, held before and after them.

    Between keys the path is a monotone cubic: it rests where two neighbouring keys agree or where it turns back,
    and never overshoots. A Gaussian of `smoothing` seconds then takes the jumps out of its acceleration, as muscles
    would; it rounds a key of that length off.
    """
    at = np.array([time for time, _ in keys])
    values = np.array([value for _, value in keys], float)
    assert (np.diff(at) > 0).all(), "keys must be in the order of time"
    if len(keys) == 1:
        return np.tile(values, (len(times), 1))
    path = PchipInterpolator(at, values)(np.clip(times, at[0], at[-1]))
    if len(times) < 2 or smoothing == 0:
        return path
    return gaussian_filter1d(path, smoothing / (times[1] - times[0]), axis=0, mode="nearest")


def directions_through(
    keys: Sequence[Key], times: Float[np.ndarray, "T"], *, smoothing: float = 0.04
) -> Float[np.ndarray, "T 3"]:
    """Unit vectors on a smooth path through the keys' directions; neighbouring keys must not be opposite."""
    units = [(time, np.asarray(value, float) / np.linalg.norm(value)) for time, value in keys]
    path = through(units, times, smoothing=smoothing)
    return path / np.linalg.norm(path, axis=1, keepdims=True)


def wander(
    rng: np.random.Generator, times: Float[np.ndarray, "T"], size: int, *, seconds: float
) -> Float[np.ndarray, "T size"]:
    """Smooth random motion of unit variance whose values are alike over about that many seconds."""
    step = times[1] - times[0] if len(times) > 1 else 1.0
    sigma = seconds / step
    margin = int(4 * sigma) + 1
    noise = gaussian_filter1d(rng.standard_normal((len(times) + 2 * margin, size)), sigma, axis=0)
    # A Gaussian of width sigma leaves 1 / (2 sqrt(pi) sigma) of white noise's variance (a narrow one leaves all).
    return noise[margin : margin + len(times)] * np.sqrt(max(1.0, 2 * np.sqrt(np.pi) * sigma))
