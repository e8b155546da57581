"""Motion capture on SMPL-X's 21 body joints: bone directions and twists are carried over, not angles.

Sources rest otherwise than SMPL-X's T-pose, so a joint's angles mean something else in each. What has a meaning of its
own is how a part of the body has turned in the world since the rest pose, and how its bone and its hinge lie in that
rest pose. A constant alignment takes SMPL-X's rest bone and hinge to the source's; the source's world rotation after it
is SMPL-X's world rotation, and parent^-1 world is its joint's angle.

- Trunk: pelvis and chest turn as in the source; what lies between them is shared by spine1 to spine3 along the shortest
  way, and what lies between chest and head by neck and head.
- Arms and legs: the upper bone has the source's direction, and its twist is such that the source's hinge is SMPL-X's:
  y of the elbow (a bent left one is negative, a right one positive), x of the knee (positive).
- A limb that is straight in the source's T-pose is straight. The CMU figure draws its forearms bent by 18 degrees and
  its shanks by 8 while all its angles are zero, as a captured T-pose has them; taken at their drawn word nobody ever
  straightened an elbow beyond 17 degrees.
- Forearm: CMU data have one turn about the forearm's length. It is pronation; half of it is the elbow's twist, half the
  wrist's, as a radius that turns about the ulna twists the skin evenly along the forearm. Wrists do not bend: neither
  source says how.
- Collars never move in the sources, so the scapula's share is put where anatomy has it (`collar_rotation`); the upper
  arm keeps the source's direction and twist in the world.
- Toes (SMPL-X's foot joints) stay at rest: neither source has them.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from fitting_core.body.model import JOINT
from fitting_core.errors import InputError
from fitting_core.priors.train.mocap import SourceMotion, read_motions

N_BODY_JOINTS = 21
SIDES = {"left": 1.0, "right": -1.0}
"""Sides and the sign of their x."""
PRONATION_OF_ELBOW = 0.5
"""The elbow's share of the forearm's twist; the wrist has the rest."""
STRAIGHT_REACH = 0.996
"""From hip to ankle of a leg that stands, as a part of its length: a knee bent by 10 degrees."""
LARGEST_STRETCH = 1.03
SPINE = ("spine1", "spine2", "spine3")


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionClip:
    """One clip on the body's joints, without the frames that cannot be right."""

    name: str
    subject: str
    source: str
    fps: float
    body_pose: Float[np.ndarray, "T 63"]
    """Axis-angle of joints 1 to 21, radians; where frames were dropped, neighbours are further apart in time."""
    dropped: int
    """How many frames were."""


@dataclass(frozen=True, kw_only=True)
class Limb:
    """How a limb's two bones lie in a rest pose, both straight; left side."""

    upper: str
    lower: str
    bone: tuple[float, float, float]
    """Direction of the upper bone."""
    hinge: tuple[float, float, float]
    """Axis about which the lower bone turns when the limb is bent."""


@dataclass(frozen=True, kw_only=True)
class Rig:
    """The names of a source's joints, and its rest pose."""

    pelvis: str
    chest: str
    head: str
    arm: Limb
    leg: Limb
    foot: str
    hand: str | None = None
    legs_too_long: bool = False
    """Whether knees of standing people are bent in clips, by bones longer than the captured person's."""
    pronation: float = 0.0
    """Degrees from SMPL-X's rest forearm (palm towards the ground, thumb forward) to the source's, about x."""
    names: Callable[[str, str], str] = staticmethod(lambda side, joint: f"{side}_{joint}")
    """Name of a side's joint."""


