"""What a solver solves: costs and damped steps of one of three structures, behind one interface."""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, Self

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.model import N_BETAS
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.variables.state import State
from fitting_core.least_squares import Descent, LeastSquares, Step, damping_diagonal, dense_step

if TYPE_CHECKING:
    from fitting_core.fit.fused.frames import Descents


class Problem(LeastSquares[State], Protocol):
    """A least squares problem over the frames of a State, in groups that are independent of each other."""

    objective: FrameObjective
    groups: int
    coupled: bool
    """Whether a group has several frames."""
    cold: bool
    """Whether the start is far from the solution, as in a sequence of stages, or near it."""
    unknowns: int
    """Variables of a group, without repetition: one shared by several rows counts once."""

    def descents(self, start: State, *, iterations: int, tolerance: float) -> "Iterator[Descents] | None":
        """Levenberg-Marquardt of every group by the kernels; None if these do not know all of it."""
        ...

    def descent(self, start: State) -> Descent[State]:
        """Levenberg-Marquardt of all groups, step by step."""
        ...

    def spread(self, x: Float[Tensor, "g unknowns"]) -> Float[Tensor, "r total"]:
        """The groups' unknowns as a step of their rows, for `State.moved`."""
        ...

    def terms(self, state: State) -> dict[str, float]:
        """Mean cost of a frame by term, see `mean_costs`; `state` holds the rows of all groups."""
        ...

    def softened(self) -> "Problem | None":
        """A problem that is easier to descend, with its minima in about the same places; None if not available."""
        ...


class OnFrames:
    """Common to the problems on a FrameObjective."""

    objective: FrameObjective
    cold: bool = False

    def descents(self, start: State, *, iterations: int, tolerance: float) -> "Iterator[Descents] | None":
        """None: the kernels only descend single frames."""
        return None

    def descent(self: "Problem", start: State) -> Descent[State]:
        """One damping for each group."""
        return Descent(self, start, torch.arange(self.groups, device=start.vector.device))

    def softened(self) -> Self | None:
        """The same problem on a gentler objective (see FrameObjective.softened); None if that is the same."""
        objective = self.objective.softened(cold=self.cold)
        if objective is None:
            return None
        other = copy(self)
        other.objective = objective
        return other


def mean_costs(costs: dict[str, Float[Tensor, "B"]]) -> dict[str, float]:
    """For each term over the frames where it is finite; infinite without such frames."""
    finite = {name: cost[cost.isfinite()] for name, cost in costs.items()}
    return {name: float(cost.mean()) if len(cost) else float("inf") for name, cost in finite.items()}


class IndependentFrames(OnFrames):
    """Every frame independently: phase 1."""

    coupled = False

    def __init__(self, objective: FrameObjective, frames: Int[Tensor, "B"], *, cold: bool = False) -> None:
        self.objective, self.frames, self.groups, self.cold = objective, frames, len(frames), cold
        self.unknowns = len(objective.index)

    def descents(self, start: State, *, iterations: int, tolerance: float) -> "Iterator[Descents] | None":
        """If the kernels know all terms."""
        fused = self.objective.fused
        if fused is None or fused.others:
            return None
        return fused.descend(start, self.frames, iterations=iterations, tolerance=tolerance)

    def rows(self, groups: Tensor) -> Tensor:
        """A group is a frame."""
        return groups

    def spread(self, x: Tensor) -> Tensor:
        """A frame's free columns."""
        return self.objective.step(x)

    def cost(self, state: State, groups: Tensor) -> Tensor:
        """E_o of each frame."""
        return self.objective.cost(state, self.frames[groups])

    def terms(self, state: State) -> dict[str, float]:
        """Of E_o."""
        return mean_costs(self.objective.costs(state, self.frames))

    def normal(self, state: State, groups: Tensor) -> tuple[Tensor, ...]:
        """Cost, gradient (g,d), matrix (g,d,d)."""
        n = self.objective.normal(state, self.frames[groups])
        return n.cost, n.gradient, n.matrix

    def solve(self, normal: tuple[Tensor, ...], damping: Tensor) -> Step:
        """Dense."""
        _, gradient, matrix = normal
        step = dense_step(gradient, matrix, damping)
        return replace(step, move=self.objective.step(step.move))


@dataclass(frozen=True, eq=False)
class Sample:
    """Some frames of a clip, and what is minimised in each of them."""

    objective: FrameObjective
    frames: Int[Tensor, "B"]


