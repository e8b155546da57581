"""Levenberg-Marquardt on the closed-form normal equations, every independent group with its own damping."""

from collections.abc import Generator, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from fitting_core.config.schema import SolverSettings
from fitting_core.fit.solvers.problem import Problem
from fitting_core.fit.solvers.solution import Progress, Solution
from fitting_core.fit.variables.state import State
from fitting_core.results.provenance import Ending

if TYPE_CHECKING:
    from fitting_core.fit.fused.frames import Descents

_START, _SMALLEST, _LARGEST = 1e-3, 1e-7, 1e8
_GROWTH = 2.0
"""Of the damping at the first refused step; it doubles with every further one."""


class LevenbergMarquardt:
    """Nielsen's damping rule (K. Madsen, H. B. Nielsen, O. Tingleff, Methods for Non-Linear Least Squares, 2004)."""

    def __init__(self, settings: SolverSettings) -> None:
        self.settings, self.iterations = settings, settings.iterations

    def minimise(self, problem: Problem, start: State, *, final: bool) -> Generator[Progress, None, Solution]:
        """Lowers the cost of every group; yields after each iteration.

        A group whose start is not finite is returned as it came; no step to a cost that is not finite is ever taken.
        A problem with staircase terms is minimised with these softened first, and groups that this helped go on there.
        From a cold start the robust function is widened first, and the better of this way and the direct one is kept:
        on 13 signing frames a mean cost of 5131 directly, 4358 by the wide function, 4295 by both, 4329 by L-BFGS.
        """
        settings = self.settings
        last = settings.sequence_tolerance if problem.coupled_in_time else settings.final_tolerance
        passing = max(last, settings.stage_tolerance)
        soft, evaluations = problem.softened(), 0
        direct = start
        if soft is not None:
            gentle = yield from self._descend(soft, start, passing)
            start, evaluations = _lower(problem, start, gentle.state), gentle.evaluations
        if soft is not None and problem.cold:
            run = yield from self._descend(problem, direct, passing)
            other = yield from self._descend(problem, gentle.state, passing)
            start, evaluations = (
                _lower(problem, run.state, other.state),
                evaluations + run.evaluations + other.evaluations,
            )
        run = yield from self._descend(problem, start, last if final else passing)
        return replace(run, evaluations=run.evaluations + evaluations)

    def _descend(self, problem: Problem, start: State, tolerance: float) -> Generator[Progress, None, Solution]:
        descents = problem.descents(start, iterations=self.iterations, tolerance=tolerance)
        if descents is not None:
            return (yield from self._collected(problem, start, descents))
        run = _Run(problem, start)
        for iteration in range(self.iterations):
            if not len(run.active):
                break
            run.iterate(tolerance)
            yield Progress(
                iteration=iteration + 1,
                cost=run.cost.clone(),
                running=len(run.active),
                terms=lambda: run.problem.terms(run.state),
            )
        return Solution(state=run.state, cost=run.cost, reason=tuple(run.reason), evaluations=run.evaluations)

    def _collected(
        self, problem: Problem, start: State, descents: "Iterator[Descents]"
    ) -> Generator[Progress, None, Solution]:
        """What the kernels find, some groups after the others."""
        state, cost = State(start.orient.clone(), start.vector.clone()), torch.full_like(start.vector[:, 0], torch.inf)
        reason: list[Ending] = ["failed"] * problem.groups
        evaluations = done = 0
        for found in descents:
            state.orient[found.rows], state.vector[found.rows] = found.state.orient, found.state.vector
            cost[found.rows] = found.cost
            for row, ending in zip(found.rows.tolist(), found.ending, strict=True):
                reason[row] = ending
            evaluations, done = evaluations + found.evaluations, done + len(found.rows)
            yield Progress(
                iteration=-(-self.iterations * done // problem.groups),
                cost=cost.clone(),
                running=problem.groups - done,
                terms=lambda: problem.terms(state),
            )
        return Solution(state=state, cost=cost, reason=tuple(reason), evaluations=evaluations)


def _lower(problem: Problem, start: State, other: State) -> State:
    """Of each group the state of lower cost."""
    everyone = torch.arange(problem.groups, device=start.vector.device)
    better = problem.cost(other, everyone) < problem.cost(start, everyone)
    if not bool(better.any()):
        return start
    rows = problem.rows(everyone[better])
    return start.put(rows, other[rows])


class _Run:
    """The moving parts of one minimisation."""

    def __init__(self, problem: Problem, start: State) -> None:
        self.problem, self.state = problem, start
        everyone = torch.arange(problem.groups, device=start.vector.device)
        self.cost, *self.system = problem.normal(start, everyone)
        self.active = everyone[self.cost.isfinite()]
        self.damping = torch.full_like(self.cost, _START)
        self.growth = torch.full_like(self.cost, _GROWTH)
        self.promised = torch.zeros_like(self.cost)
        """What the first step promised that was refused since one was last taken."""
        self.rounding = torch.finfo(self.cost.dtype).eps * self.cost
        self.reason: list[Ending] = ["iterations" if finite else "failed" for finite in self.cost.isfinite().tolist()]
        self.evaluations = problem.groups

    def iterate(self, tolerance: float) -> None:
        """One damped step of every active group."""
        groups = self.active
        rows = self.problem.rows(groups)
        step = self.problem.solve((self.cost[groups], *(a[groups] for a in self.system)), self.damping[groups])
        trial = self.state[rows].moved(step.move)
        cost = self.problem.cost(trial, groups)
        self.evaluations += len(groups)
        before = self.cost[groups]
        better = step.solved & cost.isfinite() & (cost < before)
        refused_first = ~better & (self.growth[groups] == _GROWTH)
        self.promised[groups[refused_first]] = torch.where(step.solved, step.predicted, torch.inf)[refused_first]
        self._update_damping(groups, better, (before - cost) / step.predicted.clamp_min(1e-300))
        done = better & (before - cost < tolerance * before)
        self._accept(groups[better], groups[better & ~done], rows, trial, cost[better], better)
        stuck = ~done & (self.damping[groups] > _LARGEST)
        # Where next to nothing was left to gain, to gain nothing is the end of the way and no wall.
        at_end = self.promised[groups] <= torch.maximum(tolerance * before, self.rounding[groups])
        self._end(groups[done | (stuck & at_end)], "converged")
        self._end(groups[stuck & ~at_end], "stalled")
        self.active = groups[~(done | stuck)]

    def _end(self, groups: Tensor, reason: Ending) -> None:
        for group in groups.tolist():
            self.reason[group] = reason

    def _update_damping(self, groups: Tensor, better: Tensor, gain: Tensor) -> None:
        growth, damping = self.growth[groups], self.damping[groups]
        shrunk = damping * (1 - (2 * gain.nan_to_num(0.0).clamp(0, 1) - 1) ** 3).clamp_min(0.2)
        self.damping[groups] = torch.where(better, shrunk.clamp_min(_SMALLEST), damping * growth)
        self.growth[groups] = torch.where(better, _GROWTH, growth * 2)

    def _accept(
        self, accepted: Tensor, refreshed: Tensor, rows: Tensor, trial: State, cost: Tensor, better: Tensor
    ) -> None:
        if not len(accepted):
            return
        keep = better if len(better) == len(rows) else slice(None)  # one coupled group owns all rows
        self.state = self.state.put(rows[keep], trial[keep])
        self.cost[accepted] = cost
        if len(refreshed):
            _, *fresh = self.problem.normal(self.state[self.problem.rows(refreshed)], refreshed)
            for old, new in zip(self.system, fresh, strict=True):
                old[refreshed] = new
