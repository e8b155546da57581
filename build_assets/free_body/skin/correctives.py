"""Pose correctives: what linear blend skinning gets wrong at each joint, as a linear function of its rotation.

Skin that follows two bones should turn by a share of the angle between them. Linear blend skinning averages the two
positions instead, so elbows collapse and twisted wrists shrink like a sweet's wrapper; nor does a rig without twist
bones spread a twist along the limb. For many rotations of one joint, the difference is found in the rest pose's frame
and regressed on the nine entries of the rotation matrix minus the identity, which is what the file can hold.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from build_assets.free_body.skin.skinning import JAW_OPENING, Skinning, jaw_displacement, joint_mirror
from fitting_core.body.geometry import MIRROR, axis_angle, unit
from fitting_core.body.model import JOINT, JOINTS, N_JOINTS

_ROTATIONS = 60
_BLEND = 0.6  # of the way from linear to spherical blending, which bulges where a limb bends
_RIDGE = 1e-2
_DAMPING = 1e-3  # keeps blends of opposite rotations invertible
_NEGLIGIBLE = 2e-5  # metres per unit
_SHARED = 1e-3  # skin whose weight is this far from 0 and 1 lies at the joint


@dataclass(frozen=True, kw_only=True)
class _Range:
    """The rotations that a joint is corrected for."""

    degrees: float
    axes: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """How much it turns about x, y and z."""


_RANGES = {
    "hip": _Range(degrees=100),
    "knee": _Range(degrees=130, axes=(1.0, 0.35, 0.3)),
    "ankle": _Range(degrees=45),
    "foot": _Range(degrees=40),
    "neck": _Range(degrees=45),
    "head": _Range(degrees=45),
    "shoulder": _Range(degrees=100),
    "elbow": _Range(degrees=130, axes=(0.5, 1.0, 0.3)),
    "wrist": _Range(degrees=100, axes=(1.5, 0.7, 1.0)),  # it twists further than it bends
}
_OTHER = _Range(degrees=30)
_FINGER = _Range(degrees=80, axes=(0.3, 0.6, 1.0))


@dataclass(frozen=True, kw_only=True)
class _TwistSpread:
    """A limb along which a joint's twist is spread."""

    start: str
    end: str
    before: bool
    """The limb lies before the joint and follows part of its twist; else after it, and lags behind."""


_TWISTS = {
    "wrist": _TwistSpread(start="elbow", end="wrist", before=True),
    "shoulder": _TwistSpread(start="shoulder", end="elbow", before=False),
    "hip": _TwistSpread(start="hip", end="knee", before=False),
    "head": _TwistSpread(start="neck", end="head", before=True),
}
_LAG = 0.9  # of the twist is missing where the limb starts


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bend:
    """The skin about one joint, and how much of its rotation each vertex follows."""

    skin: Int[np.ndarray, "n"]
    offsets: Float[np.ndarray, "n 3"]
    """From the joint, in metres."""
    swing: Float[np.ndarray, "n"]
    """The weight that linear blend skinning uses for all of the rotation."""
    twist: Float[np.ndarray, "n"]
    """The share of the twist about `axis` that the vertex should follow."""
    axis: Float[np.ndarray, "3"] | None


def pose_correctives(
    rest: Float[np.ndarray, "V 3"],
    joints: Float[np.ndarray, "55 3"],
    parents: Int[np.ndarray, "55"],
    skinning: Skinning,
    mirror: Int[np.ndarray, "V"],
    random: np.random.Generator,
) -> Float[np.ndarray, "V 3 486"]:
    """Correctives of every joint but the root, in metres per unit of rotation matrix entry; symmetric.

    Args:
        rest: the mean body's vertices in the rest pose.
        joints: its joints.
        parents: parent of each joint, -1 for the root.
        skinning: its weights.
        mirror: the vertex on the body's other side.
        random: draws the rotations that the correctives are fitted to.
    """
    correctives = np.zeros((len(rest), 3, N_JOINTS - 1, 9), np.float32)
    for joint, other in list(enumerate(joint_mirror()))[1:]:
        if other < joint:
            correctives[:, :, joint - 1] = _mirrored(correctives[:, :, other - 1], mirror)
            continue
        if joint == JOINT["jaw"]:
            found = _jaw_corrective(rest, joints[joint], skinning)
        else:
            found = np.zeros((len(rest), 3, 9))
            bend = _bend_of(joint, rest, joints, parents, skinning.weights)
            found[bend.skin] = _fit(bend, _draw_rotations(joint, random))
        if other == joint:
            found = (found + _mirrored(found, mirror)) / 2
        correctives[:, :, joint - 1] = found
    return correctives.reshape(len(rest), 3, -1)


def _mirrored(corrective: Float[np.ndarray, "V 3 9"], mirror: Int[np.ndarray, "V"]) -> Float[np.ndarray, "V 3 9"]:
    """The same corrective for the joint on the other side."""
    return corrective[mirror] * MIRROR[:, None] * np.outer(MIRROR, MIRROR).ravel()


