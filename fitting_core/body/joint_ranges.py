"""How far each joint of a human body turns: anatomical axes, and ranges in degrees, of body and fingers.

Sources: American Academy of Orthopaedic Surgeons, Joint Motion (1965), AAOS; Boone & Azen, J. Bone Joint Surg. 61-A
(1979); Kapandji, The Physiology of the Joints; Mulholland & Wyss, Int. J. Rehabil. Res. 24 (2001), postures on the
floor; Hume et al., J. Hand Surg. 15-A (1990), and Lin, Wu & Huang, Workshop on Human Motion (2000), fingers; Cooney et
al., J. Bone Joint Surg. 63-A (1981), the thumb's base. They give the means of healthy adults under their own force. The
ranges here are some degrees wider, and wider still where the body's weight pushes (kneeling, squatting, hands on the
floor) and where one joint of the model stands for several of the skeleton.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.body.geometry import MIRROR, MIRROR_ROTATION, unit
from fitting_core.body.model import JOINT, BodyModel

Degrees = tuple[float, float]
Axis = tuple[float, float, float]
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_BACK_X, _BACK_Y, _BACK_Z = (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)


@dataclass(frozen=True, kw_only=True)
class JointRange:
    """The range of one joint, by three angles whose names are those of its main motions.

    A hinge turns by flexion F, and what is left of the rotation is a turn S of its own bone about the side and twist
    axes: R = F S (F and twist are the clinical angles of Grood & Suntay 1983). A ball's bone swings S, away from where
    it points at the `centre`, after it has twisted T about itself: R = C S T. S is a rotation vector; its components
    are the two other angles. All are singular only where a bone lies 180 degrees off, beyond any human's range: a
    centre in the middle of the range takes care of this, and keeps the twist's zero anatomical in all of it.
    """

    kind: Literal["hinge", "ball"]
    axes: tuple[Axis, Axis, Axis]
    """Unit axes in the rest pose's frame (x to the body's left, y up, z forward) about which positive flexion, side
    motion and twist turn."""
    flexion: Degrees
    side: Degrees
    twist: Degrees
    centre: tuple[float, float] = (0.0, 0.0)
    """Flexion and side motion of a ball's centre."""

    def mirrored(self) -> "JointRange":
        """The same joint on the other side of the body."""
        x, y, z = (np.array(self.axes) * MIRROR_ROTATION).tolist()
        return replace(self, axes=(tuple(x), tuple(y), tuple(z)))

    @property
    def bounds(self) -> Float[np.ndarray, "3 2"]:
        """Lowest and highest flexion, side motion and twist, degrees."""
        return np.array([self.flexion, self.side, self.twist])

    def rotation(self, flexion: float = 0.0, side: float = 0.0, twist: float = 0.0) -> Rotation:
        """The rotation that has these angles (degrees)."""
        axes, (flexed, sideways) = np.radians(self.axes), self.centre
        if self.kind == "hinge":
            return Rotation.from_rotvec(flexion * axes[0]) * Rotation.from_rotvec(side * axes[1] + twist * axes[2])
        centre = Rotation.from_rotvec(flexed * axes[0] + sideways * axes[1])
        swing = Rotation.from_rotvec((flexion - flexed) * axes[0] + (side - sideways) * axes[1])
        return centre * swing * Rotation.from_rotvec(twist * axes[2])


