"""Arms and legs bent so that their ends reach their goals: two bones, in closed form."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.animation.retargeting.retarget import RigMotion
from fitting_core.animation.retargeting.target import Target
from fitting_core.body.geometry import shortest_rotation
from fitting_core.body.model import JOINT

_LONGEST = 0.9995
"""Share of its length that a limb is stretched to at most, if it was not longer before: a straight one would not say
where to bend."""
_STRAIGHT = 1e-3
"""Sine of the angle between the bones below which the axis of the rest pose counts."""


@dataclass(frozen=True, kw_only=True)
class RigLimb:
    """Three joints of a rig: shoulder, elbow, wrist; or hip, knee, ankle."""

    upper: int
    middle: int
    end: int
    hinge: Float[np.ndarray, "3"]
    """The bending axis at rest, in the upper joint's frame; for straight limbs."""


def reached(moving: RigMotion, limb: RigLimb, goal: Float[np.ndarray, "T 3"]) -> RigMotion:
    """The end at its goal, or as near as the limb's length allows, with its world rotation kept.

    The middle joint opens or closes about the axis that it is bent about, then the whole limb turns the shortest way.
    The cosine rule gives the angle.
    """
    places, moved = moving.places, moving.moved
    a, b, c = (places[:, k] for k in (limb.upper, limb.middle, limb.end))
    first, second = np.linalg.norm(b - a, axis=1), np.linalg.norm(c - b, axis=1)
    far, before = np.linalg.norm(goal - a, axis=1), np.linalg.norm(c - a, axis=1)
    longest = np.maximum(before, _LONGEST * (first + second))
    far = np.clip(far, abs(first - second) + 1e-6 * (first + second), longest)
    axis = np.cross(b - a, c - b)
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(size > _STRAIGHT * (first * second)[:, None], axis, moved[:, limb.upper] @ limb.hinge)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    now, wished = _bend(first, second, before), _bend(first, second, far)
    opened = Rotation.from_rotvec((wished - now)[:, None] * axis).as_matrix()
    bent = b + (opened @ (c - b)[..., None])[..., 0]
    aimed = shortest_rotation(bent - a, goal - a)
    return moving.with_moved(
        {limb.upper: aimed @ moved[:, limb.upper], limb.middle: aimed @ opened @ moved[:, limb.middle]}
    )


def _bend(first: np.ndarray, second: np.ndarray, far: np.ndarray) -> Float[np.ndarray, "T"]:
    """The angle by which the second bone deviates from the first's line, for this distance of the ends."""
    cosine = (far**2 - first**2 - second**2) / (2 * first * second)
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def limb_of(target: Target, side: str, which: str) -> RigLimb:
    """A leg or an arm of a rig."""
    names = ("hip", "knee", "ankle") if which == "leg" else ("shoulder", "elbow", "wrist")
    upper, middle, end = (target.of_joint[f"{side}_{name}"] for name in names)
    left, up, _ = (target.rest[JOINT[f"{side}_{names[0]}"]]).T
    # A knee bends about the body's left; an elbow of a T pose about its up, which is mirrored on the other side.
    hinge = left if which == "leg" else up * (-1 if side == "left" else 1)
    return RigLimb(upper=upper, middle=middle, end=end, hinge=hinge)
