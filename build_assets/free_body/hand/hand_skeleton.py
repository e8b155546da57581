"""The left hand's bones in the rest pose, and finger joints as anatomical angles: flexion, spread and twist.

Finger joints turn about the world's axes of the rest pose, as in SMPL-X, which has no frames along the bones. So each
finger's axes are found from where its joints lie. An angle is a component of a joint's axis-angle vector along one of
them; they belong to no body, and are what the hand space is learnt in.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.joint_ranges import axes_of_finger
from fitting_core.body.model import JOINT
from fitting_core.keypoints import FINGERS

FLEXION, SPREAD, TWIST = 0, 1, 2
SIZE = 45
"""Angles of a hand: finger, joint from the knuckle outward, axis."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HandSkeleton:
    """The left hand of one body in the rest pose: fingers along +x, palm down, thumb towards +z."""

    points: Float[np.ndarray, "5 4 3"]
    """Joints and tip of each finger in the order of FINGERS, metres from the wrist."""
    axes: Float[np.ndarray, "5 3 3"]
    """Rows: axes of flexion, spread and twist of each finger. See `finger_axes`."""

    @staticmethod
    def of(joints: Float[np.ndarray, "55 3"], tips: Float[np.ndarray, "5 3"]) -> "HandSkeleton":
        """From a body's joints and the tips of its left fingers in the order of FINGERS, in its rest pose."""
        chains = [[joints[JOINT[f"left_{finger}{k}"]] for k in (1, 2, 3)] for finger in FINGERS]
        points = np.concatenate([chains, tips[:, None]], axis=1) - joints[JOINT["left_wrist"]]
        return HandSkeleton(points=points, axes=finger_axes(joints))

    def pose(self, angles: Float[Tensor, "*n 5 3 3"]) -> Float[Tensor, "*n 5 4 3"]:
        """Joints and tips of posed hands, metres from the wrist."""
        points, axes = (torch.as_tensor(a).to(angles) for a in (self.points, self.axes))
        turns = rotations.exp(torch.einsum("...fja,fad->...fjd", angles, axes))
        world = turns[..., 0, :, :]
        posed = [points[:, 0].expand(*angles.shape[:-3], 5, 3)]
        for k in (1, 2, 3):
            posed.append(posed[-1] + (world @ (points[:, k] - points[:, k - 1])[..., None])[..., 0])
            world = world @ turns[..., k, :, :] if k < 3 else world
        return torch.stack(posed, -2)


def finger_axes(joints: Float[np.ndarray, "55 3"]) -> Float[np.ndarray, "5 3 3"]:
    """Axes of each left finger, see `axes_of_finger`, in the order of FINGERS."""
    return np.stack([axes_of_finger(joints, finger) for finger in FINGERS])


def axis_angle_of(angles: Float[np.ndarray, "*n 45"], axes: Float[np.ndarray, "5 3 3"]) -> Float[np.ndarray, "*n 45"]:
    """From anatomical angles to axis-angle about the world's axes: an orthogonal map."""
    split = np.asarray(angles, float).reshape(*np.shape(angles)[:-1], 5, 3, 3)
    return np.einsum("...fja,fad->...fjd", split, axes).reshape(np.shape(angles))
