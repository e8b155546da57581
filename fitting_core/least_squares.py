"""Levenberg-Marquardt for groups of unknowns that are independent of each other, each with its own damping.

A group's cost is E = r^T r. With g = J^T r and H = J^T J, a step d solves (H + D) d = -g, where D is diagonal.

Nielsen's damping rule (K. Madsen, H. B. Nielsen, O. Tingleff, Methods for Non-Linear Least Squares, 2004).
"""

from dataclasses import dataclass
from typing import Generic, Literal, Protocol, Self, TypeVar

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

Ending = Literal["converged", "iterations", "stalled", "failed"]
"""Why a minimisation ended: it converged, the limit of iterations was reached, no step lowered the cost although the
slope promised more (a staircase, a wrong derivative), or there was no finite cost to start from."""
START = 1e-3
"""Damping of the first step."""
_SMALLEST, _LARGEST = 1e-7, 1e8
_GROWTH = 2.0
"""Of the damping at the first refused step; it doubles with every further one."""
DIAGONAL_FLOOR = 1e-9
"""Share of the largest diagonal entry that keeps parameters regular which no residual sees."""


class Point(Protocol):
    """Where a minimisation stands: rows, of which a group has one or several."""

    def __getitem__(self, frames: Tensor | slice, /) -> Self:
        """Some of the rows."""
        ...

    def moved(self, step: Float[Tensor, "r total"], /) -> Self:
        """After a step of each row."""
        ...

    def put(self, frames: Tensor, other: Self, /) -> Self:
        """With some rows replaced."""
        ...


@dataclass(frozen=True)
class Step:
    """A step, its predicted decrease, and whether the damped matrix was positive definite."""

    move: Float[Tensor, "r total"]
    predicted: Float[Tensor, "g"]
    solved: Bool[Tensor, "g"]


PointT = TypeVar("PointT", bound=Point)
_ContraT = TypeVar("_ContraT", bound=Point, contravariant=True)


class LeastSquares(Protocol[_ContraT]):
    """Costs and damped steps of some groups."""

    def rows(self, groups: Int[Tensor, "g"]) -> Int[Tensor, "r"]:
        """Rows of the point that belong to these groups, in order."""
        ...

    def cost(self, state: _ContraT, groups: Int[Tensor, "g"]) -> Float[Tensor, "g"]:
        """Cost of each group; `state` holds the groups' rows only. Infinite for invalid states."""
        ...

    def normal(self, state: _ContraT, groups: Int[Tensor, "g"]) -> tuple[Tensor, ...]:
        """Cost (g,) and the tensors that `solve` needs, with the groups first."""
        ...

    def solve(self, normal: tuple[Tensor, ...], damping: Float[Tensor, "g"]) -> Step:
        """The damped Gauss-Newton step of each group."""
        ...


def damping_diagonal(diagonal: Float[Tensor, "*g d"], damping: Float[Tensor, "*g"]) -> Float[Tensor, "*g d"]:
    """What is added to the diagonal: damping x its mean.

    Not damping x the diagonal itself, which crept along single hand components: E 10438 against 8913.
    """
    floor = DIAGONAL_FLOOR * diagonal.amax(-1, keepdim=True)
    return (damping[..., None] * diagonal.mean(-1, keepdim=True) + floor).expand_as(diagonal)


def dense_step(gradient: Float[Tensor, "g d"], matrix: Float[Tensor, "g d d"], damping: Float[Tensor, "g"]) -> Step:
    """-(matrix + damping)^-1 gradient by one dense Cholesky factorisation for each group."""
    extra = damping_diagonal(matrix.diagonal(dim1=1, dim2=2), damping)
    damped = matrix.clone()
    damped.diagonal(dim1=1, dim2=2).add_(extra)
    factor, info = torch.linalg.cholesky_ex(damped)
    move = -torch.cholesky_solve(gradient[..., None], factor)[..., 0]
    # E(x + d) = E + 2 g.d + d^T H d. With H d = -g - D d, the decrease is -g.d + d^T D d.
    return Step(move, -(gradient * move).sum(1) + (extra * move * move).sum(1), info == 0)