_SPINE = JointRange(kind="ball", axes=(_X, _Z, _Y), flexion=(-22, 35), side=(-20, 20), twist=(-20, 20))
_TRUNK = {
    # Forward, to the left, to the left. Thoracolumbar spine (AAOS): flexion 80-85, extension 25, sideways 35, rotation
    # 45 degrees; the neck: 45, 45, 45, 60 (Kapandji: 40, 75, 45, 50). Each is shared by three joints, or by two.
    "spine1": _SPINE,
    "spine2": _SPINE,
    "spine3": _SPINE,
    "neck": JointRange(kind="ball", axes=(_X, _Z, _Y), flexion=(-45, 40), side=(-32, 32), twist=(-48, 48)),
    "head": JointRange(kind="ball", axes=(_X, _Z, _Y), flexion=(-40, 35), side=(-28, 28), twist=(-48, 48)),
}
_LIMBS = {
    # Forward, outward, knee outward. AAOS: flexion 120, extension 30, abduction 45, adduction 30, rotation 45 and 45.
    # Squatting and sitting cross-legged: flexion 130, with abduction and external rotation of 60 (Mulholland & Wyss).
    "hip": JointRange(
        kind="ball", axes=(_BACK_X, _Z, _Y), flexion=(-35, 135), side=(-38, 68), twist=(-50, 85), centre=(60, 0)
    ),
    # Bend, shank outward (valgus is +), toes outward. AAOS: 135, hyperextension 10. On the heels 155-160 (Mulholland &
    # Wyss). Rotation of the bent knee: 30 inward, 40 outward (Kapandji).
    "knee": JointRange(kind="hinge", axes=(_X, _Z, _Y), flexion=(-10, 160), side=(-10, 10), twist=(-25, 35)),
    # Toes up, sole inward, toes outward. AAOS: 20 up, 50 down, inversion 35, eversion 15; up 40-45 under weight.
    "ankle": JointRange(kind="hinge", axes=(_BACK_X, _BACK_Z, _Y), flexion=(-65, 45), side=(-28, 40), twist=(-35, 35)),
    # Toes up. AAOS, metatarsophalangeal joints: 40 down, 40-70 up; 85 on tiptoe and kneeling.
    "foot": JointRange(kind="hinge", axes=(_BACK_X, _BACK_Z, _Y), flexion=(-50, 85), side=(-15, 15), twist=(-15, 15)),
    # Forward, up, clavicle turned forward. Kapandji: 30 forward and back, 45 up, 10 down, axial rotation 30-45.
    "collar": JointRange(kind="ball", axes=(_BACK_Y, _Z, _X), flexion=(-30, 35), side=(-22, 42), twist=(-45, 35)),
    # Forward and up from the T-pose, inward. AAOS: horizontally 45 back, 135 forward; 90 down and up; rotation 70
    # inward, 90 outward at 90 degrees of abduction. The ends lie round the centre of the cone that the arm sweeps
    # (Engin & Tuemer 1989), so that 60 degrees back past the hanging arm is within.
    "shoulder": JointRange(
        kind="ball", axes=(_BACK_Y, _Z, _X), flexion=(-48, 138), side=(-105, 95), twist=(-125, 115), centre=(40, -20)
    ),
    # Bend, forearm outward, palm back (pronation). AAOS: 150, hyperextension 0-10; rotation 80 and 80 from a thumb that
    # points forward, which is the rest pose's.
    "elbow": JointRange(kind="hinge", axes=(_BACK_Y, _Z, _X), flexion=(-10, 155), side=(-15, 15), twist=(-90, 90)),
    # Palmward, to the thumb (radial), pronation. AAOS: 80, extension 70, radial 20, ulnar 30; leaning on the hand 90.
    # The forearm's rotation shows along all its length: a part of it may be the model's wrist's.
    "wrist": JointRange(kind="ball", axes=(_BACK_Z, _BACK_Y, _X), flexion=(-90, 90), side=(-45, 32), twist=(-50, 50)),
}
"""The left side's. The right side mirrors them."""

