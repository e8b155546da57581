"""Takes MakeHuman's A-pose to SMPL-X's rest pose: a T-pose with flat hands, palms down, and straight legs."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from build_assets.free_body.makehuman import Rig
from fitting_core.body.geometry import MIRROR, axis_angle, frame, shortest_rotation, unit
from fitting_core.body.model import JOINT, N_JOINTS

PELVIS = np.array([0.0, -0.35, 0.012])
"""Where the pelvis lies in every rest pose, in metres: about where SMPL-X's own files have it."""
FINGER_BONES = {"thumb": 1, "index": 2, "middle": 3, "ring": 4, "pinky": 5}
"""The number of each finger in the names of MakeHuman's bones."""
SIDES = {"L": "left", "R": "right"}
"""Side endings of bones, and prefixes of joints."""

_CLAVICLE_LIFT, _SHOULDER_LIFT = np.radians(10), np.radians(18)
_THIGH, _SHIN = np.array([0.05, -0.998, 0.02]), np.array([0.03, -0.998, -0.05])
_SPREAD = {"index": 6.0, "middle": 0.0, "ring": -5.0, "pinky": -11.0}  # degrees towards the thumb
_DROOP = np.radians(2.0)  # how far fingers point below the horizontal
_THUMB = np.array([[0.62, -0.30, 0.72], [0.78, -0.18, 0.60], [0.86, -0.14, 0.49]])

