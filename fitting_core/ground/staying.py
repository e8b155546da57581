"""Whether the image agrees that a foot stays where it stands."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d

from fitting_core.camera import Camera
from fitting_core.frame_runs import runs_where
from fitting_core.ground.placing import rays_of

_SMOOTH = 0.25
"""Seconds over which keypoints are smoothed: their errors last for a tenth of a second, and some for longer."""
_EXTENT = 0.06
"""Metres that the keypoints of a foot that stays may go, from one end to the other."""


def going_on(
    standing: Bool[np.ndarray, "T 2"],
    xy: Float[np.ndarray, "T 2 4 2"],
    certain: Float[np.ndarray, "T 2 4"],
    camera: Camera,
    feet: Float[np.ndarray, "T 2 4 3"],
    frame_rate: float,
) -> Bool[np.ndarray, "T 2"]:
    """Where a foot that is taken to stand goes on in the image, slowly or in circles.

    Args:
        standing: Whether a foot is taken to stand.
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
            smooth = gaussian_filter1d(track, _SMOOTH * frame_rate, axis=0, mode="nearest")
            found[run, foot] = np.ptp(smooth, axis=0).max() > _EXTENT
    return found


def _track(
    run: range,
    xy: Float[np.ndarray, "T 4 2"],
    certain: Float[np.ndarray, "T 4"],
    camera: Camera,
    feet: Float[np.ndarray, "T 4 3"],
) -> Float[np.ndarray, "n 2"]:
    """How far a foot is seen beside its middle place, metres across the line of sight, mean of what is seen of it."""
    place = camera.from_still(np.broadcast_to(np.median(feet[run], axis=0), feet.shape))[run]
    depth = np.maximum(place[..., 2:], 0.1)
    beside, weight = rays_of(xy[run], camera) * depth - place[..., :2], certain[run][..., None] + 1e-6
    return (beside * weight).sum(1) / weight.sum(1)
