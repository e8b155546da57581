"""The angles of the body's joints over time, by the sequences of the ISB, with the same signs left and right."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.io.motion.fitted_motion import Motion
from fitting_core.measure.angles.cardan import angles_of, continuous, singular
from fitting_core.measure.angles.segments import Segments


@dataclass(frozen=True, kw_only=True)
class Angle:
    """One angle of a joint."""

    name: str
    positive: str
    """What the body does while it grows."""
    sign: int = 1
    """Of the turn about the axis, on the right side of the body."""


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint, as the rotation of one segment against another."""

    name: str
    parent: str | None
    """Segment of the same side, or of the middle; None: the world, upright, of one who looks along z of y-up."""
    child: str
    sided: bool = False
    sequence: str
    """Body-fixed axes: R = Rz(a) Rx(b) Ry(c) for "ZXY"."""
    angles: tuple[Angle | None, Angle | None, Angle | None]
    """About these axes; None is left out."""
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Turns about the axes, degrees, that the first frame is nearest to: the middle of what people do."""


def _standing(child: str) -> Joint:
    """By the sequence in which leaning does not depend on the way one faces (Baker, Hum. Mov. Sci. 20 (2001) 787)."""
    return Joint(
        name=child,
        parent=None,
        child=child,
        sequence="YXZ",
        angles=(
            Angle(name="rotation", positive="turns to its left; 0 faces along z of the world y-up"),
            Angle(name="obliquity", positive="right side goes up", sign=-1),
            Angle(name="tilt", positive="leans forward", sign=-1),
        ),
    )


def _trunk(name: str, parent: str, child: str) -> Joint:
    return Joint(
        name=name,
        parent=parent,
        child=child,
        sequence="ZXY",
        angles=(
            Angle(name="extension", positive="leans backward"),
            Angle(name="bending", positive="bends to the right"),
            Angle(name="rotation", positive="turns to the left"),
        ),
    )


JOINTS = (
    _standing("pelvis"),
    _standing("thorax"),
    _trunk("lumbar", "pelvis", "thorax"),
    _trunk("neck", "thorax", "head"),
    Joint(
        name="hip",
        parent="pelvis",
        child="thigh",
        sided=True,
        sequence="ZXY",
        angles=(
            Angle(name="flexion", positive="thigh goes forward"),
            Angle(name="adduction", positive="thigh goes inward"),
            Angle(name="rotation", positive="front of the thigh turns inward"),
        ),
    ),
    Joint(
        name="knee",
        parent="thigh",
        child="shank",
        sided=True,
        sequence="ZXY",
        angles=(
            Angle(name="flexion", positive="shank goes backward", sign=-1),
            Angle(name="adduction", positive="shank goes inward (varus)"),
            Angle(name="rotation", positive="front of the shank turns inward"),
        ),
    ),
    Joint(
        name="ankle",
        parent="shank",
        child="foot",
        sided=True,
        sequence="ZXY",
        angles=(
            Angle(name="dorsiflexion", positive="toes go up"),
            Angle(name="inversion", positive="sole turns inward"),
            Angle(name="rotation", positive="toes turn inward"),
        ),
    ),
    Joint(
        name="toes",
        parent="foot",
        child="toes",
        sided=True,
        sequence="ZXY",
        angles=(Angle(name="extension", positive="toes go up"), None, None),
    ),
    Joint(
        name="shoulder",
        parent="thorax",
        child="humerus",
        sided=True,
        sequence="YXY",
        angles=(
            Angle(name="plane", positive="plane of elevation: 0 sideways, 90 forward"),
            Angle(name="elevation", positive="elbow goes away from the hanging arm's place", sign=-1),
            Angle(name="axial", positive="upper arm turns inward"),
        ),
        start=(45.0, 0.0, 0.0),
    ),
    Joint(
        name="elbow",
        parent="humerus",
        child="forearm",
        sided=True,
        sequence="ZXY",
        angles=(
            Angle(name="flexion", positive="elbow bends"),
            Angle(name="carrying", positive="forearm goes outward", sign=-1),
            Angle(name="pronation", positive="palm turns backward; 0 is palms forward"),
        ),
        start=(60.0, 0.0, 90.0),
    ),
    Joint(
        name="wrist",
        parent="forearm",
        child="hand",
        sided=True,
        sequence="ZXY",
        angles=(
            Angle(name="flexion", positive="hand goes towards the palm"),
            Angle(name="deviation", positive="hand goes towards the little finger (ulnar)"),
            Angle(name="rotation", positive="hand turns as in pronation, against the forearm"),
        ),
    ),
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
    for joint in JOINTS:
        for side in ("left_", "right_") if joint.sided else ("",):
            named |= {f"{side}{joint.name}_{angle.name}": angle.positive for angle in joint.angles if angle}
            if joint.name == "shoulder":
                named |= {f"{side}shoulder_{name}": positive for name, positive in _ARM.items()}
    return named


ANGLES = _columns()
"""By its name: what the body does while the angle grows, in the order of `joint_angles`."""


def joint_angles(motion: Motion) -> dict[str, Float[np.ndarray, "T"]]:
    """All of ANGLES, degrees; NaN where one is not determined.

    That is so for the first and third angle of a joint within `SINGULAR` degrees of where their axes coincide (the hip
    90 degrees adducted, the upper arm hanging exactly along the thorax), and for the arm's flexion or abduction within
    `UNSEEN` degrees of the plane's normal. Angles run on over time without jumps of full turns.
    """
    segments = Segments(motion.in_axes("y-up"))
    found = {}
    for joint in JOINTS:
        for side in ("left_", "right_") if joint.sided else ("",):
            for angle, values in zip(joint.angles, _turns(joint, segments, side).T, strict=True):
                if angle:
                    found[f"{side}{joint.name}_{angle.name}"] = values
            if joint.name == "shoulder":
                found |= {f"{side}shoulder_{name}": values for name, values in _projected(segments, side).items()}
    return found


def joint_angle(motion: Motion, name: str) -> Float[np.ndarray, "T"]:
    """One of `error_bars.ANGLES`, degrees from -180 to 180: each frame by itself, whatever those before it are."""
    *side, joint, angle = name.split("_")
    known = next(one for one in JOINTS if one.name == joint)
    i, own = next((i, own) for i, own in enumerate(known.angles) if own and own.name == angle)
    return own.sign * _each(known, Segments(motion), f"{side[0]}_" if side else "")[:, i]


def _turns(joint: Joint, segments: Segments, side: str) -> Float[np.ndarray, "T 3"]:
    """The three angles of a joint with their signs, in the order of its axes."""
    turns = _each(joint, segments, side)
    determined = np.repeat(~singular(turns, joint.sequence)[:, None], 3, axis=1)
    determined[:, 1] = True
    run = continuous(turns, joint.sequence, start=joint.start, determined=determined)
    return run * [angle.sign if angle else 1 for angle in joint.angles]


def _each(joint: Joint, segments: Segments, side: str) -> Float[np.ndarray, "T 3"]:
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
