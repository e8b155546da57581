"""A motion put on a rig: from rest pose to rest pose, then feet onto the floor and hands to where they touch.

Let W_j be the turn of SMPL-X's joint j from its rest pose into the world, and D_j its turn when that body stands as the
rig does at rest (`rest_pose`). A joint of the rig that follows j is turned from its own rest by U W_j D_j', with U from
the y-up world to the rig's. So a rig at rest is the fit where the body stands like the rig at rest, and on bones of the
person's own lengths each joint is exactly where the fit has it.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.animation.retargeting.target import Source, Target
from fitting_core.animation.rig import same_hemisphere
from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.model import JOINT
from fitting_core.motion import Motion


@dataclass(frozen=True, kw_only=True, eq=False)
class Posed:
    """SMPL-X's skeleton over T frames in the y-up world, with the motion's one shape and without expression."""

    turns: Float[np.ndarray, "T 55 3 3"]
    """From the rest pose into the world."""
    places: Float[np.ndarray, "T 55 3"]
    """Metres."""
    rest: Float[np.ndarray, "55 3"]
    """The joints at rest, metres."""

    @staticmethod
    def of(motion: Motion) -> "Posed":
        """Of a motion in any axes."""
        shaped = motion.in_axes("y-up").one_shape
        rest = torch.as_tensor(shaped.shaped_body.rest_joints)
        turns = Rotation.from_rotvec(shaped.pose.numpy().reshape(-1, 3)).as_matrix().reshape(len(motion), -1, 3, 3)
        world, joints = pose_joints(
            Tree.of(shaped.body.parents), torch.as_tensor(turns), rest.expand(len(motion), -1, -1)
        )
        places = joints.numpy() - joints[:, :1].numpy() + shaped.pelvis[:, None]
        return Posed(turns=world.numpy(), places=places, rest=rest.numpy())


@dataclass(frozen=True, kw_only=True, eq=False)
class RigMotion:
    """A rig that moves over T frames."""

    target: Target
    moved: Float[np.ndarray, "T K 3 3"]
    """Turns of the joints from their rest, in the rig's world."""
    root: Float[np.ndarray, "T 3"]
    """Where its pelvis is, in its world and unit."""
    base: Float[np.ndarray, "3"]
    """How far what is above the pelvis stands from its rest: Unreal's root is on the floor below the person."""

    @property
    def places(self) -> Float[np.ndarray, "T K 3"]:
        """Where the joints are, in its world and unit."""
        return self.target.placed(self.moved, self.root, self.base)

    @property
    def local(self) -> Float[np.ndarray, "T K 4"]:
        """Quaternions x, y, z, w of each joint's axes against its parent's, without sudden signs."""
        world = self.moved @ self.target.turns
        local = world.copy()
        for k, p in enumerate(self.target.parents):
            if p >= 0:
                local[:, k] = world[:, p].swapaxes(-1, -2) @ world[:, k]
        quaternions = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_quat().reshape(*local.shape[:2], 4)
        return same_hemisphere(quaternions)

    def with_moved(self, changes: dict[int, Float[np.ndarray, "T 3 3"]]) -> "RigMotion":
        """Some joints turned otherwise, and what stays with them."""
        moved = self.moved.copy()
        for k, turns in changes.items():
            moved[:, k] = turns
        return replace(self, moved=following(moved, self.target))


def turned(posed: Posed, target: Target) -> RigMotion:
    """Every joint by its source, the pelvis where the fit has it, scaled; see the module's text."""
    by_joint = target.upright @ posed.turns @ target.rest.swapaxes(-1, -2)
    moved = np.tile(np.eye(3), (len(by_joint), len(target), 1, 1))
    for k, source in enumerate(target.sources):
        if source is not None:
            moved[:, k] = _of_source(source, by_joint, target, k, moved)
        elif target.parents[k] >= 0:
            moved[:, k] = moved[:, target.parents[k]]
    root = target.scale * posed.places[:, 0] @ target.upright.T
    return RigMotion(target=target, moved=moved, root=root, base=np.zeros(3))


def _of_source(
    source: Source, by_joint: np.ndarray, target: Target, k: int, moved: np.ndarray
) -> Float[np.ndarray, "T 3 3"]:
    one = by_joint[:, JOINT[source.joint]]
    if source.twist < 1.0:
        return _twisted(one, moved[:, target.parents[k]], target.places[k] - target.places[target.parents[k]], source)
    if not source.other or source.share == 0.0:
        return one
    other = by_joint[:, JOINT[source.other]]
    return between(one, other, source.share)


def between(one: np.ndarray, other: np.ndarray, share: float | np.ndarray) -> Float[np.ndarray, "T 3 3"]:
    """Turns on the shortest way from one to the other."""
    step = Rotation.from_matrix(one.swapaxes(-1, -2) @ other).as_rotvec()
    return one @ Rotation.from_rotvec(np.asarray(share).reshape(-1, 1) * step).as_matrix()


def _twisted(
    turn: Float[np.ndarray, "T 3 3"], above: Float[np.ndarray, "T 3 3"], bone: Float[np.ndarray, "3"], source: Source
) -> Float[np.ndarray, "T 3 3"]:
    """What is above, and a share of the twist about a bone that a joint has against it.

    The twist of a quaternion about an axis is its part along that axis, made a unit one.
    """
    axis = bone / np.linalg.norm(bone)
    step = Rotation.from_matrix(above.swapaxes(-1, -2) @ turn).as_quat()
    angle = 2 * np.arctan2(step[:, :3] @ axis, step[:, 3])
    angle = (angle + np.pi) % (2 * np.pi) - np.pi
    return above @ Rotation.from_rotvec(source.twist * angle[:, None] * axis).as_matrix()


def following(moved: Float[np.ndarray, "T K 3 3"], target: Target) -> Float[np.ndarray, "T K 3 3"]:
    """The same, with the joints that have no source as their parents are."""
    for k, source in enumerate(target.sources):
        if source is None and target.parents[k] >= 0:
            moved[:, k] = moved[:, target.parents[k]]
    return moved
