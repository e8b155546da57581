"""How SMPL-X's body is posed to stand like a rig at rest: from one rest pose to the other."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from fitting_core.body.geometry import shortest_rotation
from fitting_core.body.model import JOINTS

FINGERS = ("index", "middle", "pinky", "ring", "thumb")
ALONG: dict[str, str] = {
    f"{side}_{joint}": f"{side}_{nearer}"
    for side in ("left", "right")
    for joint, nearer in (
        ("shoulder", "elbow"),
        ("elbow", "wrist"),
        ("hip", "knee"),
        ("knee", "ankle"),
        *((f"{finger}{k}", f"{finger}{k + 1}") for finger in FINGERS for k in (1, 2)),
    )
}
"""Joints of limbs, whose bones point where the rig's do, and the joints at their bones' ends. The others, of which rigs
disagree where they lie, stay as they are: pelvis, spine, neck, head, clavicles."""


def rest_turns(
    joints: Float[np.ndarray, "55 3"],
    parents: Int[np.ndarray, "55"],
    directions: Mapping[str, Float[np.ndarray, "3"]],
    *,
    facing: Float[np.ndarray, "3 3"],
    fixed: Mapping[str, Float[np.ndarray, "3 3"]],
) -> Float[np.ndarray, "55 3 3"]:
    """Rotations of all joints from SMPL-X's rest pose into the rig's world.

    A joint rotates with its parent, and from there the shortest way to its direction.

    Args:
        joints: SMPL-X's, at rest.
        parents: Of each of them.
        directions: Of bones in the rig's rest pose, by joints of ALONG.
        facing: The body as a whole: its left, up and ahead in the rig's world, by columns.
        fixed: Joints whose rotations are known.
    """
    turns = np.tile(facing, (len(JOINTS), 1, 1))
    for j, name in enumerate(JOINTS):
        if name in fixed:
            turns[j] = fixed[name]
            continue
        above = facing if parents[j] < 0 or name in ("left_hip", "right_hip") else turns[parents[j]]
        turns[j] = above
        if name in directions:
            bone = joints[JOINTS.index(ALONG[name])] - joints[j]
            turns[j] = shortest_rotation(above @ bone, np.asarray(directions[name], float)) @ above
    return turns


def frame(first: np.ndarray, hint: np.ndarray, order: str) -> Float[np.ndarray, "3 3"]:
    """Axes of a joint: one along a direction, and one that is as near to a hint as it can be.

    Args:
        first: The direction.
        hint: Not along it.
        order: Which axes these two are, such as "yx".
    """
    axes = np.zeros((3, 3))
    a, b = ("xyz".index(letter) for letter in order)
    axes[:, a] = first / np.linalg.norm(first)
    across = hint - (hint @ axes[:, a]) * axes[:, a]
    axes[:, b] = across / np.linalg.norm(across)
    c = 3 - a - b
    axes[:, c] = np.cross(axes[:, (c + 1) % 3], axes[:, (c + 2) % 3])
    return axes