BODY = {
    "arm": Limb(upper="shoulder", lower="elbow", bone=(1.0, 0.0, 0.0), hinge=(0.0, -1.0, 0.0)),
    "leg": Limb(upper="hip", lower="knee", bone=(0.05, -1.0, 0.02), hinge=(1.0, 0.0, 0.0)),
}
"""SMPL-X's limbs in its rest pose (the free body's)."""
RIGS = {
    "cmu": Rig(
        pelvis="hip",
        chest="chest",
        head="head",
        # Bones as the file's offsets have them; hinges measured: the first principal axis of the joints' rotations,
        # which hold 99.5 % (elbows) and 99 % (knees) of them.
        arm=Limb(upper="Shldr", lower="ForeArm", bone=(0.998, -0.061, 0.017), hinge=(-0.11, -0.86, 0.50)),
        leg=Limb(upper="Thigh", lower="Shin", bone=(0.0, -1.0, 0.02), hinge=(1.0, 0.0, 0.0)),
        foot="Foot",
        hand="Hand",
        legs_too_long=True,
        pronation=30.0,
        names=lambda side, joint: side[0] + joint,
    ),
    "deepmimic": Rig(
        pelvis="root",
        chest="chest",
        head="neck",
        arm=Limb(upper="shoulder", lower="elbow", bone=(0.0, -1.0, 0.0), hinge=(-1.0, 0.0, 0.0)),
        leg=Limb(upper="hip", lower="knee", bone=(0.0, -1.0, 0.0), hinge=(1.0, 0.0, 0.0)),
        foot="ankle",
    ),
}
"""By the name of the source."""


@dataclass(frozen=True, kw_only=True)
class Range:
    """What a joint can do about one axis, degrees; left side."""

    axis: tuple[float, float, float]
    low: float
    high: float


RANGES = {
    "elbow": Range(axis=(0.0, -1.0, 0.0), low=-10.0, high=155.0),
    "knee": Range(axis=(1.0, 0.0, 0.0), low=-10.0, high=165.0),
    "wrist": Range(axis=(1.0, 0.0, 0.0), low=-50.0, high=50.0),  # half of the forearm's turn
    "hip": Range(axis=(0.0, 1.0, 0.0), low=-100.0, high=100.0),
}
LARGEST = {"spine1": 33.0, "neck": 50.0, "left_ankle": 75.0, "right_ankle": 75.0}
"""Degrees of any rotation of a joint; spine1 has a third of the trunk's bending, neck half of the head's."""
FASTEST = 1800.0
"""Degrees per second of any joint. What is faster (60 degrees in a frame of 30 per second) are limbs that flip."""


def load(folder: Path) -> list[MotionClip]:
    """All motion capture in a folder as poses of the body, without frames that cannot be right (`plausible`).

    Args:
        folder: Holds the folders of `mocap.READERS`, or some of them.

    Raises:
        InputError: There are none, a file is of another form, or no frame is usable.
    """
    clips = [_clip(motion) for motion in read_motions(folder)]
    if not any(len(clip.body_pose) for clip in clips):
        raise InputError(f"{folder}: none of its frames is a plausible pose. Take the motion capture from its source.")
    return [clip for clip in clips if len(clip.body_pose)]


def _clip(motion: SourceMotion) -> MotionClip:
    pose = retarget(motion)
    kept = plausible(pose, motion.fps)
    return MotionClip(
        name=motion.name,
        subject=motion.subject,
        source=motion.source,
        fps=motion.fps,
        body_pose=pose[kept],
        dropped=int((~kept).sum()),
    )


def retarget(motion: SourceMotion) -> Float[np.ndarray, "T 63"]:
    """Axis-angle of SMPL-X's joints 1 to 21 for every frame of a clip; the root's is the source's pelvis in the world."""
    rig = RIGS[motion.source]
    local = np.tile(np.eye(3), (len(motion), N_BODY_JOINTS + 1, 1, 1))
    pelvis, chest = motion.world(rig.pelvis), motion.world(rig.chest)
    _share(local, SPINE, _between(pelvis, chest))
    _share(local, ("neck", "head"), _between(chest, motion.world(rig.head)))
    for side, sign in SIDES.items():
        upper, lower = _limb(motion, rig, "arm", side)
        collar = collar_rotation(_between(chest, upper)[..., 0] * sign, side)
        twist = _pronation(motion, rig, side)
        local[:, JOINT[f"{side}_collar"]] = collar
        local[:, JOINT[f"{side}_shoulder"]] = _between(chest @ collar, upper)
        local[:, JOINT[f"{side}_elbow"]] = lower @ _about_x(PRONATION_OF_ELBOW * twist)
        local[:, JOINT[f"{side}_wrist"]] = _about_x((1 - PRONATION_OF_ELBOW) * twist)
        thigh, knee = _limb(motion, rig, "leg", side)
        local[:, JOINT[f"{side}_hip"]] = _between(pelvis, thigh)
        local[:, JOINT[f"{side}_knee"]] = knee
        local[:, JOINT[f"{side}_ankle"]] = _between(thigh @ knee, motion.world(rig.names(side, rig.foot)))
    return Rotation.from_matrix(local[:, 1:].reshape(-1, 3, 3)).as_rotvec().reshape(len(motion), -1)


