"""A motion on another skeleton, from rest pose to rest pose.

Let W_j be the rotation of SMPL-X's joint j from its rest pose into the y-up world, and D_j its rotation when that body
stands as the rig does at rest. A rig joint driven by j is rotated from its own rest by W_j D_j'. So a rig at rest is
the fit where the body stands like the rig at rest, and on bones of the person's own lengths each joint is exactly where
the fit has it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from fitting_core.body.geometry import shortest_rotation, twist, unit
from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.model import JOINT, JOINTS, BodyModel
from fitting_core.keypoints import FINGERS
from fitting_core.motion import Motion

_ALONG: dict[str, str] = {
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
"""Joints of limbs, whose bones point where the rig's do, and the joints at their bones' ends. The others, which rigs
place differently, keep their directions: pelvis, spine, neck, head, clavicles."""


@dataclass(frozen=True)
class Source:
    """What drives a joint of a rig: one of SMPL-X's joints."""

    joint: str
    share: float = 1.0
    """Below 1: only this share of the joint's twist about the rig's bone, relative to the joint above."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Target:
    """K joints at rest in the y-up world, parents before children."""

    names: tuple[str, ...]
    parents: Int[np.ndarray, "K"]
    """-1 for roots."""
    places: Float[np.ndarray, "K 3"]
    """Metres."""
    turns: Float[np.ndarray, "K 3 3"]
    """Rotations of the joints' axes into the world."""
    sources: tuple[Source | None, ...]
    """None: it follows its parent."""
    rest: Float[np.ndarray, "55 3 3"]
    """D_j: rotations of SMPL-X's joints from their rest pose when that body stands as the rig does at rest."""
    root: int
    """The joint that has a position in each frame: the pelvis."""

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def of_joint(self) -> dict[str, int]:
        """The rig's joint that has the rotation of a joint of SMPL-X, by the latter's name."""
        return {s.joint: k for k, s in enumerate(self.sources) if s is not None and s.share == 1.0}

    def placed(
        self, moved: Float[np.ndarray, "T K 3 3"], root: Float[np.ndarray, "T 3"], base: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "T K 3"]:
        """Positions of the joints.

        Args:
            moved: Rotations from rest in the world.
            root: Position of the pelvis.
            base: Offset from rest of the joints above the pelvis.
        """
        places = np.broadcast_to(self.places + base, (len(moved), len(self), 3)).copy()
        for k in self._order_below_root:
            if k == self.root:
                places[:, k] = root
            else:
                p = self.parents[k]
                places[:, k] = places[:, p] + moved[:, p] @ (self.places[k] - self.places[p])
        return places

    @cached_property
    def _order_below_root(self) -> tuple[int, ...]:
        """The pelvis and its descendants, parents first."""
        inside = [self.root]
        for k in range(len(self)):
            if self.parents[k] in inside:
                inside.append(k)
        return tuple(inside)


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedSkeleton:
    """SMPL-X's skeleton over T frames in the y-up world, with the motion's one shape and without expression."""

    turns: Float[np.ndarray, "T 55 3 3"]
    """From the rest pose into the world."""
    places: Float[np.ndarray, "T 55 3"]
    """Metres."""

    @staticmethod
    def of(motion: Motion) -> "PosedSkeleton":
        """The skeleton of a motion in any axes."""
        shaped = motion.in_axes("y-up").one_shape
        rest = torch.as_tensor(shaped.shaped_body.rest_joints)
        turns = Rotation.from_rotvec(shaped.pose.numpy().reshape(-1, 3)).as_matrix().reshape(len(motion), -1, 3, 3)
        world, joints = pose_joints(
            Tree.of(shaped.body.parents), torch.as_tensor(turns), rest.expand(len(motion), -1, -1)
        )
        places = joints.numpy() - joints[:, :1].numpy() + shaped.pelvis[:, None]
        return PosedSkeleton(turns=world.numpy(), places=places)


@dataclass(frozen=True, kw_only=True, eq=False)
class RigMotion:
    """A rig that moves over T frames."""

    target: Target
    moved: Float[np.ndarray, "T K 3 3"]
    """Rotations of the joints from their rest, in the world."""
    root: Float[np.ndarray, "T 3"]
    """Position of the pelvis, metres."""
    base: Float[np.ndarray, "3"]
    """Offset from rest of the joints above the pelvis: Unreal's root is on the floor below the person."""

    @property
    def places(self) -> Float[np.ndarray, "T K 3"]:
        """Positions of the joints, metres."""
        return self.target.placed(self.moved, self.root, self.base)

    @property
    def local(self) -> Float[np.ndarray, "T K 4"]:
        """Quaternions x, y, z, w of each joint's axes against its parent's, without sign flips over time."""
        world = self.moved @ self.target.turns
        local = world.copy()
        for k, p in enumerate(self.target.parents):
            if p >= 0:
                local[:, k] = world[:, p].swapaxes(-1, -2) @ world[:, k]
        quaternions = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_quat().reshape(*local.shape[:2], 4)
        return same_hemisphere(quaternions)