_MIDDLE_JOINTS = {
    "pelvis": "spine04",
    "spine1": "spine03",
    "spine2": "spine02",
    "spine3": "spine01",
    "neck": "neck01",
    "head": "head",
    "jaw": "jaw",
}
_SIDE_JOINTS = {
    "hip": "upperleg01",
    "knee": "lowerleg01",
    "ankle": "foot",
    "collar": "clavicle",
    "shoulder": "upperarm01",
    "elbow": "lowerarm01",
    "wrist": "wrist",
    "eye": "eye",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class RestBody:
    """One body in the rest pose, in metres; the pelvis lies at PELVIS."""

    vertices: Float[np.ndarray, "V 3"]
    """The vertices that were asked for."""
    bone_heads: Float[np.ndarray, "bones 3"]
    bone_tails: Float[np.ndarray, "bones 3"]
    joints: Float[np.ndarray, "55 3"]
    """SMPL-X's joints."""


def rest_body(rig: Rig, body: Float[np.ndarray, "N 3"], used: Int[np.ndarray, "V"]) -> RestBody:
    """Poses one A-posed body.

    Args:
        rig: MakeHuman's skeleton.
        body: vertices of the base mesh in the A-pose, metres.
        used: which vertices to pose.
    """
    heads, tails = rig.heads @ body, rig.tails @ body
    rotations = _rest_rotations(rig, heads, tails)
    posed = np.zeros_like(heads)
    for bone, parent in enumerate(rig.parents):
        moved = posed[parent] + rotations[parent] @ (heads[bone] - heads[parent])
        posed[bone] = heads[bone] if parent < 0 else moved
    offsets = posed - np.einsum("bij,bj->bi", rotations, heads)
    blended = rig.weights[used] @ np.concatenate([rotations.reshape(-1, 9), offsets], axis=1)
    vertices = np.einsum("vij,vj->vi", blended[:, :9].reshape(-1, 3, 3), body[used]) + blended[:, 9:]
    joints = _joints(rig, posed)
    shift = PELVIS - joints[JOINT["pelvis"]]
    return RestBody(
        vertices=vertices + shift,
        bone_heads=posed + shift,
        bone_tails=np.einsum("bij,bj->bi", rotations, tails) + offsets + shift,
        joints=joints + shift,
    )


def _rest_rotations(
    rig: Rig, heads: Float[np.ndarray, "bones 3"], tails: Float[np.ndarray, "bones 3"]
) -> Float[np.ndarray, "bones 3 3"]:
    """Each bone's rotation in the world's frame; bones that are not named turn with their parent."""
    named: dict[str, np.ndarray] = {}
    for side, sign in (("L", 1.0), ("R", -1.0)):
        ends = {n.removesuffix(f".{side}"): i for i, n in enumerate(rig.bones) if n.endswith(f".{side}")}
        head = {name: heads[i] for name, i in ends.items()}
        tail = {name: tails[i] for name, i in ends.items()}
        turned = _arm(head, sign) | _leg(head, sign)
        turned |= _fingers(turned["wrist"], head, tail, sign)
        turned |= {name: np.eye(3) for name in ends if name.startswith("toe")}
        named |= {f"{name}.{side}": rotation for name, rotation in turned.items()}
    rotations = np.zeros((len(rig.bones), 3, 3))
    for bone, (name, parent) in enumerate(zip(rig.bones, rig.parents, strict=True)):
        inherited = np.eye(3) if parent < 0 else rotations[parent]
        rotations[bone] = named.get(name, inherited)
    return rotations


def _arm(head: dict[str, np.ndarray], sign: float) -> dict[str, np.ndarray]:
    """Shoulder girdle to hand. The elbow's hinge becomes vertical, so that it flexes forward about y."""
    outward, up, forward = sign * np.eye(3)[0], np.eye(3)[1], np.eye(3)[2]
    upper = unit(head["lowerarm01"] - head["upperarm01"])
    lower = unit(head["wrist"] - head["lowerarm01"])
    hinge = np.cross(upper, lower)
    straight = frame(outward, -sign * up)
    upper_rotation, lower_rotation = straight @ frame(upper, hinge).T, straight @ frame(lower, hinge).T
    index, middle, pinky = (head[f"finger{FINGER_BONES[name]}-1"] for name in ("index", "middle", "pinky"))
    hand = 0.6 * middle + 0.2 * (index + pinky) - head["wrist"]
    hand_rotation = frame(outward, forward) @ frame(hand, index - pinky).T
    roll = Rotation.from_matrix(hand_rotation @ lower_rotation.T).as_rotvec()[0]
    return {
        "clavicle": axis_angle(np.array([0, 0, sign * _CLAVICLE_LIFT])),
        "shoulder01": axis_angle(np.array([0, 0, sign * _SHOULDER_LIFT])),
        "upperarm01": upper_rotation,
        "upperarm02": upper_rotation,
        "lowerarm01": axis_angle(np.array([0.15 * roll, 0, 0])) @ lower_rotation,
        "lowerarm02": axis_angle(np.array([0.5 * roll, 0, 0])) @ lower_rotation,
        "wrist": hand_rotation,
    }


def _fingers(
    hand: Float[np.ndarray, "3 3"], head: dict[str, np.ndarray], tail: dict[str, np.ndarray], sign: float
) -> dict[str, np.ndarray]:
    """Straight fingers; each bone turns by the smallest angle from the one before, which keeps its natural roll."""
    rotations = {}
    for finger, number in FINGER_BONES.items():
        rotation = hand
        for k in (1, 2, 3):
            bone = f"finger{number}-{k}"
            target = _finger_direction(finger, k) * ([1, 1, 1] if sign > 0 else MIRROR)
            rotation = shortest_rotation(rotation @ (tail[bone] - head[bone]), target) @ rotation
            rotations[bone] = rotation
    return rotations


def _finger_direction(finger: str, k: int) -> Float[np.ndarray, "3"]:
    """Where the k-th bone of a left finger points in the rest pose."""
    if finger == "thumb":
        return unit(_THUMB[k - 1])
    spread = np.radians(_SPREAD[finger])
    return np.array([np.cos(spread) * np.cos(_DROOP), -np.sin(_DROOP), np.sin(spread) * np.cos(_DROOP)])


def _leg(head: dict[str, np.ndarray], sign: float) -> dict[str, np.ndarray]:
    side = [1, 1, 1] if sign > 0 else MIRROR
    thigh = shortest_rotation(head["lowerleg01"] - head["upperleg01"], _THIGH * side)
    shin = shortest_rotation(head["foot"] - head["lowerleg01"], _SHIN * side)
    return {
        "upperleg01": thigh,
        "upperleg02": thigh,
        "lowerleg01": shin,
        "lowerleg02": shin,
        "foot": np.eye(3),
    }


def _joints(rig: Rig, heads: Float[np.ndarray, "bones 3"]) -> Float[np.ndarray, "55 3"]:
    """SMPL-X's joints at the starts of the bones that they stand for."""
    joints = np.zeros((N_JOINTS, 3))
    for joint, bone in _MIDDLE_JOINTS.items():
        joints[JOINT[joint]] = heads[rig.index[bone]]
    for side, name in SIDES.items():
        for joint, bone in _SIDE_JOINTS.items():
            joints[JOINT[f"{name}_{joint}"]] = heads[rig.index[f"{bone}.{side}"]]
        toes = [rig.index[f"toe{k}-1.{side}"] for k in range(1, 6)]
        joints[JOINT[f"{name}_foot"]] = heads[toes].mean(0)
        for finger, number in FINGER_BONES.items():
            for k in (1, 2, 3):
                joints[JOINT[f"{name}_{finger}{k}"]] = heads[rig.index[f"finger{number}-{k}.{side}"]]
    return joints