def collar_rotation(arm: Float[np.ndarray, "T 3"], side: str) -> Float[np.ndarray, "T 3 3"]:
    """Rotation of a collar for an upper arm's direction.

    Scapulohumeral rhythm (Inman, Saunders and Abbott, "Observations on the function of the shoulder joint", J. Bone
    Joint Surg. 26, 1944): beyond the first 30 degrees of the arm's elevation the scapula takes one degree of every
    three. SMPL-X's T-pose is an elevation of 90 degrees and holds 20 of these; hanging arms lower the collar by them,
    an arm straight up raises it by 30. Reaching forward draws the scapula along the ribs: 12 degrees of protraction,
    half as much again across the chest, and retraction behind the back (the difference between flexion and abduction
    that Ludewig et al., J. Bone Joint Surg. Am. 91, 2009, found is of that size).

    Args:
        arm: Unit direction from shoulder to elbow in the chest's frame (x to the body's left, y up, z forward).
        side: "left" or "right".
    """
    sign = SIDES[side]
    elevation = np.degrees(np.arccos(np.clip(-arm[:, 1], -1, 1)))
    # A rounded corner at 30 degrees: softplus 8 degrees wide.
    scapula = 8 * np.logaddexp(0, (elevation - 30) / 8) / 3
    across = np.maximum(0, -sign * arm[:, 0])
    protraction = 12 * arm[:, 2] * (1 + 0.5 * across)
    angles = np.stack([-sign * protraction, sign * (scapula - 20)], -1)
    return Rotation.from_euler("YZ", angles, degrees=True).as_matrix()


def mirrored(pose: Float[np.ndarray, "T 63"]) -> Float[np.ndarray, "T 63"]:
    """The poses as a mirror shows them: sides swapped, and y and z of every axis-angle negated."""
    joints = pose.reshape(len(pose), N_BODY_JOINTS, 3)
    return (joints[:, _OTHER_SIDE] * np.array([1.0, -1.0, -1.0])).reshape(len(pose), -1)


def _other(name: str) -> str:
    swap = {"left": "right", "right": "left"}
    side, _, joint = name.partition("_")
    return f"{swap[side]}_{joint}" if side in swap else name


_OTHER_SIDE = np.array([JOINT[_other(name)] - 1 for name in list(JOINT)[1 : N_BODY_JOINTS + 1]])


def _limb(motion: SourceMotion, rig: Rig, limb: str, side: str) -> tuple[np.ndarray, np.ndarray]:
    """World rotation of a limb's upper bone, and its hinge joint's rotation against it, in SMPL-X's frames."""
    source: Limb = getattr(rig, limb)
    upper, lower = (motion.world(rig.names(side, joint)) for joint in (source.upper, source.lower))
    alignment = _limb_frame(source, side) @ _limb_frame(BODY[limb], side).T
    rest = BODY[limb]
    axis = _of_side(rest.hinge, side)
    bend = alignment.T @ _between(upper, lower) @ alignment
    upper = upper @ alignment
    if np.median(Rotation.from_matrix(bend).as_rotvec() @ axis) < 0:
        bend = np.swapaxes(bend, -1, -2)
    if limb == "leg" and rig.legs_too_long:
        lengths = [float(np.linalg.norm(motion.skeleton.offsets[motion.skeleton.index(n)])) for n in (rig.names(side, source.lower), rig.names(side, rig.foot))]
        upper, bend = _straightened(upper, bend, axis, lengths)
    return upper, bend


