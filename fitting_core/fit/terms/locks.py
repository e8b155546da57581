"""The term of joints locked by a person (beyond the paper)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.model import JOINT
from fitting_core.fit.terms.entry import Entry
from fitting_core.fit.terms.limits import by_axis_angle, quaternion
from fitting_core.fit.terms.setting import Looked, Setting
from fitting_core.fit.terms.term import Derivative, Rows, Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.point_jacobian import PointJacobian
from fitting_core.keypoints import LOCKABLE

LOCK_WEIGHT = 6.0 / np.radians(2.0)
"""Per radian: a person's statement has the weight of one of depth, within two degrees."""
_FIRST = JOINT["left_hip"]
"""Of the joints of the body's pose."""


@dataclass(frozen=True, eq=False)
class Locks(Term):
    """sum of weight^2 (2 sin(a / 2))^2, for the angle a between a joint's rotation and its lock.

    2 sin(a / 2) is the length of the vector part of 2 q_0* q, of the lock's and the joint's quaternions.
    """

    joint: Int[Tensor, "n"]
    """Indices among the 55, of the body's pose."""
    target: Float[Tensor, "T n 3"]
    """Axis-angle relative to the joint's parent, radians."""
    weight: Float[Tensor, "T n"]
    """Per radian; 0 where the joint is free."""
    name: str = "locks"
    derivative: ClassVar = Derivative.ROWS

    def _pose(self, e: Estimate) -> Float[Tensor, "B n 3"]:
        return e.body_pose.view(len(e.body_pose), -1, 3)[:, self.joint - _FIRST]

    def _away(self, e: Estimate) -> Float[Tensor, "B n 3 4"]:
        """The weighted map from a joint's quaternion to its residual."""
        w, vector = quaternion(self.target[e.frames]).split([1, 3], -1)
        x, y, z = vector.unbind(-1)
        zero = torch.zeros_like(x)
        cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).view(*x.shape, 3, 3)
        turn = w[..., None] * torch.eye(3).to(w) - cross
        return 2 * self.weight[e.frames][..., None, None] * torch.cat([-vector[..., None], turn], -1)

    def residual(self, e: Estimate) -> Float[Tensor, "B 3n"]:
        """Weighted, 0 where the joint is free."""
        return (self._away(e) @ quaternion(self._pose(e))[..., None])[..., 0].flatten(1)

    def rows(self, e: Estimate, jacobian: PointJacobian) -> Rows:
        """Three for each joint that is locked in any frame of the clip."""
        pose, away = self._pose(e), self._away(e)
        residual = (away @ quaternion(pose)[..., None])[..., 0]
        slopes = by_axis_angle(pose[:, :, None].expand(-1, -1, 3, -1), away)
        each = torch.arange(len(self.joint), device=pose.device)
        by_joint = pose.new_zeros(*slopes.shape[:3], len(JOINT), 3)
        by_joint[:, each, :, self.joint] = slopes.transpose(0, 1)
        rows = jacobian.in_free_columns(by_joint.flatten(0, 2))
        return Rows(residual.flatten(1), rows.view(len(pose), -1, jacobian.width))


def _make(setting: Setting, looked: Looked, s: int) -> Term | None:
    """In every stage and configuration: whoever locks a joint means it."""
    names, turn = LOCKABLE.values(), setting.observations.turn[:, list(LOCKABLE)]
    locked = turn.isfinite().all(-1)
    used = locked.any(0)
    if not bool(used.any()):
        return None
    joint = torch.tensor([JOINT[name] for name in names], device=used.device)[used]
    return Locks(joint, turn[:, used].nan_to_num(), LOCK_WEIGHT * locked[:, used].to(turn))


ENTRY = Entry(name="locks", kind=Locks, about="a joint that a person has locked keeps its rotation", make=_make)