class SharedShape(OnFrames):
    """Mean of E_o over frames that share their betas, plus the terms that count once for these (E_beta'): phase 2.

    The normal matrix is an arrow; the frames are eliminated first (Schur complement on the betas). The objectives'
    betas must be free. The objectives have a shape term of their own, so the betas are regularised twice, as in a
    literal reading of the paper: E_beta' + mean of E_o, and E_o contains E_beta.

    Args:
        sample: Its objective, and its frames, which are the rows of a state.
    """

    groups = 1
    coupled = True

    def __init__(self, sample: Sample) -> None:
        self.objective, self.sample = sample.objective, sample
        assert self.objective.free.betas
        self.own = len(self.objective.index) - N_BETAS
        self.count = len(sample.frames)
        self.unknowns = self.count * self.own + N_BETAS

    def softened(self) -> "SharedShape | None":
        """As `OnFrames.softened`."""
        gentle = self.objective.softened(cold=self.cold)
        return None if gentle is None else SharedShape(Sample(gentle, self.sample.frames))

    def rows(self, groups: Tensor) -> Tensor:
        """All frames."""
        return torch.arange(self.count, device=groups.device)

    def spread(self, x: Tensor) -> Tensor:
        """The free columns of each frame in order, then the betas that all frames share."""
        own, betas = x[0, :-N_BETAS].view(self.count, self.own), x[0, -N_BETAS:]
        return self.objective.step(torch.cat([own, betas.expand(self.count, N_BETAS)], 1))

    def cost(self, state: State, groups: Tensor) -> Tensor:
        """E_beta' + mean of E_o."""
        costs = self.objective.cost(state, self.sample.frames)
        return sum(self.objective.shared_costs(state).values(), costs.mean()[None])

    def terms(self, state: State) -> dict[str, float]:
        """Of E_o, and what counts once."""
        shared = {name: float(cost) for name, cost in self.objective.shared_costs(state).items()}
        return {**mean_costs(self.objective.costs(state, self.sample.frames)), **shared}

    def normal(self, state: State, groups: Tensor) -> tuple[Tensor, ...]:
        """Cost, the frames' gradients and matrices (with the betas' part), and those of terms on the shared betas."""
        frames = self.objective.normal(state, self.sample.frames)
        once, share = self.objective.shared_normal(state), 1 / self.count
        held, holding = once.gradient[:, self.own :], once.matrix[:, self.own :, self.own :]
        return self.cost(state, groups), share * frames.gradient[None], share * frames.matrix[None], held, holding

    def solve(self, normal: tuple[Tensor, ...], damping: Tensor) -> Step:
        """Eliminates every frame's own columns, solves for the betas, and substitutes back."""
        _, gradient, matrix, held, holding = (a[0] for a in normal)
        count = len(gradient)
        own = self.own
        extra = damping_diagonal(matrix.diagonal(dim1=1, dim2=2), damping.expand(count))
        damped = matrix.clone()
        damped.diagonal(dim1=1, dim2=2).add_(extra)
        factor, info = torch.linalg.cholesky_ex(damped[:, :own, :own])
        coupling = damped[:, :own, own:]
        # Frame t has unknowns y_t and all share the betas b: [A_t B_t; B_t^T C_t] [dy_t; db] = -[g_t; h_t], where
        # the second row is summed over t. The first gives dy_t = -A_t^-1 (g_t + B_t db); inserted, S db = -right with
        # S = sum (C_t - B_t^T A_t^-1 B_t) + holding and right = sum (h_t - B_t^T A_t^-1 g_t) + held.
        eliminated = torch.cholesky_solve(torch.cat([coupling, gradient[:, :own, None]], 2), factor)
        by_betas, constant = eliminated[..., :N_BETAS], eliminated[..., N_BETAS:]
        schur = damped[:, own:, own:].sum(0) - (coupling.transpose(1, 2) @ by_betas).sum(0) + holding
        right = gradient[:, own:].sum(0) + held - (coupling.transpose(1, 2) @ constant)[..., 0].sum(0)
        schur_factor, schur_info = torch.linalg.cholesky_ex(schur)
        betas = -torch.cholesky_solve(right[:, None], schur_factor)[:, 0]
        move = torch.cat([-constant[..., 0] - by_betas @ betas, betas.expand(count, N_BETAS)], 1)
        predicted = -(gradient * move).sum() - (held * betas).sum() + (extra * move * move).sum()
        solved = (info == 0).all() & (schur_info == 0)
        return Step(self.objective.step(move), predicted[None], solved[None])
