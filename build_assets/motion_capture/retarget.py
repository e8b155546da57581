"""Motion capture on SMPL-X's 21 body joints: directions and twists of bones are carried over, not angles.

Sources rest otherwise than in SMPL-X's T-pose, so that their angles mean something else. What keeps its meaning is how
a part of the body has turned in the world since the rest pose. A constant alignment takes SMPL-X's rest bone and hinge
to the source's (rigs.py); the source's rotation after it is SMPL-X's in the world, and parent^-1 world its joint's.

- Trunk: pelvis and chest turn as in the source; spine1 to spine3 share evenly, along the shortest way, what lies
  between them, and neck and head what lies between chest and head.
- Limbs: upper bones have the source's direction, twisted so that the source's hinge is SMPL-X's: y for elbows (left
  negative, right positive), x for knees (positive). A limb that is straight in the source's T-pose is straight. That
  matters for CMU's figure, which draws forearms bent by 18 degrees and shanks by 8 where all angles are zero: taken as
  drawn, 99 % of all right elbows would be bent by 27 degrees or more, and others by 169.
- Forearms: CMU's hands only turn about the forearm. That is pronation, of which elbow and wrist take a half each, as
  the radius turns about the ulna all along. Wrists never bend: no source says how they do.
- Collars: see `collar_rotation`. The upper arm keeps its direction and twist in the world.
- Feet turn as in the source. Toes (SMPL-X's foot joints) stay at rest: no source has them.

Two errors of the CMU conversion are undone: elbows that bend backward throughout a clip (13_18, 01_01, 14_23: the hinge
has the wrong sign, and its opposite makes the boxer's guard and the jumper's symmetric swing), and standing people with
bent knees (`_straightened`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from build_assets.motion_capture.mocap import SourceMotion, read_motions
from build_assets.motion_capture.rigs import BODY, RIGS, SIDES, Limb, Rig, axis_of_side
from fitting_core.body.geometry import twist
from fitting_core.body.model import JOINT, other_side
from fitting_core.errors import InputError

N_BODY_JOINTS = 21
SPINE = ("spine1", "spine2", "spine3")
PRONATION_OF_ELBOW = 0.5
"""The elbow's share of the forearm's twist; the wrist has the rest."""
STRAIGHT_REACH = 0.996
"""From hip to ankle of a leg that stands, as a part of its length: a knee bent by 10 degrees."""
LARGEST_STRETCH = 1.03
FEWEST_PLAUSIBLE = 0.5
"""Of a clip with a smaller part of plausible frames, the others are not trusted either."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionClip:
    """One clip on the body's joints, without the frames that no body can have.

    The world has y up; a body at rest faces +z in it.
    """

    name: str
    subject: str
    source: str
    """A name of mocap.READERS."""
    fps: float
    body_pose: Float[np.ndarray, "T 63"]
    """Axis-angle of joints 1 to 21, radians. Where frames were dropped, neighbours lie further apart in time."""
    orient: Float[np.ndarray, "T 3 3"]
    """World rotation of the root."""
    pelvis: Float[np.ndarray, "T 3"]
    """Where the captured pelvis was, world, metres, on a skeleton with legs of `leg`."""
    feet: Float[np.ndarray, "T 2 3"]
    """Where the captured ankles were, left and right."""
    leg: float
    """Metres from the captured skeleton's hip to its ankle, stretched."""
    frames: Int[np.ndarray, "T"]
    """Numbers of the frames that were kept."""
    dropped: int
    """How many frames were not."""


def load(folder: Path, sources: Sequence[str] = ("cmu", "deepmimic")) -> list[MotionClip]:
    """All motion capture of a folder on the body's joints: plausible frames only, and no clip twice.

    Args:
        folder: Holds the folders of mocap.READERS, or some of them.
        sources: Names of mocap.READERS.

    Raises:
        InputError: A file is missing or of another form, or no motion is left.
    """
    clips: dict[bytes, MotionClip] = {}
    for motion in read_motions(folder, sources):
        clip = _clip(motion)
        if len(clip.body_pose):
            clips.setdefault(clip.body_pose.tobytes(), clip)  # CMU's 14_36 is 14_31 once more
    if not clips:
        raise InputError(f"{folder}: none of its frames is a pose that a body can have. Copy it from its source again.")
    return list(clips.values())


