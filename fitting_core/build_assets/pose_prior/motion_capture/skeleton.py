"""The free body's skeleton with the points by which poses are compared while a prior is trained."""

from copy import copy

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.model import JOINT, BodyModel

N_POSED = 22
"""The root and the 21 joints of the body pose."""
_ENDS = ("jaw", "left_eye", "right_eye", "left_index1", "left_pinky1", "right_index1", "right_pinky1")
_TOES = {"left_big_toe": "left_foot", "right_big_toe": "right_foot"}


class Skeleton:
    """Poses 22 joints, and points beyond head, hands and feet that show how the last joints are turned."""

    def __init__(self, body: BodyModel) -> None:
        joints = body.rest_joints
        ends = np.concatenate(
            [joints[[JOINT[n] for n in _ENDS]], body.template[[body.surface_keypoints[n] for n in _TOES]]]
        )
        carriers = [int(body.parents[JOINT[n]]) for n in _ENDS] + [JOINT[n] for n in _TOES.values()]
        self.carriers = torch.tensor(carriers)
        self.joints = torch.as_tensor(joints[:N_POSED], dtype=torch.float32)
        self.ends = torch.as_tensor(ends, dtype=torch.float32) - self.joints[self.carriers]
        self._parents = body.parents[:N_POSED]
        self.tree = Tree.of(self._parents)

    def to(self, device: str) -> "Skeleton":
        """The same on a device."""
        moved = copy(self)
        moved.carriers, moved.joints, moved.ends = (t.to(device) for t in (self.carriers, self.joints, self.ends))
        moved.tree = Tree.of(self._parents, device)
        return moved

    def points(self, rotations: Float[Tensor, "B 21 3 3"]) -> Float[Tensor, "B 31 3"]:
        """Joints and end points in metres, the pelvis at its rest position and unturned."""
        return self.posed(rotations)[1]

    def posed(self, rotations: Float[Tensor, "B 21 3 3"]) -> tuple[Float[Tensor, "B 22 3 3"], Float[Tensor, "B 31 3"]]:
        """World rotations of the joints, and the points."""
        root = torch.eye(3, dtype=rotations.dtype, device=rotations.device).expand(len(rotations), 1, 3, 3)
        local = torch.cat([root, rotations], 1)
        rest = self.joints.to(rotations).expand(len(rotations), -1, 3)
        world, position = pose_joints(self.tree, local, rest)
        ends = position[:, self.carriers] + (world[:, self.carriers] @ self.ends.to(rotations)[..., None])[..., 0]
        return world, torch.cat([position, ends], 1)