def same_hemisphere(turns: Float[np.ndarray, "T *n 4"]) -> Float[np.ndarray, "T *n 4"]:
    """The same rotations with signs by which each is near the one before: q and -q turn alike, what is between not."""
    flips = np.where((turns[1:] * turns[:-1]).sum(-1) < 0, -1.0, 1.0)
    return turns * np.concatenate([np.ones_like(turns[:1, ..., 0]), flips.cumprod(0)])[..., None]


def own_skeleton(body: BodyModel) -> Target:
    """SMPL-X's joints themselves, of a body whose mean shape is the person's."""
    rest = np.tile(np.eye(3), (len(JOINTS), 1, 1))
    return Target(
        names=tuple(JOINTS),
        parents=body.parents,
        places=body.rest_joints,
        turns=rest,
        sources=tuple(map(Source, JOINTS)),
        rest=rest,
        root=JOINT["pelvis"],
    )


def turned(posed: PosedSkeleton, target: Target) -> RigMotion:
    """Every joint by its source and the pelvis where the fit has it; see the module's text."""
    by_joint = posed.turns @ target.rest.swapaxes(-1, -2)  # W_j D_j'
    moved = np.tile(np.eye(3), (len(by_joint), len(target), 1, 1))
    for k, (source, p) in enumerate(zip(target.sources, target.parents, strict=True)):
        if source is None:
            moved[:, k] = moved[:, p] if p >= 0 else np.eye(3)
        elif source.share == 1.0:
            moved[:, k] = by_joint[:, JOINT[source.joint]]
        else:
            bone = unit(target.places[k] - target.places[p])
            step = Rotation.from_matrix(moved[:, p].swapaxes(-1, -2) @ by_joint[:, JOINT[source.joint]])
            angle = source.share * twist(step, bone)
            moved[:, k] = moved[:, p] @ Rotation.from_rotvec(angle[:, None] * bone).as_matrix()
    return RigMotion(target=target, moved=moved, root=posed.places[:, 0].copy(), base=np.zeros(3))


def rest_turns(
    joints: Float[np.ndarray, "55 3"],
    parents: Int[np.ndarray, "55"],
    directions: Mapping[str, Float[np.ndarray, "3"]],
    fixed: Mapping[str, Float[np.ndarray, "3 3"]],
) -> Float[np.ndarray, "55 3 3"]:
    """Rotations D_j of all joints from SMPL-X's rest pose to the rig's.

    A joint rotates with its parent, and from there by the smallest angle to its bone's direction.

    Args:
        joints: SMPL-X's, at rest.
        parents: Of each of them.
        directions: Of bones in the rig's rest pose, by the limb joint where they begin.
        fixed: Joints whose rotations are known.
    """
    turns = np.tile(np.eye(3), (len(JOINTS), 1, 1))
    for j, name in enumerate(JOINTS):
        if name in fixed:
            turns[j] = fixed[name]
            continue
        if parents[j] >= 0 and name not in ("left_hip", "right_hip"):
            turns[j] = turns[parents[j]]
        if name in directions:
            bone = joints[JOINT[_ALONG[name]]] - joints[j]
            turns[j] = shortest_rotation(turns[j] @ bone, np.asarray(directions[name], float)) @ turns[j]
    return turns


def axes_along(first: np.ndarray, hint: np.ndarray, order: str) -> Float[np.ndarray, "3 3"]:
    """Axes of a joint: one along a direction, and one as near to a hint as possible.

    Args:
        first: The direction.
        hint: Not parallel to it.
        order: Which axes these two are, such as "yx".
    """
    axes = np.zeros((3, 3))
    a, b = ("xyz".index(letter) for letter in order)
    axes[:, a] = unit(first)
    axes[:, b] = unit(hint - (hint @ axes[:, a]) * axes[:, a])
    c = 3 - a - b
    axes[:, c] = np.cross(axes[:, (c + 1) % 3], axes[:, (c + 2) % 3])
    return axes