def _clip(motion: SourceMotion) -> MotionClip:
    pose = retarget(motion)
    kept = plausible(pose, motion.fps)
    kept &= kept.mean() >= FEWEST_PLAUSIBLE
    rig = RIGS[motion.source]
    ankles = [motion.skeleton.index(rig.name_of(side, rig.foot)) for side in SIDES]
    pelvis = motion.positions[:, motion.skeleton.index(rig.pelvis)]
    return MotionClip(
        name=motion.name,
        subject=motion.subject,
        source=motion.source,
        fps=motion.fps,
        body_pose=pose[kept],
        orient=motion.world(rig.pelvis)[kept],
        pelvis=pelvis[kept],
        feet=motion.positions[kept][:, ankles],
        leg=sum(_length(motion, rig.name_of("left", end)) for end in (rig.leg.lower, rig.foot)),
        frames=np.flatnonzero(kept),
        dropped=int((~kept).sum()),
    )


def retarget(motion: SourceMotion) -> Float[np.ndarray, "T 63"]:
    """Axis-angle (radians) of SMPL-X's joints 1 to 21, whose root turns as the source's pelvis; all frames."""
    rig = RIGS[motion.source]
    local = np.tile(np.eye(3), (len(motion), N_BODY_JOINTS + 1, 1, 1))
    pelvis, chest = motion.world(rig.pelvis), motion.world(rig.chest)
    local[:, [JOINT[name] for name in SPINE]] = _part(_between(pelvis, chest), 1 / 3)[:, None]
    local[:, [JOINT["neck"], JOINT["head"]]] = _part(_between(chest, motion.world(rig.head)), 1 / 2)[:, None]
    for side in SIDES:
        for name, rotation in (_arm(motion, rig, side, chest) | _leg(motion, rig, side, pelvis)).items():
            local[:, JOINT[f"{side}_{name}"]] = rotation
    return Rotation.from_matrix(local[:, 1:].reshape(-1, 3, 3)).as_rotvec().reshape(len(motion), -1)


def mirrored(pose: Float[np.ndarray, "T 63"]) -> Float[np.ndarray, "T 63"]:
    """The poses as a mirror shows them: sides swapped, y and z of every axis-angle negated."""
    joints = pose.reshape(len(pose), N_BODY_JOINTS, 3)
    return (joints[:, _OTHER_SIDE] * (1, -1, -1)).reshape(len(pose), -1)


_OTHER_SIDE = np.array([JOINT[other_side(name)] - 1 for name in list(JOINT)[1 : N_BODY_JOINTS + 1]])


def _arm(motion: SourceMotion, rig: Rig, side: str, chest: np.ndarray) -> dict[str, np.ndarray]:
    """Rotations of an arm's joints against their parents."""
    upper, bent = _limb(motion, rig.arm, BODY["arm"], rig, side)
    collar = collar_rotation(_between(chest, upper)[..., 0] * SIDES[side], side)
    pronation = _pronation(motion, rig, side)
    return {
        "collar": collar,
        "shoulder": _between(chest @ collar, upper),
        "elbow": _about("y", -SIDES[side] * bent) @ _about("x", PRONATION_OF_ELBOW * pronation),
        "wrist": _about("x", (1 - PRONATION_OF_ELBOW) * pronation),
    }


def _leg(motion: SourceMotion, rig: Rig, side: str, pelvis: np.ndarray) -> dict[str, np.ndarray]:
    """Rotations of a leg's joints against their parents."""
    thigh, bent = _limb(motion, rig.leg, BODY["leg"], rig, side)
    if rig.legs_too_long:
        lengths = [_length(motion, rig.name_of(side, end)) for end in (rig.leg.lower, rig.foot)]
        thigh, bent = _straightened(thigh, bent, *lengths)
    knee, foot = _about("x", bent), motion.world(rig.name_of(side, rig.foot))
    return {"hip": _between(pelvis, thigh), "knee": knee, "ankle": _between(thigh @ knee, foot)}


def collar_rotation(arm: Float[np.ndarray, "T 3"], side: str) -> Float[np.ndarray, "T 3 3"]:
    """Rotation of a collar for an upper arm's direction.

    Scapulohumeral rhythm (Inman, Saunders and Abbott, "Observations on the function of the shoulder joint", J. Bone
    Joint Surg. 26, 1944): beyond the first 30 degrees of the arm's elevation the scapula takes one degree of every
    three. SMPL-X's T-pose has an elevation of 90 degrees and holds 20 of these, so hanging arms lower the collar by 20
    degrees, and an arm straight up raises it by 30. Reaching forward slides the scapula along the ribs: 12 degrees of
    protraction, half as much again across the chest, and retraction behind the back. (Of that size is the difference
    between flexion and abduction in Ludewig et al., J. Bone Joint Surg. Am. 91, 2009.)

    Args:
        arm: Unit direction from shoulder to elbow in the chest's frame (x to the body's left, y up, z forward).
        side: "left" or "right".
    """
    elevation = np.degrees(np.arccos(np.clip(-arm[:, 1], -1, 1)))
    corner = 8.0  # degrees over which the rhythm sets in
    lift = corner / 3 * np.logaddexp(0, (elevation - 30) / corner) - 20
    across = np.maximum(0, -SIDES[side] * arm[:, 0])
    protraction = 12 * arm[:, 2] * (1 + 0.5 * across)
    angles = SIDES[side] * np.stack([-protraction, lift], -1)
    return Rotation.from_euler("YZ", angles, degrees=True).as_matrix()


