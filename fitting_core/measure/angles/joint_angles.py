"""The angles of the body's joints over time, by the sequences of the ISB, with the same signs left and right."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from fitting_core.body import rotations
from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.markers.joint_centres import with_joint_centres
from fitting_core.body.model import JOINT
from fitting_core.body.segment_axes import BONES, rest_axes
from fitting_core.measure.angles.cardan import angles_of, continuous, singular
from fitting_core.motion import Motion, rest_joints


@dataclass(frozen=True)
class Angle:
    """One angle of a joint."""

    name: str
    positive: str
    """Movement of the body as the angle grows."""
    sign: int = 1
    """Of the turn about the axis, on the right side of the body."""


@dataclass(frozen=True)
class AnatomicalJoint:
    """A joint, as the rotation of one segment against another."""

    name: str
    parent: str | None
    """Segment of the same side, or of the middle; None: the world, upright, of one who looks along z of y-up."""
    child: str
    angles: tuple[Angle | None, Angle | None, Angle | None]
    """About these axes; None is left out."""
    sequence: str = "ZXY"
    """Body-fixed axes: R = Rz(a) Rx(b) Ry(c) for "ZXY"."""
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Turns about the axes, degrees, that the first frame is nearest to: the middle of what people do."""

    @property
    def sides(self) -> tuple[str, ...]:
        """Prefixes of its name by side of the body; none for a joint of the middle."""
        return ("",) if self.child in BONES else ("left_", "right_")


