"""Places the lifter's body in front of the camera."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, median_filter

from fitting_core.camera import Camera
from fitting_core.keypoints import SEEN
from fitting_core.lifting.clip_lifting import LiftedClip

_MEDIAN, _SMOOTH = 0.17, 0.07
"""Seconds: windows of the running median over the positions, and of the Gaussian after it."""
_LEAST_DEVIATION = 0.02
"""Metres."""
_RIDGE = 1e-9
"""Added to the diagonal of the normal equations, which are singular for frames without keypoints."""
NEAREST = 0.2
"""Metres: minimum depth of a pelvis in front of the camera."""


def rays_of(xy: Float[np.ndarray, "T n 2"], camera: Camera) -> Float[np.ndarray, "T n 2"]:
    """Viewing rays of pixels: (x / z, y / z) in camera space."""
    return (xy - np.array(camera.center)) / np.array(camera.focal)


def place_on_rays(
    points: Float[np.ndarray, "T n 3"], rays: Float[np.ndarray, "T n 2"], precision: Float[np.ndarray, "T n"]
) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T n"]]:
    """The translation t that puts points onto viewing rays, by weighted least squares.

    A point p translated by t is seen along the ray (u, v) = ((t_x + p_x) / (t_z + p_z), (t_y + p_y) / (t_z + p_z)).
    Multiplied by the depth this is linear in t, A t = b with two rows for each point:

        [1 0 -u] t = u p_z - p_x
        [0 1 -v] t = v p_z - p_y

    so t solves (A^T W A) t = A^T W b. A row's residual is the distance from the ray at the point's depth.

    Args:
        points: p, metres in camera axes.
        rays: (u, v), see `rays_of`.
        precision: Squared weights, the diagonal of W.

    Returns:
        t, metres in camera space, and each point's distance from its ray, metres.
    """
    rows = np.zeros((*rays.shape, 3))
    rows[..., 0, 0] = rows[..., 1, 1] = 1.0
    rows[..., 2] = -rays
    target = rays * points[..., 2:] - points[..., :2]
    weighted = rows * precision[..., None, None]
    normal = np.einsum("tnkp,tnkq->tpq", weighted, rows) + _RIDGE * np.eye(3)
    translation = np.linalg.solve(normal, np.einsum("tnkp,tnk->tp", weighted, target)[..., None])[..., 0]
    return translation, np.linalg.norm(np.einsum("tnkp,tp->tnk", rows, translation) - target, axis=-1)


def pelvis_positions(
    xy: Float[np.ndarray, "T K 2"],
    confidence: Float[np.ndarray, "T K"],
    lifted: LiftedClip,
    camera: Camera,
    frame_rate: float,
) -> Float[np.ndarray, "T 3"]:
    """The pelvis in camera space, metres, such that the lifter's points project onto their keypoints.

    Each frame by `place_on_rays`, then smoothed over time. Frames without enough keypoints are interpolated.

    Args:
        xy: Pixels, the first 25 of K are BODY_25.
        confidence: 0 for missing keypoints.
        lifted: The lifter's result for them.
        camera: Of the clip.
        frame_rate: Frames per second.
    """
    points = lifted.points
    count = points.shape[1]
    rays, certain = rays_of(xy[:, :count], camera), confidence[:, :count]
    weight = np.where(certain > SEEN, certain, 0.0) / np.maximum(lifted.depth_deviation, _LEAST_DEVIATION)
    found, _ = place_on_rays(points, rays, weight**2)
    usable = ((weight > 0).sum(1) >= 4) & (found[:, 2] > NEAREST)
    if not usable.any():
        return np.tile([0.0, 0.0, 1.0], (len(points), 1))
    frames = np.arange(len(points))
    filled = np.stack([np.interp(frames, frames[usable], column[usable]) for column in found.T], 1)
    width = 2 * round(_MEDIAN * frame_rate / 2) + 1
    return gaussian_filter1d(median_filter(filled, (width, 1), mode="nearest"), _SMOOTH * frame_rate, 0, mode="nearest")
