"""Skinning weights on SMPL-X's 55 joints, from those on MakeHuman's 163 bones."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from build_assets.free_body.makehuman import Offsets, Rig
from build_assets.free_body.rest_pose import FINGER_BONES, SIDES
from build_assets.free_body.skin.surface import VertexOrder
from fitting_core.body.geometry import axis_angle
from fitting_core.body.model import JOINT, JOINTS, N_JOINTS, other_side

MAX_INFLUENCES = 4
"""What glTF and game engines take per vertex."""
JAW_OPENING = np.radians(18.0)
"""The rotation of the jaw joint that MakeHuman's jawOpen action comes nearest to."""
_SMALLEST_WEIGHT = 1e-3
_STILL = 1e-4  # metres: vertices that jawOpen moves less count as unmoved
_PIVOT = 0.004  # metres: nearer to the jaw's axis a displacement tells nothing of the weight

_MIDDLE_BONES = {
    "root": "pelvis",
    "spine05": "pelvis",
    "spine04": "pelvis",
    "spine03": "spine1",
    "spine02": "spine2",
    "spine01": "spine3",
    "neck01": "neck",
    "neck02": "neck",
    "neck03": "neck",
}
_JAW_BONES = ("jaw", "special04", "oris01", "oris02", "oris06.L", "oris06.R", "oris07.L", "oris07.R")
_SIDE_BONES = {  # by how their names begin
    "pelvis": "pelvis",
    "clavicle": "{side}_collar",
    "shoulder": "{side}_collar",
    "upperarm": "{side}_shoulder",
    "lowerarm": "{side}_elbow",
    "wrist": "{side}_wrist",
    "metacarpal": "{side}_wrist",
    "upperleg": "{side}_hip",
    "lowerleg": "{side}_knee",
    "foot": "{side}_ankle",
    "toe": "{side}_foot",
    "eye": "{side}_eye",
} | {f"finger{number}-{k}": f"{{side}}_{finger}{k}" for finger, number in FINGER_BONES.items() for k in (1, 2, 3)}
_BREAST_JOINTS = ("spine2", "spine3")


@dataclass(frozen=True, kw_only=True, eq=False)
class Skinning:
    """Skinning weights in the file's order of vertices."""

    weights: Float[np.ndarray, "V 55"]
    """Rows sum to 1 and have at most MAX_INFLUENCES entries."""
    jaw_open: Float[np.ndarray, "V 3"]
    """Metres that the skin moves when the jaw opens by JAW_OPENING about the x axis."""


def skin_body(
    rig: Rig,
    order: VertexOrder,
    jaw_open: Offsets,
    rest: Float[np.ndarray, "V 3"],
    jaw: Float[np.ndarray, "3"],
) -> Skinning:
    """Weights that follow MakeHuman's bones, and at the jaw its jawOpen action.

    Args:
        rig: MakeHuman's skeleton.
        order: the file's order of vertices.
        jaw_open: the target of that action, on the base mesh.
        rest: a typical body's vertices in the rest pose.
        jaw: its jaw joint.
    """
    weights = np.zeros((len(order.base), N_JOINTS))
    for bone, column in zip(rig.bones, rig.weights[order.base].T, strict=True):
        joints = joints_of_bone(bone)
        for joint in joints:
            weights[:, JOINT[joint]] += column / len(joints)
    weights /= weights.sum(1, keepdims=True)
    opening = jaw_open[order.base]
    weights = _follow_jaw(weights, rest, jaw, opening)
    symmetric = (weights + weights[order.mirror][:, joint_mirror()]) / 2
    return Skinning(weights=limit_influences(symmetric), jaw_open=opening)


def joints_of_bone(bone: str) -> tuple[str, ...]:
    """SMPL-X's joints that move what one of MakeHuman's bones moves; bones of the face belong to the head."""
    stem, _, side = bone.partition(".")
    if stem == "breast":
        return _BREAST_JOINTS
    if bone in _JAW_BONES or stem.startswith("tongue"):
        return ("jaw",)
    if bone in _MIDDLE_BONES:
        return (_MIDDLE_BONES[bone],)
    for beginning, joint in _SIDE_BONES.items():
        if side and stem.startswith(beginning):
            return (joint.format(side=SIDES[side]),)
    return ("head",)


def joint_mirror() -> Int[np.ndarray, "55"]:
    """The joint on the other side of the body."""
    return np.array([JOINT[other_side(name)] for name in JOINTS])


def limit_influences(weights: Float[np.ndarray, "V 55"]) -> Float[np.ndarray, "V 55"]:
    """Keeps each vertex's largest weights, at most MAX_INFLUENCES, and makes them sum to 1.

    A left and a right joint of the same weight go or stay together, so that symmetric weights stay symmetric.
    """
    largest_dropped = np.sort(weights, axis=1)[:, -MAX_INFLUENCES - 1, None]
    kept = np.where(weights > np.maximum(largest_dropped + 1e-9, _SMALLEST_WEIGHT), weights, 0)
    return kept / kept.sum(1, keepdims=True)


def _follow_jaw(
    weights: Float[np.ndarray, "V 55"],
    rest: Float[np.ndarray, "V 3"],
    jaw: Float[np.ndarray, "3"],
    opening: Float[np.ndarray, "V 3"],
) -> Float[np.ndarray, "V 55"]:
    """Shares the head's and the jaw's weight so that the jaw joint moves the skin as the action does.

    The bones' own weights miss the action by 6 mm rms, these by 2 mm.
    """
    turned = jaw_displacement(rest, jaw)
    share = weights[:, JOINT["head"]] + weights[:, JOINT["jaw"]]
    square = (turned**2).sum(1)
    fitted = np.clip((opening * turned).sum(1) / np.maximum(square, 1e-9), 0, 1)
    from_bones = np.divide(weights[:, JOINT["jaw"]], share, out=np.zeros_like(share), where=share > 1e-9)
    moved = np.linalg.norm(opening, axis=1) > _STILL
    fraction = np.where(square < _PIVOT**2, np.where(moved, from_bones, 0), fitted)
    fraction = np.where(share > 1e-3, fraction, 0)
    result = weights.copy()
    result[:, JOINT["jaw"]] = fraction * share
    result[:, JOINT["head"]] = (1 - fraction) * share
    return result


def jaw_displacement(rest: Float[np.ndarray, "V 3"], jaw: Float[np.ndarray, "3"]) -> Float[np.ndarray, "V 3"]:
    """How far points move that turn fully with the jaw by JAW_OPENING, in metres."""
    return (rest - jaw) @ (axis_angle(np.array([JAW_OPENING, 0, 0])) - np.eye(3)).T
