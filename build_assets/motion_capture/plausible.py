"""Which frames of motion capture a body can have: where markers got lost, limbs flip, twist and bend backward."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from build_assets.motion_capture.rigs import SIDES, axis_of_side
from fitting_core.body.geometry import twist
from fitting_core.body.model import JOINT

N_BODY_JOINTS = 21


@dataclass(frozen=True, kw_only=True)
class Range:
    """How far a joint can turn about an axis, degrees; left side."""

    axis: tuple[float, float, float]
    low: float
    high: float
    bone: tuple[float, float, float] | None = None
    """The bone's direction at rest where `axis` is its usual direction instead: twist is counted from there, for it
    means nothing near the opposite of the direction that it is counted from."""


RANGES = {
    "elbow": Range(axis=(0.0, -1.0, 0.0), low=-10.0, high=155.0),
    "knee": Range(axis=(1.0, 0.0, 0.0), low=-10.0, high=165.0),
    "wrist": Range(axis=(1.0, 0.0, 0.0), low=-50.0, high=50.0),  # half of the forearm's twist
    "hip": Range(axis=(0.0, 1.0, 0.0), low=-125.0, high=125.0),
    # Measured: 98 % of the CMU frames but subject 05's, whose right arm flips, are within -100 and 35.
    "shoulder": Range(axis=(0.6, -0.3, 0.75), low=-125.0, high=75.0, bone=(1.0, 0.0, 0.0)),
}
"""By the name of the left and right joint."""
LARGEST = {"spine1": 33.0, "neck": 50.0, "left_ankle": 75.0, "right_ankle": 75.0}
"""Degrees of a whole rotation; spine1 has a third of what the trunk bends, neck half of what the head turns."""
FASTEST = 1800.0
"""Degrees per second of any joint: 60 in a frame of a thirtieth."""


def plausible(pose: Float[np.ndarray, "T 63"], fps: float) -> Bool[np.ndarray, "T"]:
    """Which frames of consecutive poses are within RANGES and LARGEST, and not beside a jump faster than FASTEST."""
    joints = pose.reshape(len(pose), N_BODY_JOINTS, 3)
    possible = ~_jumps(joints, fps)
    for side in SIDES:
        for name, limits in RANGES.items():
            angle = _angle(joints[:, JOINT[f"{side}_{name}"] - 1], limits, side)
            possible &= (limits.low <= angle) & (angle <= limits.high)
    for name, largest in LARGEST.items():
        possible &= np.linalg.norm(joints[:, JOINT[name] - 1], axis=-1) <= np.radians(largest)
    return possible


def _jumps(joints: Float[np.ndarray, "T 21 3"], fps: float) -> Bool[np.ndarray, "T"]:
    """Frames on either side of a jump."""
    turns = Rotation.from_rotvec(joints.reshape(-1, 3))
    steps = (turns[:-N_BODY_JOINTS].inv() * turns[N_BODY_JOINTS:]).magnitude().reshape(-1, N_BODY_JOINTS)
    jump = (steps > np.radians(FASTEST) / fps).any(1)
    return np.append(jump, False) | np.append(False, jump)


def _angle(rotations: Float[np.ndarray, "T 3"], limits: Range, side: str) -> Float[np.ndarray, "T"]:
    """Degrees from -180 to 180 about the range's axis, as on the left side."""
    axis = np.array(limits.axis) / np.linalg.norm(limits.axis)
    turned = Rotation.from_rotvec(rotations * axis_of_side((1.0, 1.0, 1.0), side))
    if limits.bone is not None:
        turned = turned * Rotation.align_vectors(axis, limits.bone)[0].inv()
    return np.degrees(twist(turned, axis))