class Descent(Generic[PointT]):
    """One minimisation, step by step. No step to a cost that is not finite is ever taken.

    Args:
        problem: what is minimised.
        start: rows of all groups. A group whose cost is not finite there stays as it is.
        groups: their numbers, 0 and up, on the device of the start.
        damping: of the first step.
    """

    def __init__(
        self, problem: LeastSquares[PointT], start: PointT, groups: Int[Tensor, "g"], *, damping: float = START
    ) -> None:
        self.problem, self.state = problem, start
        self.cost, *self.system = problem.normal(start, groups)
        self.active = groups[self.cost.isfinite()]
        """Groups that have not ended."""
        self.damping = torch.full_like(self.cost, damping)
        self.growth = torch.full_like(self.cost, _GROWTH)
        self.promised = torch.zeros_like(self.cost)
        """Predicted decrease of the first rejected step since the last accepted one."""
        self.rounding = torch.finfo(self.cost.dtype).eps * self.cost
        self.reason: list[Ending] = ["iterations" if finite else "failed" for finite in self.cost.isfinite().tolist()]
        self.evaluations = len(groups)

    def run(self, iterations: int, tolerance: float) -> PointT:
        """Iterate until all groups have ended or the limit is reached; returns the last point."""
        for _ in range(iterations):
            if not len(self.active):
                break
            self.iterate(tolerance)
        return self.state

    def iterate(self, tolerance: float) -> None:
        """One damped step of every active group."""
        groups = self.active
        rows = self.problem.rows(groups)
        everyone = len(groups) == len(self.cost)  # a copy of all of it can take 100 MB
        system = self.system if everyone else [a[groups] for a in self.system]
        step = self.problem.solve((self.cost[groups], *system), self.damping[groups])
        del system
        trial = self.state[rows].moved(step.move)
        cost = self.problem.cost(trial, groups)
        self.evaluations += len(groups)
        before = self.cost[groups]
        better = step.solved & cost.isfinite() & (cost < before)
        refused_first = ~better & (self.growth[groups] == _GROWTH)
        # A growth at its first value means that the step before was accepted.
        self.promised[groups[refused_first]] = torch.where(step.solved, step.predicted, torch.inf)[refused_first]
        self._update_damping(groups, better, (before - cost) / step.predicted.clamp_min(1e-300))
        done = better & (before - cost < tolerance * before)
        self._accept(groups[better], groups[better & ~done], rows, trial, cost[better], better)
        stuck = ~done & (self.damping[groups] > _LARGEST)
        # If the predicted gain is below the tolerance, not improving means converged, not stalled.
        at_end = self.promised[groups] <= torch.maximum(tolerance * before, self.rounding[groups])
        self._end(groups[done | (stuck & at_end)], "converged")
        self._end(groups[stuck & ~at_end], "stalled")
        self.active = groups[~(done | stuck)]

    def _end(self, groups: Tensor, reason: Ending) -> None:
        for group in groups.tolist():
            self.reason[group] = reason

    def _update_damping(self, groups: Tensor, better: Tensor, gain: Tensor) -> None:
        growth, damping = self.growth[groups], self.damping[groups]
        # Gain ratio rho = actual / predicted decrease: rho = 1 divides the damping by 5, rho = 1/2 keeps it. Rejected
        # steps multiply it by 2, 4, 8 and so on.
        shrunk = damping * (1 - (2 * gain.nan_to_num(0.0).clamp(0, 1) - 1) ** 3).clamp_min(0.2)
        self.damping[groups] = torch.where(better, shrunk.clamp_min(_SMALLEST), damping * growth)
        self.growth[groups] = torch.where(better, _GROWTH, growth * 2)

    def _accept(
        self, accepted: Tensor, refreshed: Tensor, rows: Tensor, trial: PointT, cost: Tensor, better: Tensor
    ) -> None:
        if not len(accepted):
            return
        keep = better if len(better) == len(rows) else slice(None)  # one coupled group owns all rows
        self.state = self.state.put(rows[keep], trial[keep])
        self.cost[accepted] = cost
        if len(refreshed) == len(self.cost):
            self.system = []  # its memory is free for the new one
            _, *self.system = self.problem.normal(self.state, refreshed)
        elif len(refreshed):
            _, *fresh = self.problem.normal(self.state[self.problem.rows(refreshed)], refreshed)
            for old, new in zip(self.system, fresh, strict=True):
                old[refreshed] = new