def _limb(
    motion: SourceMotion, limb: Limb, body: Limb, rig: Rig, side: str
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T"]]:
    """World rotation of a limb's upper bone in SMPL-X's frame, and by how many radians its hinge is bent.

    What the source's lower bone turns about other axes (0.5 % of the elbows' squared angle) is noise: CMU's elbows and
    knees were solved with one degree of freedom, as DeepMimic's are.
    """
    upper, lower = (motion.world(rig.name_of(side, joint)) for joint in (limb.upper, limb.lower))
    axis = axis_of_side(limb.hinge, side)
    bent = twist(Rotation.from_matrix(_between(upper, lower)), axis / np.linalg.norm(axis))
    return upper @ limb.frame(side) @ body.frame(side).T, bent * (-1 if np.median(bent) < 0 else 1)


def _straightened(
    thigh: Float[np.ndarray, "T 3 3"], bent: Float[np.ndarray, "T"], upper: float, lower: float
) -> tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T"]]:
    """A leg whose bones were longer than the captured person's, which bent its knee.

    One skeleton was laid into all subjects' markers. Two per cent too much leg bend a standing knee by 23 degrees: the
    man who directs traffic in 13_26 hardly ever stretches his below 25. Where the straightest twentieth of a clip does
    not reach STRAIGHT_REACH of the leg's length, hip and ankle move apart by the missing factor, at most
    LARGEST_STRETCH. The ankle's direction from the hip and the foot's rotation stay.

    Args:
        thigh: World rotation of the upper bone.
        bent: Radians of the knee.
        upper: Length of the upper bone.
        lower: Length of the lower.
    """
    reach = np.sqrt(upper**2 + lower**2 + 2 * upper * lower * np.cos(bent)) / (upper + lower)
    factor = np.clip(STRAIGHT_REACH / np.percentile(reach, 95), 1, LARGEST_STRETCH)
    reach = np.maximum(reach, np.minimum(factor * reach, STRAIGHT_REACH)) * (upper + lower)
    cosine = np.clip((reach**2 - upper**2 - lower**2) / (2 * upper * lower), -1, 1)
    straighter = np.copysign(np.arccos(cosine), bent)
    before, after = (np.arctan2(lower * np.sin(a), upper + lower * np.cos(a)) for a in (bent, straighter))
    return thigh @ _about("x", before - after), straighter


def _length(motion: SourceMotion, joint: str) -> float:
    """Length of the bone that ends at a joint."""
    return float(np.linalg.norm(motion.skeleton.offsets[motion.skeleton.index(joint)]))


def _pronation(motion: SourceMotion, rig: Rig, side: str) -> Float[np.ndarray, "T"]:
    """Radians about x by which the hand is turned against SMPL-X's rest forearm; positive is pronation."""
    if rig.pronation is None:
        return np.zeros(len(motion))
    forearm, hand = (motion.world(rig.name_of(side, joint)) for joint in (rig.arm.lower, rig.hand))
    turned = Rotation.from_matrix(_between(forearm, hand))
    return twist(turned, np.array([1.0, 0.0, 0.0])) + np.radians(rig.pronation)


def _part(rotation: Float[np.ndarray, "T 3 3"], share: float) -> Float[np.ndarray, "T 3 3"]:
    """The share of a rotation along its shortest way."""
    return Rotation.from_rotvec(share * Rotation.from_matrix(rotation).as_rotvec()).as_matrix()


def _between(parent: Float[np.ndarray, "T 3 3"], child: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3 3"]:
    """The child's rotation against its parent, from both in the world."""
    return np.swapaxes(parent, -1, -2) @ child


def _about(axis: str, angle: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T 3 3"]:
    return Rotation.from_euler(axis, angle[:, None]).as_matrix()


# --- which frames a body can have ---


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
