"""Which foot stands still on the ground, from keypoints, the lifter, and the feet's positions in space."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d

from fitting_core import keypoints as kp
from fitting_core.camera import Camera
from fitting_core.frame_runs import runs_where
from fitting_core.ground.gravity import Gravity
from fitting_core.ground.placing import pelvis_positions, rays_of
from fitting_core.keypoints import SEEN, SIDES
from fitting_core.lifting.clip_lifting import LiftedClip, lift
from fitting_core.video.frame_names import spans

PARTS = ("ankle", "heel", "big_toe", "small_toe")
FOOT_POINTS = np.array([[kp.INDEX[f"{side}_{part}"] for part in PARTS] for side in SIDES])
"""BODY_25 keypoints of the left and the right foot."""

_SMOOTH = 0.05
"""Seconds over which keypoints are smoothed before their speed is taken."""
_FLOOR, _STILL = 0.05, 0.31
"""Metres per second: added for detection noise, and the sum at which a speed is neutral evidence."""
_OF_LIFTER, _OF_SPEED, _OF_HEIGHT = 0.9, 2.0, 6.0
"""Weights of the evidence in the log-odds: the lifter's own, log speed, metres above the lowest foot. The first two are
from a logistic regression on the motion suite's tuning half. Height adds nothing there, where hardly anybody holds a
raised foot still; a foot held so stands on nothing."""
_ANKLE = 0.09
"""Height in metres of an ankle above its sole."""
_STEP = 0.005
"""Shortest path in metres of a camera for its motion to count."""
_LOW, _HIGH = 0.1, 0.6
"""Metres above the lowest foot between which height counts increasingly against a contact."""
_ENTER, _STAY = 0.6, 0.4
"""Probabilities at which a foot starts standing, and above which it keeps standing."""
_SMOOTH_TRACK = 0.25
"""Seconds over which keypoints are smoothed: their errors last a tenth of a second, some longer."""
_EXTENT = 0.03
"""Metres by which the smoothed keypoints of a fixed foot may range: the detectors' errors, by pose."""
_OF_NOISE = 3.0
"""Extra range, in standard deviations of what smoothing removes: so much of the noise remains."""
_SLOW, _LEAST = 0.06, 0.3
"""A foot slower than this (m/s) for at least this long (s) is standing."""
_GAP, _SHORTEST = 0.12, 0.1
"""Seconds: shorter gaps are closed, shorter contacts dropped."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Contacts:
    """For each frame and the left and the right foot."""

    probability: Float[np.ndarray, "T 2"]
    """That it stands still on the ground; 0 if it is not in the image."""
    standing: Bool[np.ndarray, "T 2"]
    """Whether it stands: the probability thresholded, without short gaps and flicker, and without `let_go`."""
    let_go: Bool[np.ndarray, "T 2"]
    """Where the probability says that it stands but it moves in the image: on a board, on a turntable, or before a
    camera whose rotation is not known."""

    def __getitem__(self, frames: slice) -> Self:
        """The same for consecutive frames."""
        chosen = {name: getattr(self, name)[frames] for name in ("probability", "standing", "let_go")}
        return replace(self, **chosen)

    @property
    def seen(self) -> Bool[np.ndarray, "T 2"]:
        """Whether it is in the image."""
        return self.probability > 0

    @property
    def points(self) -> np.ndarray:
        """BODY_25 keypoints of each foot, (2, 4): ankle, heel, big toe, small toe."""
        return FOOT_POINTS

    @property
    def share(self) -> float:
        """Share of frames in which a foot stands."""
        return float(self.standing.any(1).mean()) if len(self.standing) else 0.0

    @property
    def let_go_share(self) -> float:
        """Share of frames in which a foot is let go."""
        return float(self.let_go.any(1).mean()) if len(self.let_go) else 0.0

    def let_go_in_words(self, first_frame: int) -> str:
        """Which feet are let go in which frames of the video, for the user; empty if none."""
        found = (
            f"{side} {spans((first_frame + np.flatnonzero(gone)).tolist())}"
            for side, gone in zip(SIDES, self.let_go.T, strict=True)
            if gone.any()
        )
        return ", ".join(found)


def contacts_of(
    xy: Float[np.ndarray, "T K 2"],
    confidence: Float[np.ndarray, "T K"],
    lifted: LiftedClip,
    gravity: Gravity,
    camera: Camera,
    frame_rate: float,
    feet: Float[np.ndarray, "T 2 4 3"],
) -> Contacts:
    """Contacts if the feet's points are known in space, from the lifter or a fitted body.

    Args:
        xy: Pixels, the first 25 of K are BODY_25.
        confidence: 0 for what is not seen or is cut off by the image, as in `Observations.lifted`.
        lifted: The lifter's result for them.
        gravity: Of the clip.
        camera: Of the clip.
        frame_rate: Frames per second.
        feet: Still space, metres: points as in FOOT_POINTS.
    """
    certain = np.where(confidence[:, FOOT_POINTS] > SEEN, confidence[:, FOOT_POINTS], 0.0)
    seen = (certain[..., 0] > 0) | ((certain > 0).sum(-1) >= 2)
    speed = _speed(xy[:, FOOT_POINTS], certain, camera, camera.from_still(feet)[..., 2], frame_rate)
    heights = _heights(feet, gravity, seen) if gravity.sure else np.zeros(seen.shape)
    # Log odds add up: the lifter's, a foot slower or faster than _STILL, and a foot above the lowest one.
    odds = (
        _OF_LIFTER * _log_odds(_contact(xy, confidence, lifted, camera, frame_rate))
        + _OF_SPEED * np.log(_STILL / (speed + _FLOOR))
        - _OF_HEIGHT * np.clip(heights - _LOW, 0.0, _HIGH - _LOW)
    )
    probability = np.where(seen, 1 / (1 + np.exp(-odds)), 0.0)
    standing = decided(probability, frame_rate)
    let_go = _going_on(standing, xy[:, FOOT_POINTS], certain, camera, feet, frame_rate)
    return Contacts(probability=probability, standing=standing & ~let_go, let_go=let_go)


def _contact(
    xy: Float[np.ndarray, "T K 2"],
    confidence: Float[np.ndarray, "T K"],
    lifted: LiftedClip,
    camera: Camera,
    frame_rate: float,
) -> Float[np.ndarray, "T 2"]:
    """The lifter's probabilities; it knows only static cameras, so for a moving one its path is first removed.

    Around a dancer, a quarter of a circle in 3 s, 30 % of the contacts were found without that, and 95 % with it.
    """
    if camera.path is None or np.ptp(camera.path.places, axis=0).max() < _STEP:
        return lifted.contact
    depth = lifted.points[..., 2] + pelvis_positions(xy, confidence, lifted, camera, frame_rate)[:, 2:]
    return lift(xy, confidence, camera, frame_rate, calibrated=camera.calibrated, depth=np.maximum(depth, 0.2)).contact


def _log_odds(probability: np.ndarray) -> np.ndarray:
    clipped = np.clip(probability, 1e-3, 1 - 1e-3)
    return np.log(clipped / (1 - clipped))


def _speed(
    xy: Float[np.ndarray, "T 2 4 2"],
    certain: Float[np.ndarray, "T 2 4"],
    camera: Camera,
    depth: Float[np.ndarray, "T 2 4"],
    frame_rate: float,
) -> Float[np.ndarray, "T 2"]:
    """Metres per second across the line of sight in still space, mean over each foot's visible points."""
    if len(xy) < 2:
        return np.full(xy.shape[:2], _STILL - _FLOOR)
    # Smoothing is weighted by confidence, so points unseen in a frame come from its neighbours.
    weight = certain + 1e-6
    # A point at depth z whose ray (x / z, y / z) moves by v per second moves by z v across the line of sight.
    rays, depth = rays_of(xy, camera), np.maximum(depth, 0.0)
    if camera.path is None:
        speeds = np.linalg.norm(_velocity(rays, weight, frame_rate), axis=-1) * depth
    else:
        there = camera.to_still(np.concatenate([rays, np.ones_like(depth)[..., None]], -1) * depth[..., None])
        ahead = there - camera.path.places[:, None, None]
        ahead /= np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-6)
        velocity = _velocity(there, weight, frame_rate)
        speeds = np.linalg.norm(velocity - (velocity * ahead).sum(-1, keepdims=True) * ahead, axis=-1)
    return (speeds * weight).sum(-1) / weight.sum(-1)


