"""Offsets in time at which two views may show the same motion, from the lifter's bodies."""

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.fit.views.track import Track

_RATE = 30.0
"""Bodies per second that are compared."""
_CANDIDATES = 6
_APART = 0.15
"""Seconds between candidates, at least."""
_VELOCITY = 0.3
"""Seconds: how far a body moves in that time counts as much as where it is."""
_LEAST_OVERLAP = 1.5
"""Seconds; half of the shorter clip if that is less."""


def candidates(first: Track, other: Track) -> list[tuple[float, Float[np.ndarray, "3 3"]]]:
    """The likeliest offsets in seconds, best first, with the rotation of the first camera's axes into the other's.

    For each offset the rotation that brings the bodies of both views together leaves the squared error

        sum |a|^2 + sum |b|^2 - 2 (s_1 + s_2 +- s_3)

    with s the singular values of sum b a^T (P. Schoenemann, Psychometrika 31, 1966); all sums are correlations over
    time, so the Fourier transform gives them for all offsets at once.
    """
    a, b = _bodies(first), _bodies(other)
    frames = _correlated(np.ones((len(a), 1)), np.ones((len(b), 1)))[:, 0].round()
    square_a, square_b = ((points**2).sum((1, 2))[:, None] for points in (a, b))
    sizes = _correlated(square_a, np.ones((len(b), 1))) + _correlated(np.ones((len(a), 1)), square_b)
    products = np.zeros((len(frames), 3, 3))
    for row in range(3):
        for column in range(3):
            products[:, row, column] = _correlated(a[..., column], b[..., row]).sum(1)
    u, s, vt = np.linalg.svd(products)
    sign = np.linalg.det(u @ vt)
    error = (sizes[:, 0] - 2 * (s[:, 0] + s[:, 1] + sign * s[:, 2])) / np.maximum(frames, 1)
    least = min(_LEAST_OVERLAP, 0.5 * min(first.duration, other.duration)) * _RATE
    error[frames < least] = np.inf
    offsets = np.arange(-(len(a) - 1), len(b)) / _RATE
    found: list[tuple[float, Float[np.ndarray, "3 3"]]] = []
    for i in np.argsort(error):
        if len(found) == _CANDIDATES or not np.isfinite(error[i]):
            break
        if all(abs(offsets[i] - offset) >= _APART for offset, _ in found):
            found.append((float(offsets[i]), u[i] @ np.diag([1.0, 1.0, sign[i]]) @ vt[i]))
    return found


def _bodies(track: Track) -> Float[np.ndarray, "F n 3"]:
    """Limbs around their middle, and their velocities, at _RATE."""
    times = np.arange(int(track.duration * _RATE) + 1) / _RATE
    points = track.lifted.points[:, kp.LIMBS].reshape(len(track.times), -1)
    points = np.stack([np.interp(times, track.times, column) for column in points.T], 1).reshape(len(times), -1, 3)
    points = points - points.mean(1, keepdims=True)
    if len(points) < 2:
        return points
    return np.concatenate([points, np.gradient(points, axis=0) * _RATE * _VELOCITY], 1)


def _correlated(a: Float[np.ndarray, "A n"], b: Float[np.ndarray, "B n"]) -> Float[np.ndarray, "O n"]:
    """sum over t of a[t] b[t + o], for offsets o from -(A - 1) to B - 1."""
    size = 1 << (len(a) + len(b)).bit_length()
    product = np.fft.irfft(np.fft.rfft(a, size, axis=0).conj() * np.fft.rfft(b, size, axis=0), size, axis=0)
    return np.concatenate([product[size - (len(a) - 1) :], product[: len(b)]])
