"""Whether the image agrees that a foot stays where it stands."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d

from fitting_core.camera import Camera
from fitting_core.frame_runs import runs_where
from fitting_core.ground.placing import rays_of

_SMOOTH = 0.25
"""Seconds over which keypoints are smoothed: their errors last a tenth of a second, some longer."""
_EXTENT = 0.03
"""Metres by which the smoothed keypoints of a fixed foot may range: the detectors' errors, by pose."""
_OF_NOISE = 3.0
"""Extra range, in standard deviations of what smoothing removes: so much of the noise remains."""
_SLOW, _LEAST = 0.06, 0.3
"""Metres per second, and seconds: a moving foot that is slower for so long stays in that place."""


def going_on(
    standing: Bool[np.ndarray, "T 2"],
    xy: Float[np.ndarray, "T 2 4 2"],
    certain: Float[np.ndarray, "T 2 4"],
    camera: Camera,
    feet: Float[np.ndarray, "T 2 4 3"],
    frame_rate: float,
) -> Bool[np.ndarray, "T 2"]:
    """Where a foot that is assumed to stand moves in the image, slowly or in circles.

    Args:
        standing: Whether a foot is assumed to stand.
        xy: Pixels: ankle, heel, big and small toe of the left and the right foot.
        certain: Their confidence.
        camera: Of the clip.
        feet: The same points in still space, metres.
        frame_rate: Frames per second.
    """
    found = np.zeros(standing.shape, bool)
    for foot in range(2):
        for run in runs_where(standing[:, foot]):
            track = _track(run, xy[:, foot], certain[:, foot], camera, feet[:, foot])
            found[run, foot] = ~_stays(track, frame_rate)
    return found


def _stays(track: Float[np.ndarray, "n 2"], frame_rate: float) -> Bool[np.ndarray, "n"]:
    """Frames in which a foot stays: all of them, or those between its moves."""
    smooth = gaussian_filter1d(track, _SMOOTH * frame_rate, axis=0, mode="nearest")
    allowed = _EXTENT + _OF_NOISE * (track - smooth).std(0).mean()
    if np.ptp(smooth, axis=0).max() <= allowed:
        return np.ones(len(track), bool)
    speed = np.linalg.norm(np.gradient(smooth, axis=0), axis=1) * frame_rate
    stays = np.zeros(len(track), bool)
    for part in runs_where(speed < _SLOW):
        stays[part] = len(part) >= _LEAST * frame_rate and np.ptp(smooth[part], axis=0).max() <= allowed
    return stays


def _track(
    run: range,
    xy: Float[np.ndarray, "T 4 2"],
    certain: Float[np.ndarray, "T 4"],
    camera: Camera,
    feet: Float[np.ndarray, "T 4 3"],
) -> Float[np.ndarray, "n 2"]:
    """Offset of a foot from its median place, metres across the line of sight, mean over its visible points."""
    place = camera.from_still(np.broadcast_to(np.median(feet[run], axis=0), feet.shape))[run]
    depth = np.maximum(place[..., 2:], 0.1)
    beside, weight = rays_of(xy[run], camera) * depth - place[..., :2], certain[run][..., None] + 1e-6
    return (beside * weight).sum(1) / weight.sum(1)