def _velocity(
    values: Float[np.ndarray, "T 2 4 n"], weight: Float[np.ndarray, "T 2 4"], frame_rate: float
) -> Float[np.ndarray, "T 2 4 n"]:
    sigma = _SMOOTH * frame_rate
    level = gaussian_filter1d(weight, sigma, axis=0, mode="nearest")
    smooth = gaussian_filter1d(values * weight[..., None], sigma, axis=0, mode="nearest") / level[..., None]
    return np.gradient(smooth, axis=0) * frame_rate


def _heights(
    feet: Float[np.ndarray, "T 2 4 3"], gravity: Gravity, seen: Bool[np.ndarray, "T 2"]
) -> Float[np.ndarray, "T 2"]:
    """Metres of each foot's lowest point above the lowest foot of the clip; the ankle counts as its sole."""
    along = feet @ gravity.up
    # The 5th percentile, not the minimum: one wrong frame must not lower the floor.
    lowest = np.minimum(along[..., 0] - _ANKLE, along[..., 1:].min(-1))
    return lowest - (np.percentile(lowest[seen], 5) if seen.any() else 0.0)


def decided(probability: Float[np.ndarray, "T 2"], frame_rate: float) -> Bool[np.ndarray, "T 2"]:
    """Hysteresis with two thresholds; short gaps are closed where the foot is seen, and short contacts dropped."""
    found = np.zeros(probability.shape, bool)
    for foot, values in enumerate(probability.T):
        stands = False
        for frame, value in enumerate(values):
            stands = value > (_STAY if stands else _ENTER)
            found[frame, foot] = stands
        for value, seconds in ((False, _GAP), (True, _SHORTEST)):
            for run in runs_where(found[:, foot] == value):
                inside = run.start > 0 and run.stop < len(values)
                if inside and len(run) < seconds * frame_rate and (value or (values[run] > 0).all()):
                    found[run, foot] = not value
    return found


def _going_on(
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
    smooth = gaussian_filter1d(track, _SMOOTH_TRACK * frame_rate, axis=0, mode="nearest")
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
