"""Quadratic terms: the L2 priors of pose, hands, jaw, expression and shape, and the depth of the camera step."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import MOST_COLUMNS, NUMBER
from fitting_core.fit.terms.entry import Entry, Five, Kernel, Weight
from fitting_core.fit.terms.setting import Looked, Setting
from fitting_core.fit.terms.term import Derivative, Term
from fitting_core.fit.variables.estimate import Estimate

DEPTH_WEIGHT = 100.0
"""Of the camera step: (1e2)^2 (tz - tz_0)^2."""


@dataclass(frozen=True)
class Quadratic(Term):
    """weight x (columns - target): the L2 priors, E_beta', and the depth of the camera step."""

    name: str
    where: slice
    """In the prior's own space."""
    weight: Float[Tensor, "n"]
    target: Float[Tensor, "n"] | Float[Tensor, "T n"] | None = None
    once: bool = False
    derivative: ClassVar = Derivative.COLUMNS

    def residual(self, e: Estimate) -> Tensor:
        """Weighted distance from the target."""
        value = e.state.vector[:, self.where]
        if self.target is not None:
            value = value - (self.target[e.frames] if self.target.ndim == 2 else self.target)
        return self.weight * value

    def columns(self, e: Estimate) -> Tensor:
        """The slice's columns."""
        return torch.arange(self.where.start, self.where.stop, device=self.weight.device)

    def slope(self, e: Estimate) -> Tensor:
        """The weights."""
        return self.weight.expand(len(e.frames), -1)


@helper
def _cost(c, frame, orient, x, s, derivatives):
    """Of all quadratic terms, by columns of the state."""
    cost, clip, target = 0.0, c.clip, c.frames[frame].target
    for k in range(0 if derivatives else clip.width - clip.shift):
        away = clip.column_weight[k] * (x[k] - target[k])
        cost += away * away
    return cost


@helper
def _add_columns(c, frame, x, s):
    clip, target = c.clip, c.frames[frame].target
    for a in range(clip.free):
        at = clip.index[a]
        weight = clip.column_weight[at] * clip.column_weight[at]
        s.free_gradient[a] += weight * (x[at] - target[at])
        s.free_matrix[a, a] += weight


def _constants(term: Quadratic) -> Mapping[str, Any]:
    weight, target = np.zeros(MOST_COLUMNS), np.zeros((1, MOST_COLUMNS))
    weight[term.where] = term.weight.detach()
    if term.target is not None:
        target = np.zeros((len(term.target) if term.target.ndim == 2 else 1, MOST_COLUMNS))
        target[:, term.where] = term.target.detach()
    return {"column_weight": weight, "target": target}


KERNEL = Kernel(
    constants=_constants,
    clip=(("column_weight", NUMBER, MOST_COLUMNS),),
    frame=(("target", NUMBER, MOST_COLUMNS),),
    cost=_cost,
    add_columns=_add_columns,
)


def _on(setting: Setting, name: str, where: slice, weight: float, target: Tensor | None = None) -> Quadratic:
    """With one weight for all columns."""
    return Quadratic(name, where, setting.full(where.stop - where.start, weight), target)


def _body_pose(setting: Setting, looked: Looked, s: int) -> Term:
    p, weights = setting.parametrisation, setting.config.weights
    return _on(setting, "body_pose", p.columns.body, weights.body_pose[s], p.prior.neutral.to(p.betas))


def _hand_pose(setting: Setting, looked: Looked, s: int) -> Term:
    return _on(setting, "hand_pose", setting.parametrisation.columns.hands, setting.config.weights.hand_pose[s])


def _jaw(setting: Setting, looked: Looked, s: int) -> Term:
    p, w = setting.parametrisation, setting.config.weights
    return Quadratic("jaw", p.columns.jaw, p.betas.new_tensor([w.jaw_open[s], w.jaw_sideways[s], w.jaw_sideways[s]]))


def _expression(setting: Setting, looked: Looked, s: int) -> Term:
    return _on(setting, "expression", setting.parametrisation.columns.expression, setting.config.weights.expression[s])


def _shape(setting: Setting, looked: Looked, s: int) -> Quadratic:
    p = setting.parametrisation
    return _on(setting, "shape", p.columns.betas, setting.config.weights.shape[s], p.betas)


def _shared_shape(setting: Setting, looked: Looked, s: int) -> Term:
    """E_beta'."""
    return replace(_shape(setting, looked, s), name="shared_shape", once=True)


def held_depth(setting: Setting, depth: Float[Tensor, "T"]) -> Quadratic:
    """Of the camera step: the body stays near a guess of its distance (metres)."""
    z = setting.parametrisation.columns.translation.stop - 1
    return _on(setting, "depth", slice(z, z + 1), DEPTH_WEIGHT, depth[:, None])


def _entry(name: str, about: str, make: Callable[[Setting, Looked, int], Term], *weights: Weight) -> Entry:
    return Entry(name=name, kind=Quadratic, about=about, make=make, weights=weights, kernel=KERNEL)


_POSE: Five = (404.0, 404.0, 57.4, 4.78, 4.78)
_COEFFICIENTS: Five = (100.0, 50.0, 10.0, 5.0, 5.0)
ENTRIES = (
    _entry(
        "body_pose",
        "the pose is likely under the [pose prior](bodies.md#pose-priors)",
        _body_pose,
        Weight(name="body_pose", about="Body pose prior.", paper=_POSE),
    ),
    _entry(
        "hand_pose",
        "the coefficients of the hands' pose are small",
        _hand_pose,
        Weight(name="hand_pose", about="L2 of the hand components.", paper=_POSE),
    ),
    _entry(
        "jaw",
        "the jaw is not turned far",
        _jaw,
        Weight(
            name="jaw_open",
            about="Jaw about its x axis.",
            paper=(63.6, 63.6, 24.0, 6.9, 6.9),
            smplifyx=(4040.0, 4040.0, 574.0, 47.8, 47.8),
        ),
        Weight(
            name="jaw_sideways",
            about="Jaw about its y and z axes.",
            paper=(201.0, 201.0, 75.7, 21.9, 21.9),
            smplifyx=(40400.0, 40400.0, 5740.0, 478.0, 478.0),
        ),
    ),
    _entry(
        "expression",
        "the coefficients of the expression are small",
        _expression,
        Weight(name="expression", about="L2 of the expression.", paper=_COEFFICIENTS),
    ),
    _entry(
        "shape",
        "the shape's betas are small",
        _shape,
        Weight(name="shape", about="L2 of betas; in phase 2 of the shared betas too.", paper=_COEFFICIENTS),
    ),
    _entry(
        "shared_shape",
        "phase 2: the betas that frames share are small, counted once with the weight of `shape`",
        _shared_shape,
    ),
)
