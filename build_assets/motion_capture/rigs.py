"""How the limbs of each source lie in its rest pose, and of the body in its own: what retargeting aligns."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.body.geometry import frame

SIDES = {"left": 1.0, "right": -1.0}
"""Sides and the sign of their x."""


@dataclass(frozen=True, kw_only=True)
class Limb:
    """How a straight limb lies in a rest pose; left side, x to the body's left, y up, z forward."""

    upper: str
    """The joint that its upper bone starts at."""
    lower: str
    """The hinge, where its lower bone starts."""
    bone: tuple[float, float, float]
    """Direction of the upper bone."""
    hinge: tuple[float, float, float]
    """Axis about which the lower bone turns when the limb is bent."""

    def frame(self, side: str) -> Float[np.ndarray, "3 3"]:
        """Columns: the bone, the hinge made perpendicular to it, and their cross product."""
        return frame(np.array(self.bone) * [SIDES[side], 1, 1], axis_of_side(self.hinge, side))


@dataclass(frozen=True, kw_only=True)
class Rig:
    """The names of a source's joints, and its rest pose."""

    name_of: Callable[[str, str], str]
    """Name of a joint of one side."""
    pelvis: str
    chest: str
    head: str
    arm: Limb
    leg: Limb
    foot: str
    hand: str
    pronation: float | None = None
    """Degrees about x from SMPL-X's rest forearm (hinge vertical, palm down) to the source's; None where hands do not
    turn."""
    legs_too_long: bool = False
    """Whether the bones may be longer than the captured person's, so that people who stand have bent knees."""


BODY = {
    "arm": Limb(upper="shoulder", lower="elbow", bone=(1.0, 0.0, 0.0), hinge=(0.0, -1.0, 0.0)),
    "leg": Limb(upper="hip", lower="knee", bone=(0.05, -1.0, 0.02), hinge=(1.0, 0.0, 0.0)),
}
"""SMPL-X's limbs, by their names in Rig; directions are the free body's."""

_HANGING = Rig(
    name_of=lambda side, joint: f"{side}_{joint}",
    pelvis="root",
    chest="chest",
    head="neck",
    arm=Limb(upper="shoulder", lower="elbow", bone=(0.0, -1.0, 0.0), hinge=(-1.0, 0.0, 0.0)),
    leg=Limb(upper="hip", lower="knee", bone=(0.0, -1.0, 0.0), hinge=(1.0, 0.0, 0.0)),
    foot="ankle",
    hand="wrist",
)
"""A figure that rests with hanging arms."""

RIGS = {
    "cmu": Rig(
        name_of=lambda side, joint: side[0] + joint,
        pelvis="hip",
        chest="chest",
        head="head",
        # Bones as in the files' offsets. The elbow's hinge is measured: the first principal axis of its rotations,
        # which holds 99.5 % of them, tilted by 30 degrees against a palm that faces down.
        arm=Limb(upper="Shldr", lower="ForeArm", bone=(0.998, -0.061, 0.017), hinge=(-0.11, -0.86, 0.50)),
        leg=Limb(upper="Thigh", lower="Shin", bone=(0.0, -1.0, 0.02), hinge=(1.0, 0.0, 0.0)),
        foot="Foot",
        hand="Hand",
        pronation=30.0,
        legs_too_long=True,
    ),
    "deepmimic": _HANGING,
    "cmu_expmap": Rig(
        name_of=lambda side, joint: side[0] + joint,
        pelvis="root",
        chest="thorax",
        head="head",
        # Hinges are the axes about which these joints turn and no other: all of the variance.
        arm=Limb(upper="humerus", lower="radius", bone=(1.0, 0.0, 0.0), hinge=(0.0, -0.866, 0.5)),
        leg=Limb(upper="femur", lower="tibia", bone=(0.342, -0.94, 0.0), hinge=(0.94, 0.342, 0.0)),
        foot="foot",
        hand="wrist",
        pronation=30.0,
        legs_too_long=True,
    ),
}
"""By the name of the source (mocap.READERS)."""


def axis_of_side(axis: tuple[float, float, float], side: str) -> Float[np.ndarray, "3"]:
    """An axis of the left side, or of the right side's mirrored motion (y and z negated)."""
    return np.array(axis) * (1, SIDES[side], SIDES[side])
