"""The TERMS table: which terms a stage's objective has beside the data term, and how each is made."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from fitting_core.collision.term import Collision
from fitting_core.terms import Bending, Limits, Quadratic, Rest, Term, Upright

if TYPE_CHECKING:
    from fitting_core.stages import Stages


def _quadratic(stages: Stages, name: str, where: slice, weight: float, target: Tensor | None = None) -> Quadratic:
    return Quadratic(name, where, stages.xy.new_full((where.stop - where.start,), weight), target)


def _body_pose(stages: Stages, s: int) -> Term:
    p = stages.parametrisation
    weight = stages.config.weights.body_pose[s]
    return _quadratic(stages, "body_pose", p.columns.body, weight, p.prior.neutral.to(stages.xy))


def _hand_pose(stages: Stages, s: int) -> Term:
    return _quadratic(stages, "hand_pose", stages.parametrisation.columns.hands, stages.config.weights.hand_pose[s])


def _jaw(stages: Stages, s: int) -> Term:
    w = stages.config.weights
    weights = stages.xy.new_tensor([w.jaw_open[s], w.jaw_sideways[s], w.jaw_sideways[s]])
    return Quadratic("jaw", stages.parametrisation.columns.jaw, weights)


def _expression(stages: Stages, s: int) -> Term:
    columns = stages.parametrisation.columns
    return _quadratic(stages, "expression", columns.expression, stages.config.weights.expression[s])


def _shape(stages: Stages, s: int) -> Term:
    return _quadratic(stages, "shape", stages.parametrisation.columns.betas, stages.config.weights.shape[s])


def _bending(stages: Stages, s: int) -> Term:
    return Bending(stages.config.weights.bending[s])


def upright(stages: Stages, lean: float, turn: float) -> Term | None:
    """Lean and turn of the root on the frames that show no leg, if there are any."""
    if not (lean or turn) or bool(stages.leg_seen.all()):
        return None
    unheld = (~stages.leg_seen).to(stages.xy)
    return Upright(lean * unheld, turn * unheld)


def _upright(stages: Stages, s: int) -> Term | None:
    return upright(stages, stages.config.weights.lean[s], stages.config.weights.turn[s])


def _limits(stages: Stages, s: int) -> Term | None:
    weight = stages.config.weights.limits[s]
    return Limits(weight) if weight else None


def _rest(stages: Stages, s: int) -> Term | None:
    weight, prior = stages.config.weights.rest[s], stages.parametrisation.prior
    if not weight:
        return None
    unseen = ~torch.as_tensor(stages.observed[:, 1:22], device=stages.device).repeat_interleave(3, 1)
    return Rest(weight * unseen.to(stages.xy), prior.decode(prior.neutral.to(stages.xy)[None])[0])


def _collision(stages: Stages, s: int) -> Term | None:
    weight = stages.config.weights.collision[s]
    return Collision(weight, stages.colliding_body) if weight else None


TERMS: dict[str, Callable[[Stages, int], Term | None]] = {
    "body_pose": _body_pose,
    "hand_pose": _hand_pose,
    "jaw": _jaw,
    "expression": _expression,
    "shape": _shape,
    "bending": _bending,
    "upright": _upright,
    "limits": _limits,
    "rest": _rest,
    "collision": _collision,
}
"""How each term is made from what is constant over a fit and the index (0 to 4) of a stage; None: not in this stage."""


def stage_terms(stages: Stages, stage: int) -> list[Term]:
    """The terms of a stage (1 to 5) beside the data term."""
    made = (make(stages, stage - 1) for make in TERMS.values())
    return [term for term in made if term is not None]
