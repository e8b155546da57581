"""The term of joints without evidence (beyond the paper)."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.model import POSE_JOINTS
from fitting_core.fit.compiled.body import add_row, joint_axis_angle
from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import BODY, N_BODY, NUMBER
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.entry import Entry, Kernel
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate


@dataclass(frozen=True)
class Rest(Term):
    """weight x (axis-angle pose - target) on joints whose rotation the image does not determine.

    E_T knows only accelerations: without it an arm that leaves the image goes on in a straight line and comes back.
    """

    weight: Float[Tensor, "T 63"]
    target: Float[Tensor, "63"]
    name: str = "rest"

    def residual(self, e: Estimate) -> Tensor:
        """Weighted distance from the target."""
        return self.weight[e.frames] * (e.body_pose - self.target)


@helper
def _cost(c, frame, orient, x, s, derivatives):
    cost, clip, weights = 0.0, c.clip, c.frames[frame].rest_weight
    for j in range(N_BODY):
        weight = weights[3 * j : 3 * j + 3]
        if weight[0] == 0.0:
            continue
        joint_axis_angle(c, j + 1, x, s)
        for d in range(3):
            away = s.v[d] - clip.rest_pose[3 * j + d]
            cost += weight[d] * weight[d] * away * away
            if derivatives:
                add_row(s, BODY + 3 * j, s.m[d], 3, weight[d] * weight[d], away)
    return cost


def _make(context: TermContext, looked: UsedKeypoints, s: int) -> Term | None:
    p, weight = context.parametrisation, context.config.weights.rest[s]
    if not weight:
        return None
    turned = torch.as_tensor(context.turned[:, POSE_JOINTS["body_pose"]], device=p.device)
    unknown = ~turned.repeat_interleave(3, 1)
    return Rest(weight * unknown.to(p.like), p.prior.decode(p.prior.neutral.to(p.like)[None])[0])


ENTRY = Entry(
    name="rest",
    kind=Rest,
    about="joints without evidence stay near the neutral pose",
    make=_make,
    weights=("rest",),
    kernel=Kernel(
        constants=lambda term: {"rest_pose": term.target, "rest_weight": term.weight},
        clip=(("rest_pose", NUMBER, 3 * N_BODY),),
        frame=(("rest_weight", NUMBER, 3 * N_BODY),),
        cost=_cost,
    ),
)
