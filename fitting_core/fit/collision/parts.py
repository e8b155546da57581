"""Body parts of the triangles, and which parts are neighbours, whose collisions do not count."""

from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting_core.body.model import JOINT, JOINTS, N_JOINTS, BodyModel

_FINGERS = ("index", "middle", "ring", "pinky")

_COARSE_PART = {
    "jaw": "head",
    "left_eye": "head",
    "right_eye": "head",
    "left_foot": "left_ankle",
    "right_foot": "right_ankle",
    **{
        f"{side}_{finger}{k}": f"{side}_{finger}1"
        for side in ("left", "right")
        for finger in (*_FINGERS, "thumb")
        for k in (2, 3)
    },
}
"""Joints whose triangles belong to another joint's part: the face to the head, the toes to the foot, fingers are one
part."""

PART_OF_JOINT = np.array([JOINT[_COARSE_PART.get(name, name)] for name in JOINTS])
"""A part's number is the number of its joint nearest the pelvis."""

_TOUCHING_PARTS = (
    # Soft parts that press on each other in everyday poses: thigh on thigh, thigh on belly, armpit.
    ("left_hip", "right_hip"),
    *((f"{side}_hip", "spine1") for side in ("left", "right")),
    *((f"{side}_shoulder", spine) for side in ("left", "right") for spine in ("spine2", "spine3")),
    # Neighbouring fingers touch whenever a hand is closed.
    *((f"{side}_{a}1", f"{side}_{b}1") for side in ("left", "right") for a, b in pairwise(_FINGERS)),
    *((f"{side}_thumb1", f"{side}_index1") for side in ("left", "right")),
)
"""Neighbours beyond parent and child."""


def body_parts(model: BodyModel) -> Int[np.ndarray, "F"]:
    """Part of each triangle: that of the joints with the largest sum of skinning weights over its corners.

    Returns:
        Joint numbers, as in PART_OF_JOINT.
    """
    return parts_of_faces(model.skinning_weights, model.faces)


def parts_of_faces(skinning_weights: Float[np.ndarray, "V 55"], faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "F"]:
    """Part of each triangle of a mesh with SMPL-X's joints.

    Args:
        skinning_weights: Weight of each joint on each vertex.
        faces: Corners of every triangle.
    """
    membership = np.eye(N_JOINTS)[PART_OF_JOINT]
    weights = skinning_weights @ membership
    return weights[faces].sum(axis=1).argmax(axis=1)


def neighbouring_parts(
    parents: Int[np.ndarray, "55"], parts: Int[np.ndarray, "F"], faces: Int[np.ndarray, "F 3"]
) -> Bool[np.ndarray, "55 55"]:
    """Which parts are the same or neighbours, so that their triangles may intersect.

    Neighbours are parent and child; parts that share a vertex of the mesh; thighs with each other and with the belly;
    upper arms with the ribs beside them; fingers beside each other.

    Args:
        parents: Parent of each joint, -1 for the root.
        parts: Part of each triangle.
        faces: Corners of every triangle.

    Returns:
        Symmetric, true on the diagonal.
    """
    neighbours = np.eye(N_JOINTS, dtype=bool)
    child = np.arange(1, N_JOINTS)
    neighbours[PART_OF_JOINT[child], PART_OF_JOINT[parents[child]]] = True
    for a, b in _TOUCHING_PARTS:
        neighbours[JOINT[a], JOINT[b]] = True
    touches = np.zeros((int(faces.max(initial=-1)) + 1, N_JOINTS), dtype=np.float32)
    touches[faces, parts[:, None]] = 1
    neighbours |= touches.T @ touches > 0
    return neighbours | neighbours.T
