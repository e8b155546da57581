"""Where the body that the lifter tells of stands before the camera."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, median_filter

from fitting_core.camera import Camera
from fitting_core.keypoints import SEEN
from fitting_core.lifting.clip_lifting import LiftedClip

_MEDIAN, _SMOOTH = 0.17, 0.07
"""Seconds: of the running median over the places, and of the Gaussian after it."""
_LEAST_DEVIATION = 0.02
"""Metres."""
_HARDLY = 1e-9
"""Added to the diagonal: frames of which nothing is seen have a solution too."""
NEAREST = 0.2
"""Metres from the camera to the pelvis of a body that is before it."""


def rays_of(xy: Float[np.ndarray, "T n 2"], camera: Camera) -> Float[np.ndarray, "T n 2"]:
    """x / z and y / z in camera space of pixels."""
    return (xy - np.array(camera.center)) / np.array(camera.focal)


def behind(
    points: Float[np.ndarray, "T n 3"], rays: Float[np.ndarray, "T n 2"], precision: Float[np.ndarray, "T n"]
) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T n"]]:
    """Where the origin of points must stand to be seen along rays, by weighted least squares.

    A point p of a body at t is seen along ray (u, v) = ((t_x + p_x) / (t_z + p_z), ...), which is linear in t:
    t_x - u t_z = u p_z - p_x, and so for y and v.

    Args:
        points: From their origin, metres in camera axes.
        rays: x / z and y / z in camera space, see `rays_of`.
        precision: Squared weights.

    Returns:
        t, metres in camera space, and how far each point lies off its ray at the point's depth, metres.
    """
    rows = np.zeros((*rays.shape, 3))
    rows[..., 0, 0] = rows[..., 1, 1] = 1.0
    rows[..., 2] = -rays
    wanted = rays * points[..., 2:] - points[..., :2]
    weighted = rows * precision[..., None, None]
    normal = np.einsum("tnkp,tnkq->tpq", weighted, rows) + _HARDLY * np.eye(3)
    found = np.linalg.solve(normal, np.einsum("tnkp,tnk->tp", weighted, wanted)[..., None])[..., 0]
    return found, np.linalg.norm(np.einsum("tnkp,tp->tnk", rows, found) - wanted, axis=-1)


def places(
    xy: Float[np.ndarray, "T K 2"],
    confidence: Float[np.ndarray, "T K"],
    lifted: LiftedClip,
    camera: Camera,
    frame_rate: float,
) -> Float[np.ndarray, "T 3"]:
    """The pelvis in camera space, metres, such that the lifter's points lie behind their keypoints.

    Of each frame by weighted least squares, which is linear, then smoothed over time. Frames that show nothing are
    filled from their neighbours.

    Args:
        xy: Pixels, the first 25 of K are BODY_25.
        confidence: 0 for what is not seen.
        lifted: What the lifter made of them.
        camera: Of the clip.
        frame_rate: Frames per second.
    """
    points = lifted.points
    count = points.shape[1]
    rays, certain = rays_of(xy[:, :count], camera), confidence[:, :count]
    weight = np.where(certain > SEEN, certain, 0.0) / np.maximum(lifted.depth_deviation, _LEAST_DEVIATION)
    found, _ = behind(points, rays, weight**2)
    usable = ((weight > 0).sum(1) >= 4) & (found[:, 2] > NEAREST)
    if not usable.any():
        return np.tile([0.0, 0.0, 1.0], (len(points), 1))
    frames = np.arange(len(points))
    filled = np.stack([np.interp(frames, frames[usable], column[usable]) for column in found.T], 1)
    width = 2 * round(_MEDIAN * frame_rate / 2) + 1
    return gaussian_filter1d(median_filter(filled, (width, 1), mode="nearest"), _SMOOTH * frame_rate, 0, mode="nearest")
