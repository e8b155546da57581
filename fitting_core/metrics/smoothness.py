"""How smoothly points move, by differences in time. Where there are too few frames for one, it is 0."""

import numpy as np
from jaxtyping import Float


def jitter(points: Float[np.ndarray, "T K 3"]) -> float:
    """Mean length of the second difference in time, in millimetres per frame^2 (points in metres)."""
    return 1e3 * _mean_length(points, 2)


def acceleration(points: Float[np.ndarray, "T K 3"], frame_rate: float) -> float:
    """Mean length of the acceleration, m/s^2 (points in metres, frames per second)."""
    return _mean_length(points, 2) * frame_rate**2


def jerk(points: Float[np.ndarray, "T K 3"], frame_rate: float) -> float:
    """Mean length of the third derivative, m/s^3: what the field calls jitter (points in metres)."""
    return _mean_length(points, 3) * frame_rate**3


def acceleration_error(
    estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"], frame_rate: float
) -> Float[np.ndarray, "T"]:
    """Mean distance between estimated and true acceleration, m/s^2; NaN for the first and the last frame.

    A. Kanazawa et al., Learning 3D Human Dynamics from Video, CVPR 2019, section 4.
    """
    errors = np.full(len(estimate), np.nan)
    if len(estimate) > 2:
        errors[1:-1] = np.linalg.norm(np.diff(estimate - truth, 2, axis=0), axis=-1).mean(1) * frame_rate**2
    return errors


def depth_jitter(points: Float[np.ndarray, "T K 3"], frame_rate: float) -> float:
    """Mean size of the points' common acceleration along the camera's z axis, m/s^2 (points in metres)."""
    return acceleration(points[..., 2].mean(1)[:, None, None], frame_rate)


def _mean_length(points: np.ndarray, order: int) -> float:
    if len(points) <= order:
        return 0.0
    return float(np.linalg.norm(np.diff(points, order, axis=0), axis=-1).mean())
