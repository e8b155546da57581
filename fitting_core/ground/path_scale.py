"""The unit of a moving camera's path if its file does not state it: a standing person stays in place."""

import numpy as np
from jaxtyping import Bool, Float

from fitting_core import keypoints as kp
from fitting_core.camera import Camera, PathScale
from fitting_core.ground.contacts import FOOT_POINTS
from fitting_core.ground.placing import pelvis_positions
from fitting_core.keypoints import SEEN
from fitting_core.lifting.clip_lifting import LiftedClip, lift

_TRUNK = [kp.INDEX["mid_hip"], kp.INDEX["neck"]]
_EXTENTS = np.geomspace(0.01, 100.0, 400)
"""Possible extents of the path in metres."""
_LAG = 0.2
"""Seconds after which a point is compared again."""
_FOOT, _BODY = 0.03, 0.08
"""Apparent motion in metres over that time, across the line of sight, of a standing foot or a resting trunk."""
_DEPTH = 0.2
"""The same along it. Set, with the three before, on 14 of the motion suite's tuning windows before three cameras."""
_FEET_SEEN = 0.5
"""Share of the frames in which feet must be seen; otherwise the trunk is used."""
_OF_SIZE, _OF_TRUNK = 0.1, 0.17
"""Log deviation that remains however long the path is: the person's height is not known, and trunks sway with a camera
that circles them."""
_UNSURE = 0.6
"""Log deviation above which there is no result, as in 5 of 84 clips with feet, whose likeliest scale is wrong by up to
a factor of 50; in the others by up to 1.4."""
_STILL = 1e-9
"""Minimum extent of a path, in its units."""


def estimate_path_scale(
    xy: Float[np.ndarray, "T K 2"], confidence: Float[np.ndarray, "T K"], camera: Camera, frame_rate: float
) -> PathScale | None:
    """The scale factor of a path at which the feet of a person of usual size stand still.

    In still space a point at x before a camera at s p(t) is at R(t) x(t) + s p(t). For each s, the point that moves
    least in each frame, one of two feet, should hardly move; a heavy-tailed likelihood (Cauchy's) forgives steps,
    jumps, and what lies on the floor. If no feet are seen, the trunk replaces them.

    Args:
        xy: Pixels, the first 25 of K are BODY_25.
        confidence: 0 for what is not seen.
        camera: With its path, its unit taken as a metre.
        frame_rate: Frames per second.

    Returns:
        None if the camera only rotates, or too little is seen of a person at rest.
    """
    path, lag = camera.path, max(1, round(_LAG * frame_rate))
    if path is None or len(xy) <= lag or (extent := float(np.ptp(path.places, axis=0).max())) < _STILL:
        return None
    lifted = lift(xy, confidence, camera, frame_rate, calibrated=camera.calibrated)
    feet, standing = _feet(lifted, confidence)
    by_feet = standing.any(1).mean() >= _FEET_SEEN
    points, seen = (feet, standing) if by_feet else (lifted.points[:, _TRUNK], confidence[:, _TRUNK] > SEEN)
    placed = camera.turned_to_still(points + pelvis_positions(xy, confidence, lifted, camera, frame_rate)[:, None])
    both = seen[lag:] & seen[:-lag]
    if not both.any():
        return None
    # Unit vectors from the camera to the point, mean of both frames: along them the lifter is less accurate.
    sight = placed[lag:] + placed[:-lag]
    sight /= np.maximum(np.linalg.norm(sight, axis=-1, keepdims=True), _STILL)
    moved = placed[lag:] - placed[:-lag]
    carried = np.broadcast_to((path.places[lag:] - path.places[:-lag])[:, None], moved.shape)
    across = _FOOT if by_feet else _BODY
    own, of_unit = _in_deviations(moved, sight, across), _in_deviations(carried, sight, across)
    scales = _EXTENTS / extent
    # |own + s of_unit|² for all scales at once.
    square = (
        (own**2).sum(-1)
        + 2 * scales[:, None, None] * (own * of_unit).sum(-1)
        + scales[:, None, None] ** 2 * (of_unit**2).sum(-1)
    )
    least = np.where(both, square, np.inf).min(-1)[:, both.any(1)]
    cost = np.log1p(least).sum(1) / lag  # overlapping intervals are one observation
    # A posterior over log scales with a flat prior; its spread is the error of the scale.
    likely = np.exp(cost.min() - cost)
    likely /= likely.sum()
    logs = np.log(scales)
    spread = float(np.sqrt((likely * (logs - likely @ logs) ** 2).sum()))
    if spread > _UNSURE:
        return None
    deviation = float(np.hypot(spread, _OF_SIZE if by_feet else _OF_TRUNK))
    by = "feet that stand" if by_feet else "a trunk that rests"
    return PathScale(metres=float(scales[cost.argmin()]), deviation=deviation, by=by)


def _feet(
    lifted: LiftedClip, confidence: Float[np.ndarray, "T K"]
) -> tuple[Float[np.ndarray, "T 2 3"], Bool[np.ndarray, "T 2"]]:
    """The mean of each foot's visible points from the pelvis, metres; and whether enough are visible."""
    certain = np.where(confidence[:, FOOT_POINTS] > SEEN, confidence[:, FOOT_POINTS], 0.0)
    weight = (certain + _STILL)[..., None]
    return (lifted.points[:, FOOT_POINTS] * weight).sum(2) / weight.sum(2), (certain > 0).sum(-1) >= 2


def _in_deviations(
    way: Float[np.ndarray, "T n 3"], sight: Float[np.ndarray, "T n 3"], across: float
) -> Float[np.ndarray, "T n 3"]:
    along = (way * sight).sum(-1, keepdims=True) * sight
    return (way - along) / across + along / _DEPTH
