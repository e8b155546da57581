"""Quadratic terms: the L2 priors of pose, hands, jaw, expression and shape, and the depth of the camera step."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import MOST_COLUMNS, NUMBER
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.entry import Entry, Kernel
from fitting_core.fit.terms.locks import LOCK_WEIGHT
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.state import Columns, Parametrisation
from fitting_core.keypoints import FINGER_JOINTS

DEPTH_WEIGHT = 100.0
"""Of the camera step: (1e2)^2 (tz - tz_0)^2."""


@dataclass(frozen=True)
class Quadratic(Term):
    """weight x (columns - target): the L2 priors, E_beta', and the depth of the camera step."""

    name: str
    where: slice
    """In the prior's own space."""
    weight: Float[Tensor, "n"] | Float[Tensor, "T n"]
    target: Float[Tensor, "n"] | Float[Tensor, "T n"] | None = None
    once: bool = False

    def residual(self, e: Estimate) -> Tensor:
        """Weighted distance from the target."""
        value = e.state.vector[:, self.where]
        if self.target is not None:
            value = value - _of_frames(self.target, e)
        return _of_frames(self.weight, e) * value

    def jacobian(self, e: Estimate, index: Int[Tensor, "d"]) -> Float[Tensor, "B n d"]:
        """The weights: phase 2 has no kernel for E_beta', and forward differentiation loads torch's compiler: a tenth
        of a fit, and 70 MB."""
        columns = torch.arange(self.where.start, self.where.stop, device=index.device)
        weight = _of_frames(self.weight, e).expand(len(e.state), -1)
        return weight[..., None] * (columns[:, None] == index).to(weight)


def _of_frames(values: Float[Tensor, "n"] | Float[Tensor, "T n"], e: Estimate) -> Tensor:
    return values[e.frames] if values.ndim == 2 else values


@helper
def _cost(c, frame, orient, x, s, derivatives):
    """Of all quadratic terms, by columns of the state."""
    cost, clip, target, weight = 0.0, c.clip, c.frames[frame].target, c.frames[frame].column_weight
    for k in range(0 if derivatives else clip.width - clip.shift):
        away = weight[k] * (x[k] - target[k])
        cost += away * away
    return cost


@helper
def _add_columns(c, frame, x, s):
    clip, target, weight = c.clip, c.frames[frame].target, c.frames[frame].column_weight
    for a in range(clip.free):
        at = clip.index[a]
        square = weight[at] * weight[at]
        s.free_gradient[a] += square * (x[at] - target[at])
        s.free_matrix[a, a] += square


def _constants(term: Quadratic) -> Mapping[str, Any]:
    def in_columns(values: Tensor) -> np.ndarray:
        wide = np.zeros((len(values) if values.ndim == 2 else 1, MOST_COLUMNS))
        wide[:, term.where] = values.detach()
        return wide

    target = term.weight.new_zeros(1) if term.target is None else term.target
    return {"column_weight": in_columns(term.weight), "target": in_columns(target)}


KERNEL = Kernel(
    constants=_constants,
    frame=(("column_weight", NUMBER, MOST_COLUMNS), ("target", NUMBER, MOST_COLUMNS)),
    cost=_cost,
    add_columns=_add_columns,
)


def _l2(
    name: str,
    about: str,
    where: Callable[[Columns], slice],
    *weights: str,
    target: Callable[[Parametrisation], Tensor | None] = lambda p: None,
) -> Entry:
    """Distance of columns from a target (None: zero). Each of the first has a weight; the last is for all others."""

    def make(context: TermContext, looked: UsedKeypoints, s: int) -> Term:
        p = context.parametrisation
        values, columns = [getattr(context.config.weights, weight)[s] for weight in weights], where(p.columns)
        values += values[-1:] * (columns.stop - columns.start - len(values))
        return Quadratic(name, columns, p.like.new_tensor(values), target(p))

    return Entry(name=name, kind=Quadratic, about=about, make=make, weights=weights, kernel=KERNEL)


def held_depth(context: TermContext, depth: Float[Tensor, "T"]) -> Quadratic:
    """In the camera step: the body stays near a guessed distance (metres)."""
    p = context.parametrisation
    z = p.columns.translation.stop - 1
    return Quadratic("depth", slice(z, z + 1), p.like.new_tensor([DEPTH_WEIGHT]), depth[:, None])


_SHAPE = _l2(
    "shape",
    "the shape's betas are small",
    lambda columns: columns.betas,
    "shape",
)


def _shared_shape(context: TermContext, looked: UsedKeypoints, s: int) -> Term:
    """E_beta'."""
    shape = _SHAPE.make(context, looked, s)
    assert isinstance(shape, Quadratic), "the shape has a term in every stage"
    return replace(shape, name="shared_shape", once=True)


_HANDS = _l2(
    "hand_pose",
    "the coefficients of the hands' pose are small, or those of the shape that a person stated",
    lambda columns: columns.hands,
    "hand_pose",
)


def _stated_hands(context: TermContext, looked: UsedKeypoints, s: int) -> Term:
    """The hands' prior; where a person stated a hand's shape, how far the hand is from it instead."""
    prior, p, turn = _HANDS.make(context, looked, s), context.parametrisation, context.observations.turn
    both = torch.stack([turn[:, joints] for joints in FINGER_JOINTS.values()], 1).flatten(2)
    stated = both.isfinite().all(2)
    assert isinstance(prior, Quadratic), "hands have a term in every stage"
    if not bool(stated.any()):
        return prior
    here = stated[..., None].expand(-1, -1, p.columns.hand).flatten(1)
    angles = torch.where(stated[..., None], both, p.hand_mean)
    return replace(
        prior, weight=torch.where(here, LOCK_WEIGHT, prior.weight), target=p.nearest_hands(angles.flatten(1))
    )


ENTRIES = (
    _l2(
        "body_pose",
        "the pose is likely under the [pose prior](bodies.md#pose-priors)",
        lambda columns: columns.body,
        "body_pose",
        target=lambda p: p.prior.neutral.to(p.like),
    ),
    replace(_HANDS, make=_stated_hands),
    _l2(
        "jaw",
        "the jaw is not turned far",
        lambda columns: columns.jaw,
        "jaw_open",
        "jaw_sideways",
    ),
    _l2(
        "expression",
        "the coefficients of the expression are small",
        lambda columns: columns.expression,
        "expression",
    ),
    _SHAPE,
    replace(
        _SHAPE,
        name="shared_shape",
        about="phase 2: the betas that frames share are small, counted once with the weight of `shape`",
        make=_shared_shape,
        weights=(),
    ),
)
