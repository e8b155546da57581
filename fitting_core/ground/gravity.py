"""Which way is up in a clip.

The lifter was trained on level cameras, so a rolled camera looks to it like a leaning person. Leaning people were rare
in training, so it is less certain of them. It therefore runs again on the image rotated about its centre: the rotations
with the highest certainty give the camera's roll.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core.camera import Camera, path_of
from fitting_core.ground.placing import rays_of
from fitting_core.keypoints import SEEN
from fitting_core.lifting.clip_lifting import LiftedClip, lift

_LEGS = [kp.INDEX[f"{side}_{part}"] for side in ("left", "right") for part in ("knee", "ankle")]
_ROUNDS = 10
_NOTHING = 1e-6
_INLIER = 8.0
"""Degrees from the clip's direction within which a frame has full weight."""
_WITH_LEGS, _WITHOUT_LEGS = 2.0, 8.0
_OF_LENGTH = 0.4
"""Share of the deviation in degrees that a vector's length stands for."""
_OF_MOVE = 0.25
"""Factor on the degrees by which rotations move up, as they are held back by what is usual. Set with the three before
so that on the motion suite's tuning half the errors match the stated deviation, level or rolled by 5 to 35 degrees."""

SURE = 10.0
"""Degrees of standard deviation up to which gravity is used."""
_ROLLS = range(-40, 41, 10)
"""Degrees by which the image is rotated."""
_SECONDS = 3.2
"""Frames in the middle of the clip on which the lifter runs again: two windows, about 0.3 s."""
_ROLLED = 7.0
"""Degrees: mean roll of cameras."""
_OF_DEPTH, _OF_SPREAD = 30.0, 200.0
"""Weights in the log-odds of a rotation: of the log of the lifter's depth deviations, and of 1 - |up|². A conditional
logit on the motion suite's tuning half, whose cameras are level, gave somewhat larger ones."""
_OF_CALIBRATION = 0.5
"""Degrees by which a world's axis is off gravity: a board on a floor is hardly more level."""
_LEAN, _UPRIGHT = 12.0, 15.0
"""Degrees: lean of an upright person's trunk, and distance from the lifter's direction at which its weight halves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Gravity:
    """One direction for a whole clip, as the camera is still."""

    up: Float[np.ndarray, "3"]
    """Against gravity: a unit vector in camera axes (x right, y down, z away)."""
    deviation: float
    """Standard deviation of its direction, degrees."""

    @property
    def sure(self) -> bool:
        """Whether it is used: for the floor, and to level worlds."""
        return self.deviation < SURE

    @property
    def tilt(self) -> float:
        """Degrees that the camera looks down; negative where it looks up."""
        return float(np.degrees(np.arcsin(np.clip(-self.up[2], -1, 1))))


@dataclass(frozen=True, kw_only=True, eq=False)
class RolledView:
    """The lifter's result for the image rotated about its centre."""

    degrees: float
    """Rotation, from x to y."""
    up: Float[np.ndarray, "3"]
    """Against gravity, still space: a unit vector."""
    spread: float
    """1 - |m|² of its vectors m: mean squared sine of the angle to the directions the lifter considers possible."""
    depth: float
    """Mean log of its depth deviations."""


def rolled_views(
    xy: Float[np.ndarray, "T K 2"], confidence: Float[np.ndarray, "T K"], camera: Camera, frame_rate: float
) -> list[RolledView]:
    """The middle of a clip, lifted as if through cameras of different roll, one of them zero.

    Args:
        xy: Pixels, the first 25 of K are BODY_25.
        confidence: 0 for what is not seen or is cut off by the image.
        camera: Of the clip.
        frame_rate: Frames per second.
    """
    first = max(0, round((len(xy) - _SECONDS * frame_rate) / 2))
    some = slice(first, len(xy) - first)
    own, focal, center = camera[some], np.array(camera.focal), np.array(camera.center)
    found = []
    for degrees in _ROLLS:
        turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
        rolled = own
        if (path := own.path) is not None:
            rolled = replace(own, path=path_of(turn @ np.array(path.rotation), np.array(path.translation) @ turn.T))
        turned = rays_of(xy[some], own) @ turn[:2, :2].T * focal + center
        lifted = lift(turned, confidence[some], rolled, frame_rate, calibrated=camera.calibrated)
        up, spread = _direction(replace(lifted, up=lifted.up @ turn), own)
        depth = float(np.log(lifted.depth_deviation).mean())
        found.append(RolledView(degrees=degrees, up=up, spread=spread, depth=depth))
    return found


