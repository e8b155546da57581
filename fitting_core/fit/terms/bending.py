"""The term of elbows and knees that bend the wrong way."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from fitting_core.body.model import JOINT
from fitting_core.fit.compiled.body import add_row, joint_axis_angle
from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import BODY, N_BODY, NUMBER
from fitting_core.fit.terms.entry import Entry, Kernel
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate

BENDING = tuple(
    (3 * (JOINT[joint] - 1) + axis, sign)
    for joint, axis, sign in (
        ("left_elbow", 1, 1.0),
        ("right_elbow", 1, -1.0),
        ("left_knee", 0, -1.0),
        ("right_knee", 0, -1.0),
    )
)
"""The bending columns of elbows and knees among the 63, and the sign s that makes the natural bend negative."""


@dataclass(frozen=True)
class Bending(Term):
    """weight x exp(s theta) on elbows (y axis) and knees (x axis), see `BENDING`."""

    weight: float
    name: str = "bending"

    def residual(self, e: Estimate) -> Tensor:
        """One residual for each of the four joints."""
        sign = e.body_pose.new_tensor([s for _, s in BENDING])
        return self.weight * torch.exp(sign * e.body_pose[:, [column for column, _ in BENDING]])


@helper
def _cost(c, frame, orient, x, s, derivatives):
    cost, clip = 0.0, c.clip
    for j in range(N_BODY if clip.bending != 0.0 else 0):
        sign = clip.bending_sign[3 * j : 3 * j + 3]
        if sign[0] == 0.0 and sign[1] == 0.0:
            continue
        joint_axis_angle(c, j + 1, x, s)
        for d in range(3):
            if sign[d] != 0.0:
                residual = clip.bending * math.exp(sign[d] * s.v[d])
                cost += residual * residual
                if derivatives:
                    add_row(s, BODY + 3 * j, s.m[d], 3, residual * residual, sign[d])
    return cost


_SIGN = np.zeros(3 * N_BODY)
_SIGN[[column for column, _ in BENDING]] = [sign for _, sign in BENDING]
ENTRY = Entry(
    name="bending",
    kind=Bending,
    about="elbows and knees do not bend the wrong way",
    make=lambda context, looked, s: Bending(weight) if (weight := context.config.weights.bending[s]) else None,
    weights=("bending",),
    kernel=Kernel(
        constants=lambda term: {"bending": term.weight, "bending_sign": _SIGN},
        clip=(("bending", NUMBER), ("bending_sign", NUMBER, 3 * N_BODY)),  # 0 where nothing bends
        cost=_cost,
    ),
)