def _subtree(joint: int, parents: Int[np.ndarray, "55"]) -> list[int]:
    """The joint and all that hang on it."""
    members = [joint]
    for child in range(joint + 1, len(parents)):
        if parents[child] in members:
            members.append(child)
    return members


def _bend_of(
    joint: int,
    rest: Float[np.ndarray, "V 3"],
    joints: Float[np.ndarray, "55 3"],
    parents: Int[np.ndarray, "55"],
    weights: Float[np.ndarray, "V 55"],
) -> _Bend:
    swing = weights[:, _subtree(joint, parents)].sum(1)
    twist, axis = swing, None
    side, _, kind = JOINTS[joint].rpartition("_")
    if kind in _TWISTS:
        limb = _TWISTS[kind]
        start, end = (JOINT["_".join(filter(None, (side, name)))] for name in (limb.start, limb.end))
        length = np.linalg.norm(joints[end] - joints[start])
        axis = (joints[end] - joints[start]) / length
        along = np.clip((rest - joints[start]) @ axis / length, 0, 1)
        follows = swing + (1 - swing) * weights[:, start] * along
        lags = swing * (1 - _LAG * weights[:, start] * (1 - along))
        twist = follows if limb.before else lags
    at_joint = (swing > _SHARED) & (swing < 1 - _SHARED) | (np.abs(twist - swing) > _SHARED)
    skin = np.flatnonzero(at_joint)
    return _Bend(skin=skin, offsets=rest[skin] - joints[joint], swing=swing[skin], twist=twist[skin], axis=axis)


def _draw_rotations(joint: int, random: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Axis-angle vectors over the joint's range."""
    name = JOINTS[joint]
    is_finger = name[-1].isdigit() and not name.startswith("spine")
    span = _FINGER if is_finger else _RANGES.get(name.rpartition("_")[2], _OTHER)
    axes = unit(unit(random.normal(size=(_ROTATIONS, 3))) * span.axes)
    return axes * np.radians(span.degrees) * random.uniform(0.15, 1.0, (_ROTATIONS, 1))


def _fit(bend: _Bend, rotations: Float[np.ndarray, "r 3"]) -> Float[np.ndarray, "n 3 9"]:
    """Ridge regression of the wanted offsets on the rotation matrices."""
    matrices = axis_angle(rotations)
    inputs = (matrices - np.eye(3)).reshape(len(rotations), 9)
    wanted = np.stack([_wanted_offset(bend, rotation) for rotation in rotations]).reshape(len(rotations), -1)
    found = np.linalg.solve(inputs.T @ inputs + _RIDGE * np.eye(9), inputs.T @ wanted).reshape(9, -1, 3)
    found[:, np.abs(found).max((0, 2)) < _NEGLIGIBLE] = 0
    return found.transpose(1, 2, 0)


def _wanted_offset(bend: _Bend, rotation: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
    """What to add in the rest pose so that skinning takes each vertex to where it should be."""
    swing, twist = _swing_twist(rotation, bend.axis)
    share = bend.swing[:, None, None]
    spherical = axis_angle(swing * bend.swing[:, None])
    linear = (1 - share) * np.eye(3) + share * axis_angle(swing)
    # Only the swing is blended: a spherical twist does not bulge, and a linear one is what shrinks.
    target = (_BLEND * spherical + (1 - _BLEND) * linear) @ axis_angle(twist * bend.twist[:, None])
    skinned = (1 - share) * np.eye(3) + share * axis_angle(rotation)
    missing = np.einsum("nij,nj->ni", target - skinned, bend.offsets)
    return np.linalg.solve(skinned + _DAMPING * np.eye(3), missing[..., None])[..., 0]


def _swing_twist(
    rotation: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"] | None
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Axis-angle vectors of a twist about an axis and of the swing after it; without an axis all is swing."""
    if axis is None:
        return rotation, np.zeros(3)
    whole = Rotation.from_rotvec(rotation)
    x, y, z, w = whole.as_quat()
    twist = axis * 2 * np.arctan2(np.array([x, y, z]) @ axis, w)
    return (whole * Rotation.from_rotvec(-twist)).as_rotvec(), twist


def _jaw_corrective(
    rest: Float[np.ndarray, "V 3"], jaw: Float[np.ndarray, "3"], skinning: Skinning
) -> Float[np.ndarray, "V 3 9"]:
    """What skinning leaves of MakeHuman's jawOpen action, in proportion to the sine of the opening."""
    share = skinning.weights[:, JOINT["jaw"], None]
    missing = skinning.jaw_open - share * jaw_displacement(rest, jaw)
    opened = axis_angle(np.array([JAW_OPENING, 0, 0]))
    blend = (1 - share[..., None]) * np.eye(3) + share[..., None] * opened
    offset = np.linalg.solve(blend, missing[..., None])[..., 0]
    corrective = np.zeros((len(rest), 3, 3, 3))
    # Of a rotation about x, entry (2, 1) minus entry (1, 2) is twice the sine.
    corrective[:, :, 2, 1] = offset / (2 * np.sin(JAW_OPENING))
    corrective[:, :, 1, 2] = -corrective[:, :, 2, 1]
    return corrective.reshape(len(rest), 3, 9)
