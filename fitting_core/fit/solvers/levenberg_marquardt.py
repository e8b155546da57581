"""Levenberg-Marquardt on the closed-form normal equations of a problem."""

from collections.abc import Generator, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import torch

from fitting_core.config.schema import SolverSettings
from fitting_core.fit.solvers.problem import Problem
from fitting_core.fit.solvers.solution import Progress, Solution
from fitting_core.fit.variables.state import State
from fitting_core.least_squares import Ending

if TYPE_CHECKING:
    from fitting_core.fit.fused.frames import Descents


class LevenbergMarquardt:
    """`Problem.descent`, or the kernels' descents if these know all terms."""

    def __init__(self, settings: SolverSettings) -> None:
        self.settings, self.iterations = settings, settings.iterations

    def minimise(self, problem: Problem, start: State, *, final: bool) -> Generator[Progress, None, Solution]:
        """Lowers the cost of every group; yields after each iteration.

        A group whose start is not finite is returned unchanged; no step to a cost that is not finite is ever taken. A
        problem with staircase terms is first minimised with softened ones, and groups that this helped continue from
        there. From a cold start the robust function is first widened, and the better of this and the direct way is
        kept: on 13 signing frames a mean cost of 5131 directly, 4358 widened, 4295 with both, 4329 with L-BFGS.
        """
        settings = self.settings
        last = settings.sequence_tolerance if problem.coupled else settings.final_tolerance
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
        run = problem.descent(start)
        for iteration in range(self.iterations):
            if not len(run.active):
                break
            run.iterate(tolerance)
            yield Progress(
                iteration=iteration + 1,
                cost=run.cost.clone(),
                running=len(run.active),
                terms=lambda: problem.terms(run.state),
            )
        return Solution(state=run.state, cost=run.cost, reason=tuple(run.reason), evaluations=run.evaluations)

    def _collected(
        self, problem: Problem, start: State, descents: "Iterator[Descents]"
    ) -> Generator[Progress, None, Solution]:
        """The kernels' result, in batches of groups."""
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
    everyone = torch.arange(problem.groups, device=start.vector.device)
    better = problem.cost(other, everyone) < problem.cost(start, everyone)
    if not bool(better.any()):
        return start
    rows = problem.rows(everyone[better])
    return start.put(rows, other[rows])
