"""The free body as a moving figure of BODY_25 keypoints: quick enough for millions of poses."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.model import BodyModel
from fitting_core.body.points.pairs import Contour, Joint, Offset, keypoint_points

N_JOINTS = 22
"""Pelvis and the body's joints."""
POINTS = len(kp.BODY_25)


@dataclass(frozen=True, eq=False)
class Figure:
    """Joints, and keypoints that are fixed to one bone each; those on the skin to the bone that they follow most.

    All float32; `*_by_shape` are the derivatives by the ten betas.
    """

    tree: Tree
    joints: Float[Tensor, "22 3"]
    joints_by_shape: Float[Tensor, "22 3 10"]
    points: Float[Tensor, "25 3"]
    points_by_shape: Float[Tensor, "25 3 10"]
    bone: Int[Tensor, "25"]

    @staticmethod
    def of(body: BodyModel) -> "Figure":
        """From the body at rest."""
        by_shape = np.einsum("jv,vdk->jdk", body.joint_regressor, body.shape_directions)
        places, moves, bones = zip(*(_place(body, by_shape, i) for i in range(POINTS)), strict=True)
        tensors = body.rest_joints[:N_JOINTS], by_shape[:N_JOINTS], np.stack(places), np.stack(moves)
        rest, moving, points, shaped = (torch.as_tensor(np.array(a), dtype=torch.float32) for a in tensors)
        return Figure(Tree.of(body.parents[:N_JOINTS]), rest, moving, points, shaped, torch.tensor(bones))

    @property
    def leg(self) -> float:
        """Metres from hip to ankle of the mean shape."""
        hip, knee, ankle = self.joints[[1, 4, 7]]
        return float((hip - knee).norm() + (knee - ankle).norm())

    def pose(self, turns: Float[Tensor, "B 22 3 3"], betas: Float[Tensor, "B 10"]) -> Float[Tensor, "B 25 3"]:
        """Keypoints relative to the pelvis joint, metres, in the space of the root's rotation."""
        rest = self.joints + (betas @ self.joints_by_shape.flatten(0, 1).T).view(-1, N_JOINTS, 3)
        points = self.points + (betas @ self.points_by_shape.flatten(0, 1).T).view(-1, POINTS, 3)
        world, joints = pose_joints(self.tree, turns, rest)
        arms = (points - rest[:, self.bone])[..., None]
        return joints[:, self.bone] + (world[:, self.bone] @ arms)[..., 0] - joints[:, :1]


def _place(body: BodyModel, by_shape: np.ndarray, index: int) -> tuple[np.ndarray, np.ndarray, int]:
    """A keypoint at rest, how it moves with the shape, and its bone."""
    point = keypoint_points(body)[index]
    assert point is not None and not isinstance(point, Contour), kp.BODY_25[index]
    if isinstance(point, Joint):
        return body.rest_joints[point.joint], by_shape[point.joint], point.joint
    if isinstance(point, Offset):
        return body.rest_joints[point.joint] + np.array(point.offset), by_shape[point.joint], point.bone
    vertices, weights = list(point.vertices), np.array(point.weights)
    bone = int((weights @ body.skinning_weights[vertices]).argmax())
    while bone >= N_JOINTS:
        bone = int(body.parents[bone])
    return (
        weights @ body.template[vertices],
        np.einsum("v,vdk->dk", weights, body.shape_directions[vertices]),
        bone,
    )
