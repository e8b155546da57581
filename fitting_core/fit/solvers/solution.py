"""What every solver reports and returns."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.fit.variables.state import State
from fitting_core.least_squares import Ending


@dataclass(frozen=True, kw_only=True)
class Progress:
    """After one iteration."""

    iteration: int
    cost: Float[Tensor, "g"]
    running: int
    """Groups that have not ended."""
    terms: Callable[[], dict[str, float]]
    """Evaluates `Problem.terms` at the current point; to be called before the minimisation goes on."""


@dataclass(frozen=True, kw_only=True)
class Solution:
    """Where a minimisation ended."""

    state: State
    cost: Float[Tensor, "g"]
    reason: tuple[Ending, ...]
    """Why each group ended."""
    evaluations: int
    """Cost evaluations, summed over groups."""


def joined_solutions(parts: Sequence[Solution]) -> Solution:
    """One solution of the groups of all, in order."""
    return Solution(
        state=State.cat([part.state for part in parts]),
        cost=torch.cat([part.cost for part in parts]),
        reason=tuple(reason for part in parts for reason in part.reason),
        evaluations=sum(part.evaluations for part in parts),
    )
