"""The term of a known height (beyond the paper)."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import NUMBER
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.entry import Entry, Kernel
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate

HEIGHT_DEVIATION = 0.015
"""Metres: uncertainty of a stated height, and of posture."""


@dataclass(frozen=True)
class Height(Term):
    """weight x (height of the shape in the rest pose - stated height)."""

    weight: float
    """Per metre."""
    target: float
    """Metres above the mean shape's."""
    by_betas: Float[Tensor, "10"]
    """Metres that each beta adds."""
    where: slice
    """Of the betas in the state."""
    name: str = "height"

    def residual(self, e: Estimate) -> Tensor:
        """One residual."""
        return self.weight * (e.state.vector[:, self.where] @ self.by_betas - self.target)[:, None]


@helper
def _residual(c, x):
    clip, residual = c.clip, -c.clip.height
    for k in range(10):
        residual += clip.height_by_betas[k] * x[clip.betas - clip.shift + k]
    return residual


@helper
def _cost(c, frame, orient, x, s, derivatives):
    residual = _residual(c, x)
    return residual * residual


@helper
def _add_columns(c, frame, x, s):
    if not c.clip.free_betas:
        return
    first, residual, row = c.clip.free - 10, _residual(c, x), c.clip.height_by_betas
    for k in range(10):
        s.free_gradient[first + k] += residual * row[k]
        for n in range(k + 1):
            s.free_matrix[first + k, first + n] += row[k] * row[n]


def _make(context: TermContext, looked: UsedKeypoints, s: int) -> Term | None:
    """Weighted like a beta, in its standard deviations."""
    height, (mean, by_betas) = context.config.height, context.body.height
    if height is None:
        return None
    p, weight = context.parametrisation, context.config.weights.shape[s] / HEIGHT_DEVIATION
    return Height(weight, height / 100 - mean, p.betas.new_tensor(by_betas), p.columns.betas)


ENTRY = Entry(
    name="height",
    kind=Height,
    about="the body has the stated height; a deviation of 1.5 cm counts as much as one of a beta in `shape`",
    make=_make,
    kernel=Kernel(
        constants=lambda t: {"height": t.weight * t.target, "height_by_betas": t.weight * t.by_betas},
        clip=(("height", NUMBER), ("height_by_betas", NUMBER, 10)),
        cost=_cost,
        add_columns=_add_columns,
    ),
)
