"""The term of joint limits (beyond the paper): what no body can do costs, what it can is free."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.joint_ranges import JointRange
from fitting_core.body.model import JOINT
from fitting_core.fit.terms.joint_angles import AngleTable
from fitting_core.fit.terms.terms import Rows
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.point_jacobian import PointJacobian

_BODY = range(JOINT["left_hip"], JOINT["right_wrist"] + 1)
_FINGERS = range(JOINT["left_index1"], JOINT["right_thumb3"] + 1)


@dataclass(frozen=True, eq=False)
class Limits:
    """weight x how far flexion, side motion and twist of a joint lie beyond their range (see body/joint_ranges.py).

    Seen from the front, a thigh that points at the camera and one that points away look alike; only one can be. Without
    limits a fit of sitting down bent the knees sideways by 75 degrees, at the keypoints.
    """

    weight: float
    table: AngleTable
    low: Float[Tensor, "n 3"]
    high: Float[Tensor, "n 3"]
    fingers: bool
    """Whether any of the joints is a finger's."""
    name: str = "limits"

    @staticmethod
    def of(weight: float, ranges: Mapping[str, JointRange], *, fingers: bool, like: Tensor) -> "Limits":
        """The term for these ranges, in the type and on the device of `like`; `fingers`: not of the body alone."""
        ranges = {name: joint for name, joint in ranges.items() if fingers or JOINT[name] in _BODY}
        table = AngleTable.of(ranges, like)
        bounds = torch.stack([like.new_tensor(joint.bounds) for joint in ranges.values()]).deg2rad()
        low, high = table.ordered(bounds).unbind(-1)
        return Limits(weight, table, low, high, any(JOINT[name] in _FINGERS for name in ranges))

    @cached_property
    def place(self) -> Int[Tensor, "n"]:
        """Of each joint among body joints and fingers."""
        joint = self.table.joint
        return torch.where(joint < _FINGERS.start, joint - _BODY.start, joint - _FINGERS.start + len(_BODY))

    def pose(self, e: Estimate) -> Float[Tensor, "B n 3"]:
        """Axis-angle of the limited joints, fingers decoded."""
        pose = e.body_pose
        if self.fingers:
            pose = torch.cat([pose, e.view.parametrisation.hands(e.state)], 1)
        return pose.view(len(pose), -1, 3)[:, self.place]

    def excess(self, pose: Float[Tensor, "B n 3"]) -> Float[Tensor, "B n 3"]:
        """Radians beyond the range, 0 inside it."""
        angles = self.table.angles(pose)
        return angles - angles.clamp(self.low, self.high)

    def residual(self, e: Estimate) -> Float[Tensor, "B 3n"]:
        """Weighted radians beyond the range, 0 inside it."""
        return self.weight * self.excess(self.pose(e)).flatten(1)

    def rows(self, e: Estimate, jacobian: PointJacobian) -> Rows:
        """Of the angles that are beyond their range in any frame: most are in none."""
        pose = self.pose(e)
        excess = self.excess(pose)
        joint, angle = (excess != 0).any(0).nonzero(as_tuple=True)
        if not len(joint):
            return Rows(excess[:, 0, :0], excess.new_zeros(len(pose), 0, jacobian.width))
        beyond, row = excess[:, joint, angle], torch.arange(len(joint), device=joint.device)
        slope = self.table[joint].slopes(pose[:, joint], angle)
        by_joint = pose.new_zeros(len(pose), len(joint), len(JOINT), 3)
        by_joint[:, row, self.table.joint[joint]] = slope * (self.weight * (beyond != 0))[..., None]
        rows = jacobian.in_free_columns(by_joint.flatten(0, 1))
        return Rows(self.weight * beyond, rows.view(*beyond.shape, jacobian.width))
