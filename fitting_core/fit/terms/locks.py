"""The term of joints locked by a person (beyond the paper)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.model import JOINT
from fitting_core.fit.compiled.body import add_row, joint_row
from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import N_BODY, NUMBER
from fitting_core.fit.compiled.turns import quaternion_of_matrix
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.entry import Entry, Kernel
from fitting_core.fit.terms.limits import quaternion_of_axis_angle
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate
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

    def residual(self, e: Estimate) -> Float[Tensor, "B 3n"]:
        """Weighted, 0 where the joint is free."""
        pose = e.body_pose.view(len(e.body_pose), -1, 3)[:, self.joint - _FIRST]
        w, v = quaternion_of_axis_angle(pose).split([1, 3], -1)
        w0, v0 = quaternion_of_axis_angle(self.target[e.frames]).split([1, 3], -1)
        away = w0 * v - w * v0 - torch.linalg.cross(v0, v)
        return (2 * self.weight[e.frames][..., None] * away).flatten(1)


@helper
def _cost(c, frame, orient, x, s, derivatives):
    """With p = q_0* q the residual is 2 weight times the vector part of p.

    A turn d of the joint about its own axes changes q by q (0, d) / 2, so p by p (0, d) / 2, whose vector part is
    (p_w d + p_v x d) / 2.
    """
    cost, locked = 0.0, c.frames[frame]
    for j in range(N_BODY):
        weight = 2.0 * locked.lock_weight[j]
        if weight == 0.0:
            continue
        quaternion_of_matrix(s.local[j + 1], s.q)
        t, q, p = locked.lock_target[j], s.q, s.u
        p[0] = t[0] * q[0] + t[1] * q[1] + t[2] * q[2] + t[3] * q[3]
        p[1] = t[0] * q[1] - q[0] * t[1] - t[2] * q[3] + t[3] * q[2]
        p[2] = t[0] * q[2] - q[0] * t[2] - t[3] * q[1] + t[1] * q[3]
        p[3] = t[0] * q[3] - q[0] * t[3] - t[1] * q[2] + t[2] * q[1]
        for d in range(3):
            cost += weight * weight * p[1 + d] * p[1 + d]
            if derivatives and c.clip.free_body:
                if d == 0:
                    by_turn = (0.5 * p[0], -0.5 * p[3], 0.5 * p[2])
                elif d == 1:
                    by_turn = (0.5 * p[3], 0.5 * p[0], -0.5 * p[1])
                else:
                    by_turn = (-0.5 * p[2], 0.5 * p[1], 0.5 * p[0])
                first, count = joint_row(c, j + 1, by_turn, s)
                add_row(s, first, s.wide, count, weight * weight, p[1 + d])
    return cost


def _constants(term: Locks) -> Mapping[str, Any]:
    weight, target = term.weight.new_zeros(len(term.weight), N_BODY), term.target.new_zeros(len(term.target), N_BODY, 4)
    weight[:, term.joint - _FIRST], target[:, term.joint - _FIRST] = term.weight, quaternion_of_axis_angle(term.target)
    return {"lock_weight": weight, "lock_target": target}


def _make(context: TermContext, looked: UsedKeypoints, s: int) -> Term | None:
    """In every stage and configuration: a lock is a person's statement, not evidence to be weighed."""
    names, turn = LOCKABLE.values(), context.observations.turn[:, list(LOCKABLE)]
    locked = turn.isfinite().all(-1)
    used = locked.any(0)
    if not bool(used.any()):
        return None
    joint = torch.tensor([JOINT[name] for name in names], device=used.device)[used]
    return Locks(joint, turn[:, used].nan_to_num(), LOCK_WEIGHT * locked[:, used].to(turn))


ENTRY = Entry(
    name="locks",
    kind=Locks,
    about="a joint that a person has locked keeps its rotation",
    make=_make,
    kernel=Kernel(
        constants=_constants,
        frame=(("lock_weight", NUMBER, N_BODY), ("lock_target", NUMBER, (N_BODY, 4))),
        cost=_cost,
    ),
)
