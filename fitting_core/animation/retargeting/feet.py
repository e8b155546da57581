"""Standing feet on a rig whose lengths are not the person's.

Lengths are scaled by those of the legs, so a foot of the rig follows the fit's path at its own scale: it stands where
that stands, and slides as much in proportion. If a leg is too short for that, as with hips of another width, the pelvis
is lowered.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from fitting_core.animation.retargeting.limbs import limb_of, reached
from fitting_core.animation.retargeting.retarget import Posed, RigMotion
from fitting_core.animation.retargeting.target import Target
from fitting_core.body.geometry import SIDES
from fitting_core.body.model import JOINT
from fitting_core.motion import Motion

_SPREAD = 0.15
"""Seconds over which the pelvis is lowered and raised again."""
_MOST = 0.1
"""Maximum lowering of the pelvis, as a share of a leg."""


def grounded(moving: RigMotion, posed: Posed, motion: Motion) -> RigMotion:
    """Feet where the fit has them, scaled, on the rig's floor; see the module's text."""
    target = moving.target
    floor = _floor(posed, motion)
    up, scale = target.up, target.scale
    soles = _soles(motion)
    middle = _scaled(posed.places[:, [JOINT["left_hip"], JOINT["right_hip"]]].mean(1), target, floor)
    hips = [target.of_joint[f"{side}_hip"] for side in SIDES]
    own_hips = moving.places[:, hips].mean(1)
    moving = _shifted(moving, middle - own_hips)
    goals = {}
    for side in SIDES:
        joint = f"{side}_foot" if f"{side}_foot" in target.of_joint else f"{side}_ankle"
        k, ankle = target.of_joint[joint], target.of_joint[f"{side}_ankle"]
        height = float(target.places[k] @ up) - target.floor
        person = scale * (posed.rest[JOINT[joint], 1] - soles)
        way = _scaled(posed.places[:, JOINT[joint]], target, floor) + (height - person) * up
        goals[side] = way - moving.moved[:, ankle] @ (target.places[k] - target.places[ankle])
    standing = np.ones((len(posed.places), 2), bool) if motion.contacts is None else motion.contacts.standing
    moving = _shifted(moving, -_lowered(moving, goals, standing, motion.frame_rate)[:, None] * up)
    for side in SIDES:
        moving = reached(moving, limb_of(target, side, "leg"), goals[side])
    return moving


def _floor(posed: Posed, motion: Motion) -> float:
    """Height of the floor in the y-up world: 0 if known, otherwise that of the lowest sole."""
    if motion.level is not None and motion.level.height is not None:
        return 0.0
    return float(posed.places[..., 1].min() + _soles(motion) - posed.rest[:, 1].min())


def _soles(motion: Motion) -> float:
    """Height of the soles at rest, metres."""
    return float(motion.shaped_body.template[:, 1].min())


def _scaled(places: Float[np.ndarray, "T 3"], target: Target, floor: float) -> Float[np.ndarray, "T 3"]:
    """Positions in the y-up world converted to the rig's, above a floor at 0."""
    return target.scale * (places - (0.0, floor, 0.0)) @ target.upright.T


def _shifted(moving: RigMotion, by: Float[np.ndarray, "T 3"]) -> RigMotion:
    return RigMotion(target=moving.target, moved=moving.moved, root=moving.root + by, base=moving.base)


def _lowered(
    moving: RigMotion, goals: dict[str, np.ndarray], standing: Bool[np.ndarray, "T 2"], frame_rate: float
) -> Float[np.ndarray, "T"]:
    """How far the pelvis must sink for standing feet to be within reach; smooth over time.

    A hip that sinks by d is at r + d up from its goal, with r the offset before: the smallest d with |r + d up| <= L.
    """
    target, places = moving.target, moving.places
    needed = np.zeros(len(places))
    for f, side in enumerate(SIDES):
        limb = limb_of(target, side, "leg")
        bones = [target.places[j] - target.places[k] for k, j in ((limb.upper, limb.middle), (limb.middle, limb.end))]
        length = 0.999 * sum(np.linalg.norm(bone) for bone in bones)
        way = goals[side] - places[:, limb.upper]
        along = way @ target.up
        aside = (way**2).sum(1) - along**2
        sink = -along - np.sqrt(np.maximum(length**2 - aside, 0.0))
        needed = np.maximum(needed, np.where(standing[:, f], np.clip(sink, 0.0, _MOST * length), 0.0))
    if not needed.any():
        return needed
    width = max(1, round(_SPREAD * frame_rate))
    return gaussian_filter1d(maximum_filter1d(needed, 2 * width + 1), width / 2)