def gravity_before_fit(
    lifted: LiftedClip, confidence: Float[np.ndarray, "T K"], camera: Camera, rolled: Sequence[RolledView] = ()
) -> Gravity:
    """The direction that most frames' `up` agrees on if the camera is level, otherwise the one that the rotations give.

    Args:
        lifted: The lifter's result.
        confidence: Of its keypoints, BODY_25 first: without legs it knows less than it states.
        camera: Of the clip; for a moving one, up is in still space.
        rolled: From `rolled_views`; without them the camera is assumed level.
    """
    level, spread = _direction(lifted, camera)
    ups = np.array([view.up if view.degrees else level for view in rolled] or [level])
    spreads = np.array([view.spread if view.degrees else spread for view in rolled] or [spread])
    odds = np.array([-abs(v.degrees) / _ROLLED - _OF_DEPTH * v.depth - _OF_SPREAD * v.spread for v in rolled] or [0.0])
    share = np.exp(odds - odds.max())
    share /= share.sum()
    up = share @ ups
    up /= max(float(np.linalg.norm(up)), _NOTHING)
    legs = float((confidence[:, _LEGS] > SEEN).mean())
    own = legs * _WITH_LEGS + (1 - legs) * _WITHOUT_LEGS
    possible = np.degrees(np.sqrt(spreads))
    variance = share @ ((_OF_LENGTH * possible) ** 2 + angles_to(ups, up) ** 2) + (_OF_MOVE * angles_to(level, up)) ** 2
    return Gravity(up=up, deviation=float(np.hypot(own, np.sqrt(variance))))


def _direction(lifted: LiftedClip, camera: Camera) -> tuple[Float[np.ndarray, "3"], float]:
    """Up in still space, and its spread as of `RolledView`."""
    length = np.linalg.norm(lifted.up, axis=1)
    # A network trained on squared errors gives the mean of the possible vectors, of length |m|: their root mean square
    # distance from it is sqrt(1 - |m|²).
    return robust_mean(camera.turned_to_still(lifted.up), length), max(0.0, 1 - float(length.mean()) ** 2)


def told_gravity(camera: Camera) -> Gravity | None:
    """Gravity from the camera's pose in the user's world, or from what its pictures show; None if neither tells it."""
    if camera.world is not None and camera.world.up_in_camera is not None:
        return Gravity(up=camera.world.up_in_camera, deviation=_OF_CALIBRATION)
    if camera.vertical is not None:
        return Gravity(up=np.array(camera.vertical.up), deviation=camera.vertical.deviation)
    return None


def with_trunk(gravity: Gravity, trunk: Float[np.ndarray, "T 3"]) -> Gravity:
    """The direction between the lifter's and a fitted trunk's: people are upright more often than not.

    For half-body clips, where the lifter sees too little to tell how far a camera looks down. With whole bodies it
    knows more than their trunks, which lean by 14 degrees on average.

    Args:
        gravity: The lifter's.
        trunk: From pelvis to neck in camera space, of any length above 0. Lying or crawling people are ignored.
    """
    upright = robust_mean(trunk, np.ones(len(trunk)))
    off = float(angles_to(upright, gravity.up))
    leaning = _LEAN * float(np.hypot(1.0, off / _UPRIGHT))
    share = gravity.deviation**2 / (gravity.deviation**2 + leaning**2)
    up = (1 - share) * gravity.up + share * upright
    return replace(gravity, up=up / np.linalg.norm(up))


def robust_mean(vectors: Float[np.ndarray, "T 3"], weights: Float[np.ndarray, "T"]) -> Float[np.ndarray, "3"]:
    """The unit vector that most vectors point along; distant ones have less weight (Cauchy weights).

    Without any, or if they cancel out: upward in the image.
    """
    if np.linalg.norm((vectors * weights[:, None]).sum(0)) < _NOTHING:
        return np.array([0.0, -1.0, 0.0])
    units = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
    counts = weights + 1e-9
    for _ in range(_ROUNDS):
        mean = (units * counts[:, None]).sum(0)
        mean /= max(float(np.linalg.norm(mean)), 1e-9)
        counts = (weights + 1e-9) / (1 + (angles_to(units, mean) / _INLIER) ** 2)
    return mean


def angles_to(vectors: Float[np.ndarray, "*n 3"], to: Float[np.ndarray, "3"]) -> Float[np.ndarray, "*n"]:
    """Degrees between vectors and a unit vector."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(vectors, to), axis=-1), vectors @ to))
