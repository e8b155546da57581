"""How far points lie from where they should be: joints, keypoints, vertices of one topology."""

import numpy as np
from jaxtyping import Float

from fitting_core.metrics.alignment import procrustes, rooted


def point_error(estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T"]:
    """Mean distance of each frame's points as they stand, in millimetres (points in metres)."""
    return 1e3 * np.linalg.norm(estimate - truth, axis=-1).mean(1)


def pa_mpjpe(estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T"]:
    """Mean joint error of each frame after Procrustes alignment, in millimetres (points in metres)."""
    return point_error(procrustes(estimate, truth), truth)


def mpjpe(
    estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"], roots: list[int]
) -> Float[np.ndarray, "T"]:
    """Mean joint error of each frame with the mean of `roots` aligned, in millimetres (points in metres)."""
    return point_error(rooted(estimate, roots), rooted(truth, roots))


def depth_error(estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T"]:
    """Difference of the points' mean distance along the camera's z axis, in millimetres (points in metres).

    Positive: the estimate is too far away.
    """
    return 1e3 * (estimate - truth)[..., 2].mean(1)