_STANDING = (
    Angle("rotation", "turns to its left; 0 faces along z of the world y-up"),
    Angle("obliquity", "right side goes up", -1),
    Angle("tilt", "leans forward", -1),
)
"""By the sequence in which leaning does not depend on the way one faces (Baker, Hum. Mov. Sci. 20 (2001) 787)."""
_TRUNK = (
    Angle("extension", "leans backward"),
    Angle("bending", "bends to the right"),
    Angle("rotation", "turns to the left"),
)
_HIP = (
    Angle("flexion", "thigh goes forward"),
    Angle("adduction", "thigh goes inward"),
    Angle("rotation", "front of the thigh turns inward"),
)
_KNEE = (
    Angle("flexion", "shank goes backward", -1),
    Angle("adduction", "shank goes inward (varus)"),
    Angle("rotation", "front of the shank turns inward"),
)
_ANKLE = (
    Angle("dorsiflexion", "toes go up"),
    Angle("inversion", "sole turns inward"),
    Angle("rotation", "toes turn inward"),
)
_SHOULDER = (
    Angle("plane", "plane of elevation: 0 sideways, 90 forward"),
    Angle("elevation", "elbow goes away from the hanging arm's place", -1),
    Angle("axial", "upper arm turns inward"),
)
_ELBOW = (
    Angle("flexion", "elbow bends"),
    Angle("carrying", "forearm goes outward", -1),
    Angle("pronation", "palm turns backward; 0 is palms forward"),
)
_WRIST = (
    Angle("flexion", "hand goes towards the palm"),
    Angle("deviation", "hand goes towards the little finger (ulnar)"),
    Angle("rotation", "hand turns as in pronation, against the forearm"),
)
ANATOMICAL_JOINTS = (
    AnatomicalJoint("pelvis", None, "pelvis", _STANDING, "YXZ"),
    AnatomicalJoint("thorax", None, "thorax", _STANDING, "YXZ"),
    AnatomicalJoint("lumbar", "pelvis", "thorax", _TRUNK),
    AnatomicalJoint("neck", "thorax", "head", _TRUNK),
    AnatomicalJoint("hip", "pelvis", "thigh", _HIP),
    AnatomicalJoint("knee", "thigh", "shank", _KNEE),
    AnatomicalJoint("ankle", "shank", "foot", _ANKLE),
    AnatomicalJoint("toes", "foot", "toes", (Angle("extension", "toes go up"), None, None)),
    AnatomicalJoint("shoulder", "thorax", "humerus", _SHOULDER, "YXY", (45.0, 0.0, 0.0)),
    AnatomicalJoint("elbow", "humerus", "forearm", _ELBOW, start=(60.0, 0.0, 90.0)),
    AnatomicalJoint("wrist", "forearm", "hand", _WRIST),
)
_FACING = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""From the world y-up into the frame of a person who looks along its z: x there, y up, z to their right."""
_ARM = {
    "flexion": "upper arm goes forward, as seen from the side",
    "abduction": "upper arm goes outward, as seen from the front",
}
"""Of the upper arm against the thorax, in projection on its sagittal and frontal plane; 0 hangs."""
_ARM_START = 60.0
UNSEEN = 10.0
"""Degrees from a plane's normal, within which an arm's direction in that plane is not determined."""


def _columns() -> dict[str, str]:
    named = {}
    for joint in ANATOMICAL_JOINTS:
        for side in joint.sides:
            named |= {f"{side}{joint.name}_{angle.name}": angle.positive for angle in joint.angles if angle}
            if joint.name == "shoulder":
                named |= {f"{side}shoulder_{name}": positive for name, positive in _ARM.items()}
    return named


ANGLES = _columns()
"""Movement of the body as the angle grows, by its name, in the order of `joint_angles`."""


MIRROR_SIDES = np.diag([1.0, 1.0, -1.0])
"""Turns a rotation between two anatomical frames into that of the other side of the body, M R M."""


@dataclass(frozen=True)
class Segments:
    """Anatomical frames of a motion of T frames."""

    motion: Motion
    """In any world."""

    @cached_property
    def axes(self) -> dict[str, Float[np.ndarray, "T 3 3"]]:
        """By segment: x, y and z as columns, in the world of the motion."""
        motion = self.motion
        world, _ = pose_joints(Tree.of(motion.body.parents), rotations.exp(motion.pose), motion.rest_joints)
        at_rest = rest_axes(rest_joints(with_joint_centres(motion.body), motion.params).numpy())
        return {name: world[:, JOINT[BONES[name]]].numpy() @ axes for name, axes in at_rest.items()}

    def between(self, parent: str, child: str) -> Float[np.ndarray, "T 3 3"]:
        """The rotation of one segment against another, by its columns: the child's axes in the parent's frame.

        That of a left joint is mirrored into that of a right one, so that both have the same signs.
        """
        turned = self.axes[parent].swapaxes(-1, -2) @ self.axes[child]
        return MIRROR_SIDES @ turned @ MIRROR_SIDES if child.startswith("left") else turned


def joint_angles(motion: Motion) -> dict[str, Float[np.ndarray, "T"]]:
    """All of ANGLES, degrees; NaN where one is not determined.

    That is so for the first and third angle of a joint within `SINGULAR` degrees of where their axes coincide (the hip
    90 degrees adducted, the upper arm hanging exactly along the thorax), and for the arm's flexion or abduction within
    `UNSEEN` degrees of the plane's normal. Angles run on over time without jumps of full turns.
    """
    segments = Segments(motion.in_axes("y-up"))
    found = {}
    for joint in ANATOMICAL_JOINTS:
        for side in joint.sides:
            for angle, values in zip(joint.angles, _turns(joint, segments, side).T, strict=True):
                if angle:
                    found[f"{side}{joint.name}_{angle.name}"] = values
            if joint.name == "shoulder":
                found |= {f"{side}shoulder_{name}": values for name, values in _projected(segments, side).items()}
    return found


def joint_angle(motion: Motion, name: str) -> Float[np.ndarray, "T"]:
    """One of `error_bars.ANGLES`, degrees from -180 to 180: each frame independently of those before it."""
    *side, joint, angle = name.split("_")
    known = next(one for one in ANATOMICAL_JOINTS if one.name == joint)
    i, own = next((i, own) for i, own in enumerate(known.angles) if own and own.name == angle)
    return own.sign * _each(known, Segments(motion), f"{side[0]}_" if side else "")[:, i]


def _turns(joint: AnatomicalJoint, segments: Segments, side: str) -> Float[np.ndarray, "T 3"]:
    """The three angles of a joint with their signs, in the order of its axes."""
    turns = _each(joint, segments, side)
    determined = np.repeat(~singular(turns, joint.sequence)[:, None], 3, axis=1)
    determined[:, 1] = True
    run = continuous(turns, joint.sequence, start=joint.start, determined=determined)
    return run * [angle.sign if angle else 1 for angle in joint.angles]


def _each(joint: AnatomicalJoint, segments: Segments, side: str) -> Float[np.ndarray, "T 3"]:
    """The same of each frame by itself, without their signs."""
    if joint.parent is None:
        matrices = _FACING @ segments.axes[joint.child]
    else:
        parent = joint.parent if joint.parent in segments.axes else f"{side}{joint.parent}"
        matrices = segments.between(parent, f"{side}{joint.child}")
    turns = angles_of(matrices, joint.sequence)
    if joint.sequence[0] == joint.sequence[2]:  # arms are raised by negative turns
        turns = turns * (1, -1, 1) + (180, 0, -180)
    return turns


def _projected(segments: Segments, side: str) -> dict[str, Float[np.ndarray, "T"]]:
    """Where the upper arm points in the thorax' sagittal and frontal plane; 0 hangs."""
    x, y, z = -segments.between("thorax", f"{side}humerus")[:, :, 1].T
    found = {}
    for name, across, normal in (("flexion", x, z), ("abduction", z, x)):
        seen = abs(normal) < np.cos(np.radians(UNSEEN))
        angle = np.degrees(np.arctan2(across, -y))
        found[name] = continuous(angle[:, None], "Z", start=(_ARM_START,), determined=seen[:, None])[:, 0]
    return found