_MIDDLE_PHALANX, _END_PHALANX = (-12, 118), (-18, 92)
_FINGERS: dict[str, tuple[Degrees, Degrees, Degrees]] = {
    # Flexion; side motion (index to little finger: away from the thumb; thumb: away from the palm's plane); twist.
    # Hume: knuckles 100, middle joints 105, end joints 85. Lin, Wu & Huang: sideways 15 either way from the middle;
    # spread hands reach 25, the little finger more. Hyperextension of knuckles 30-45 (Kapandji). The outer joints'
    # hinges are oblique, so that bent fingers point to one place (Kapandji): their axes are known to some 10 degrees.
    "index1": ((-40, 98), (-28, 22), (-18, 18)),
    "middle1": ((-40, 100), (-22, 22), (-18, 18)),
    "ring1": ((-40, 100), (-20, 25), (-18, 18)),
    "pinky1": ((-45, 102), (-20, 38), (-22, 22)),
    **{f"{finger}2": (_MIDDLE_PHALANX, (-15, 15), (-15, 15)) for finger in ("index", "middle", "ring", "pinky")},
    **{f"{finger}3": (_END_PHALANX, (-15, 15), (-15, 15)) for finger in ("index", "middle", "ring", "pinky")},
    # Cooney: the thumb's base 53 in flexion and extension together, 42 sideways, 17 in rotation, and from a rest pose
    # that stands between these ends; a thumb that holds the little finger (W) takes 57. Hume: middle joint 56, end
    # joint 73, which bends back by 10-30.
    "thumb1": ((-35, 58), (-22, 48), (-30, 35)),
    "thumb2": ((-15, 72), (-20, 20), (-20, 20)),
    "thumb3": ((-30, 92), (-12, 12), (-12, 12)),
}
_OPPOSED = np.array([0, -0.035, 0])
"""Metres from the ring finger's knuckle: where the thumb's tip goes."""


def joint_ranges(body: BodyModel) -> dict[str, JointRange]:
    """The ranges of all joints of a body whose rotation is limited, by their name.

    Fingers are hinges about the world's axes of the rest pose, so their axes come from where this body's joints lie.
    Fingers that a body lacks (SMPL) have no range.
    """
    joints = body.rest_joints
    limbs = {f"left_{name}": limb for name, limb in _LIMBS.items()}
    limbs |= {f"right_{name}": limb.mirrored() for name, limb in _LIMBS.items()}
    right = {name: joint.mirrored() for name, joint in _left_fingers(joints * MIRROR, "right").items()}
    return _TRUNK | limbs | _left_fingers(joints, "left") | right


def _left_fingers(joints: Float[np.ndarray, "55 3"], named: str) -> dict[str, JointRange]:
    """Ranges of a left hand whose joints have these names."""
    ranges = {}
    for name, (flexion, side, twist) in _FINGERS.items():
        finger = name[:-1]
        if np.allclose(joints[JOINT[f"{named}_{finger}1"]], joints[JOINT[f"{named}_{finger}3"]], atol=1e-6):
            continue
        x, y, z = axes_of_finger(joints, finger, named=named).tolist()
        axes = (tuple(x), tuple(y), tuple(z))
        ranges[f"{named}_{name}"] = JointRange(kind="hinge", axes=axes, flexion=flexion, side=side, twist=twist)
    return ranges


def axes_of_finger(joints: Float[np.ndarray, "55 3"], finger: str, *, named: str = "left") -> Float[np.ndarray, "3 3"]:
    """Axes of a finger of a left hand as rows: turning about them by positive angles flexes, spreads, twists.

    Positive spreading turns about the upward axis, so it takes the left index finger away from the thumb.

    Args:
        joints: Of the rest pose: palm down, fingers along +x.
        finger: One of FINGERS.
        named: The side that the joints are named after: "right" for a right hand's mirror image.
    """
    first, third, ring = (joints[JOINT[f"{named}_{name}"]] for name in (f"{finger}1", f"{finger}3", "ring1"))
    along = unit(third - first)
    palm = np.array([0, -1.0, 0])
    if finger == "thumb":  # it flexes across the palm
        palm = unit(ring + _OPPOSED - first)
    flex = unit(np.cross(along, palm))
    spread = unit(np.cross(flex, along))
    upward = finger == "thumb" or spread[1] > 0
    return np.stack([flex, spread if upward else -spread, along])