def _straightened(
    upper: Float[np.ndarray, "T 3 3"], knee: Float[np.ndarray, "T 3 3"], axis: np.ndarray, lengths: Sequence[float]
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3 3"]]:
    """A leg whose figure's bones were too long for the captured person: what is too long went into the knee.

    Where even the straightest twentieth of a clip does not reach STRAIGHT_REACH, distances from hip to ankle grow by
    what is missing, at most by LARGEST_STRETCH; the ankle's direction from the hip stays.
    """
    a, b = lengths
    bent = np.maximum(Rotation.from_matrix(knee).as_rotvec() @ axis, 0)
    reach = np.sqrt(a * a + b * b + 2 * a * b * np.cos(bent)) / (a + b)
    scale = np.clip(STRAIGHT_REACH / np.percentile(reach, 95), 1, LARGEST_STRETCH)
    longer = np.maximum(reach, np.minimum(reach * scale, STRAIGHT_REACH)) * (a + b)
    less = np.arccos(np.clip((longer**2 - a * a - b * b) / (2 * a * b), -1, 1))
    behind, less_behind = (np.arctan2(b * np.sin(angle), a + b * np.cos(angle)) for angle in (bent, less))
    turn = Rotation.from_rotvec((behind - less_behind)[:, None] * axis).as_matrix()
    return upper @ turn, Rotation.from_rotvec((less - bent)[:, None] * axis).as_matrix() @ knee


def _limb_frame(limb: Limb, side: str) -> Float[np.ndarray, "3 3"]:
    """Columns: the bone, the hinge made perpendicular to it, and their cross product."""
    bone, hinge = np.array(limb.bone) * [SIDES[side], 1, 1], _of_side(limb.hinge, side)
    bone = bone / np.linalg.norm(bone)
    hinge = hinge - (hinge @ bone) * bone
    hinge = hinge / np.linalg.norm(hinge)
    return np.stack([bone, hinge, np.cross(bone, hinge)], -1)


def _of_side(axis: tuple[float, float, float], side: str) -> Float[np.ndarray, "3"]:
    """The axis of the left side, or its mirror's image: the same motion of the right side."""
    return np.array(axis) * (1, SIDES[side], SIDES[side])


def _pronation(motion: SourceMotion, rig: Rig, side: str) -> Float[np.ndarray, "T"]:
    """Radians by which the hand is turned about the forearm; positive about x turns palms backward from the T-pose."""
    if rig.hand is None:
        return np.zeros(len(motion))
    forearm, hand = (motion.world(rig.names(side, joint)) for joint in (rig.arm.lower, rig.hand))
    q = Rotation.from_matrix(_between(forearm, hand)).as_quat()
    angle = 2 * np.arctan2(q[:, 0], q[:, 3])
    return (angle + np.pi) % (2 * np.pi) - np.pi + np.radians(rig.pronation)


def _share(local: np.ndarray, joints: Iterable[str], rotation: Float[np.ndarray, "T 3 3"]) -> None:
    """Spread a rotation evenly over joints in a row."""
    names = tuple(joints)
    part = Rotation.from_rotvec(Rotation.from_matrix(rotation).as_rotvec() / len(names)).as_matrix()
    for name in names:
        local[:, JOINT[name]] = part


def _between(parent: np.ndarray, child: np.ndarray) -> np.ndarray:
    return np.swapaxes(parent, -1, -2) @ child


def _about_x(angle: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T 3 3"]:
    return Rotation.from_euler("x", angle[:, None]).as_matrix()


def plausible(pose: Float[np.ndarray, "T 63"], fps: float) -> Bool[np.ndarray, "T"]:
    """Frames that a body can have: joints within RANGES and LARGEST, and not next to a jump faster than FASTEST."""
    joints = pose.reshape(len(pose), N_BODY_JOINTS, 3)
    possible = np.ones(len(pose), bool)
    for side in SIDES:
        for name, limits in RANGES.items():
            angle = _twist(joints[:, JOINT[f"{side}_{name}"] - 1], _of_side(limits.axis, side))
            possible &= (limits.low <= angle) & (angle <= limits.high)
    for name, largest in LARGEST.items():
        possible &= np.linalg.norm(joints[:, JOINT[name] - 1], axis=-1) <= np.radians(largest)
    turns = Rotation.from_rotvec(joints.reshape(-1, 3))
    steps = turns[:-N_BODY_JOINTS].inv() * turns[N_BODY_JOINTS:]
    jumps = (steps.magnitude().reshape(-1, N_BODY_JOINTS) > np.radians(FASTEST) / fps).any(1)
    possible[1:] &= ~jumps
    possible[:-1] &= ~jumps
    return possible


def _twist(rotations: Float[np.ndarray, "T 3"], axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "T"]:
    """Degrees, -180 to 180, by which axis-angle rotations turn about an axis (swing-twist decomposition)."""
    q = Rotation.from_rotvec(rotations).as_quat()
    angle = 2 * np.arctan2(q[:, :3] @ axis, q[:, 3])
    return np.degrees((angle + np.pi) % (2 * np.pi) - np.pi)
