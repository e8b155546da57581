"""Which way is up in a clip."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.camera import Camera
from fitting_core.keypoints import SEEN
from fitting_core.lifting.clip_lifting import LiftedClip

_LEGS = [kp.INDEX[f"{side}_{part}"] for side in ("left", "right") for part in ("knee", "ankle")]
_ROUNDS = 10
_NOTHING = 1e-6
_INLIER = 8.0
"""Degrees from the clip's direction within which a frame counts in full."""
_WITH_LEGS, _WITHOUT_LEGS = 3.0, 9.0
_OF_LENGTH = 0.5
"""Of the deviation in degrees that a vector's length stands for. Set with the two before so that the motion suite's
tuning half misses by as much as is said, root mean square: 5 degrees with whole bodies, 10 with cut ones."""

_OF_CALIBRATION = 0.5
"""Degrees by which a world's axis is off gravity: a board on a floor is hardly level to more."""
_LEAN, _UPRIGHT = 12.0, 15.0
"""Degrees: how far an upright person's trunk leans, and from the lifter's direction from where it counts half."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Gravity:
    """One direction for a whole clip, as the camera stands still."""

    up: Float[np.ndarray, "3"]
    """Against gravity: a unit vector in camera axes (x right, y down, z away)."""
    deviation: float
    """Standard deviation of its direction, degrees."""

    @property
    def tilt(self) -> float:
        """Degrees that the camera looks down; negative where it looks up."""
        return float(np.degrees(np.arcsin(np.clip(-self.up[2], -1, 1))))


def gravity_before_fit(lifted: LiftedClip, confidence: Float[np.ndarray, "T K"], camera: Camera) -> Gravity:
    """The direction that most frames' `up` agrees on.

    Args:
        lifted: What the lifter says.
        confidence: Of the keypoints that it saw, BODY_25 first: without legs it knows less than it says.
        camera: Of the clip; of one that moves, up is that of still space.
    """
    length = np.linalg.norm(lifted.up, axis=1)
    up = robust_mean(camera.turned_to_still(lifted.up), length)
    # A network that learns with squared errors says the mean of what it holds possible, of length |m|: these lie
    # sqrt(1 - |m|²) from it, root mean square.
    possible = np.degrees(np.sqrt(max(0.0, 1 - float(length.mean()) ** 2)))
    legs = float((confidence[:, _LEGS] > SEEN).mean())
    own = legs * _WITH_LEGS + (1 - legs) * _WITHOUT_LEGS
    return Gravity(up=up, deviation=float(np.hypot(own, _OF_LENGTH * possible)))


def told_gravity(camera: Camera) -> Gravity | None:
    """What the camera's place in the user's world says; None where it does not say what is up."""
    if camera.world is None or camera.world.up_in_camera is None:
        return None
    return Gravity(up=camera.world.up_in_camera, deviation=_OF_CALIBRATION)


def with_trunk(gravity: Gravity, trunk: Float[np.ndarray, "T 3"]) -> Gravity:
    """The direction between the lifter's and a fitted trunk's: people are upright more often than not.

    For half-body clips, where the lifter sees too little to tell how much a camera looks down. With whole bodies it
    knows more than their trunks, which lean by 14 degrees in the mean.

    Args:
        gravity: The lifter's.
        trunk: From pelvis to neck in camera space, of any length above 0. Who lies or crawls does not count.
    """
    upright = robust_mean(trunk, np.ones(len(trunk)))
    off = float(angles(upright, gravity.up))
    leaning = _LEAN * float(np.hypot(1.0, off / _UPRIGHT))
    share = gravity.deviation**2 / (gravity.deviation**2 + leaning**2)
    up = (1 - share) * gravity.up + share * upright
    return replace(gravity, up=up / np.linalg.norm(up))


def robust_mean(vectors: Float[np.ndarray, "T 3"], weights: Float[np.ndarray, "T"]) -> Float[np.ndarray, "3"]:
    """The unit vector that most vectors point along; those far from it count less (Cauchy weights).

    Where there are none, or they cancel out: upward in the image.
    """
    if np.linalg.norm((vectors * weights[:, None]).sum(0)) < _NOTHING:
        return np.array([0.0, -1.0, 0.0])
    units = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
    counts = weights + 1e-9
    for _ in range(_ROUNDS):
        mean = (units * counts[:, None]).sum(0)
        mean /= max(float(np.linalg.norm(mean)), 1e-9)
        counts = (weights + 1e-9) / (1 + (angles(units, mean) / _INLIER) ** 2)
    return mean


def angles(vectors: Float[np.ndarray, "*n 3"], to: Float[np.ndarray, "3"]) -> Float[np.ndarray, "*n"]:
    """Degrees between vectors and a unit vector."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(vectors, to), axis=-1), vectors @ to))
