"""Forward kinematics of a joint tree, level by level."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.model import JOINT


@dataclass(frozen=True)
class Tree:
    """The joint tree, arranged so that one batched product poses all joints of one depth."""

    parents: Tensor
    """(55,) with the root its own parent."""
    levels: tuple[Tensor, ...]
    """Joints of depth 1, 2, ..."""
    parent_in_previous: tuple[Tensor, ...]
    """For each level, where its joints' parents stand in the level above."""
    unorder: Tensor
    """From joints concatenated by level to joints in SMPL-X's order."""
    ancestors: np.ndarray
    """(55, 55) bool: [j, a] where a lies on the path from j to the root, j included."""

    @staticmethod
    def of(parents: np.ndarray, device: torch.device | str = "cpu") -> "Tree":
        """The tree of a parent list whose root is joint 0 (parent -1)."""
        count = len(parents)
        depth = np.zeros(count, int)
        ancestors = np.eye(count, dtype=bool)
        for j in range(1, count):
            depth[j] = depth[parents[j]] + 1
            ancestors[j] |= ancestors[parents[j]]
        levels = [np.flatnonzero(depth == d) for d in range(depth.max() + 1)]
        place = np.zeros(count, int)
        for level in levels:
            place[level] = np.arange(len(level))

        def index(a: np.ndarray) -> Tensor:
            return torch.as_tensor(a, device=device)

        return Tree(
            parents=index(np.maximum(parents, 0)),
            levels=tuple(index(level) for level in levels[1:]),
            parent_in_previous=tuple(index(place[parents[level]]) for level in levels[1:]),
            unorder=index(np.argsort(np.concatenate(levels))),
            ancestors=ancestors,
        )


def pose_joints(
    tree: Tree, local: Float[Tensor, "B 55 3 3"], joints: Float[Tensor, "B 55 3"]
) -> tuple[Float[Tensor, "B 55 3 3"], Float[Tensor, "B 55 3"]]:
    """World rotations and positions of the joints, from local rotations and rest positions."""
    # W_j = W_p R_j and x_j = x_p + W_p (J_j - J_p), p being j's parent.
    bones = joints - joints[:, tree.parents]
    world, position = [local[:, :1]], [joints[:, :1]]
    for level, up in zip(tree.levels, tree.parent_in_previous, strict=True):
        parent = world[-1][:, up]
        position.append(position[-1][:, up] + (parent @ bones[:, level, :, None])[..., 0])
        world.append(parent @ local[:, level])
    return torch.cat(world, 1)[:, tree.unorder], torch.cat(position, 1)[:, tree.unorder]


def turn_axes(tree: Tree, world: Float[Tensor, "B 55 3 3"], pose: Float[Tensor, "B 54 3"]) -> Float[Tensor, "B 55 3 3"]:
    """Axes in the world, as columns, about which each joint turns with its axis-angle; the root, whose variable is a
    turn in the tangent of its matrix, about those of the world."""
    # exp(v + d) = exp(J_l(v) d) exp(v): a change d of joint j's axis-angle turns all below it about W_p J_l(v) d.
    root = torch.eye(3, dtype=world.dtype, device=world.device).expand(len(world), 1, 3, 3)
    return torch.cat([root, world[:, tree.parents[1:]] @ rotations.left_jacobian(pose)], 1)


def contour_bins(world: Float[Tensor, "B 55 3 3"]) -> Tensor:
    """Which of the 79 contour tables fits the head's yaw, (B,) int64, for world rotations in camera space.

    SMPL-X's rule in a y-up world: -yaw, rounded, cut at 39 degrees, negative values behind the positive ones. Camera
    space is turned by 180 degrees about x against it, which flips the sign; the minus is that turn undone.
    """
    head = world[:, JOINT["head"]]
    angle = torch.atan2(-head[:, 2, 0], head[:, 0, 0].hypot(head[:, 1, 0])).rad2deg().clamp(-39, 39).round().long()
    return torch.where(angle < 0, 39 - angle, angle)
