"""The term of a root that leans or turns if no leg is seen (beyond the paper)."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.fit.compiled.body import add_row
from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import NUMBER
from fitting_core.fit.terms.context import TermContext
from fitting_core.fit.terms.entry import Entry, Kernel
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate


@dataclass(frozen=True)
class Upright(Term):
    """Lean and turn of the root if no leg is seen.

    lean x the horizontal part (x and z) of the root's up axis in camera space, and turn x the sideways part (x) of its
    forward axis. Nothing else holds the root there: it leaned 67 degrees on average at 1-3 px error, and turned by up
    to 27 degrees on a signer who faces the camera, because shoulders narrower than the model's ask for it.
    """

    lean: Float[Tensor, "T"]
    turn: Float[Tensor, "T"]
    name: str = "upright"

    @staticmethod
    def of(context: TermContext, lean: float, turn: float) -> "Upright | None":
        """With these weights on the frames that show no leg, if any."""
        unheld = ~(context.observations.leg_seen | context.near_start)
        if not (lean or turn) or not bool(unheld.any()):
            return None
        unheld = unheld.to(context.parametrisation.like)
        return Upright(lean * unheld, turn * unheld)

    def residual(self, e: Estimate) -> Tensor:
        """x and z of the body's y axis, x of its z axis."""
        up, forward = e.state.orient[:, [0, 2], 1], e.state.orient[:, :1, 2]
        return torch.cat([self.lean[e.frames, None] * up, self.turn[e.frames, None] * forward], 1)


@helper
def _cost(c, frame, orient, x, s, derivatives):
    cost, lean, turn = 0.0, c.frames[frame].lean, c.frames[frame].turn
    if lean == 0.0 and turn == 0.0:
        return cost
    cost += lean * lean * (orient[0, 1] * orient[0, 1] + orient[2, 1] * orient[2, 1])
    cost += turn * turn * orient[0, 2] * orient[0, 2]
    for row in range(3 if derivatives else 0):
        weight, axis = (lean, 1) if row < 2 else (turn, 2)
        y0, y1, y2 = weight * orient[0, axis], weight * orient[1, axis], weight * orient[2, axis]
        # A turn d about the axes of camera space moves the axis y = R a by d x y = -hat(y) d: row z, and else row x.
        if row == 1:
            residual, s.v[0], s.v[1], s.v[2] = y2, y1, -y0, 0.0
        else:
            residual, s.v[0], s.v[1], s.v[2] = y0, 0.0, y2, -y1
        add_row(s, 0, s.v, 3, 1.0, residual)
    return cost


ENTRY = Entry(
    name="upright",
    kind=Upright,
    about="if no leg is seen, the body does not lean or turn away",
    make=lambda context, looked, s: Upright.of(context, context.config.weights.lean[s], context.config.weights.turn[s]),
    weights=(
        "lean",
        "turn",
    ),
    kernel=Kernel(
        constants=lambda term: {"lean": term.lean, "turn": term.turn},
        frame=(("lean", NUMBER), ("turn", NUMBER)),
        cost=_cost,
    ),
)
