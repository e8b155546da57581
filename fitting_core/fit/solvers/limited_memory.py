"""L-BFGS behind the solvers' interface: as in the paper and SMPLify-X."""

from collections.abc import Generator

import torch
from torch import Tensor

from fitting_core.config.schema import SolverSettings
from fitting_core.fit.events import mapped
from fitting_core.fit.solvers.lbfgs import Limits, Reason, Standing, lbfgs_steps
from fitting_core.fit.solvers.problem import Problem
from fitting_core.fit.solvers.solution import Progress, Solution
from fitting_core.fit.variables.state import State
from fitting_core.least_squares import Ending

_ITERATIONS = 30
"""Steps of a round."""
_TOGETHER = 32
"""Groups whose graphs exist at once: a frame's takes about a megabyte."""
_OUTCOME: dict[Reason, Ending] = {Reason.ROUNDS: "iterations", Reason.START_NOT_FINITE: "failed"}


class LimitedMemory:
    """L-BFGS with strong Wolfe line search over the costs alone; gradients by automatic differentiation.

    The unknowns are a step from the start (`State.moved`), so the orientation is written in the tangent space there.
    """

    def __init__(self, settings: SolverSettings) -> None:
        self.limits = Limits(
            rounds=settings.rounds, iterations=_ITERATIONS, relative_tolerance=settings.relative_tolerance
        )
        self.iterations = settings.rounds * _ITERATIONS

    def minimise(self, problem: Problem, start: State, *, final: bool) -> Generator[Progress, None, Solution]:
        """Lowers the cost of every group; yields after each evaluation, also within a line search.

        A group whose start is not finite is returned unchanged. `final` makes no difference.
        """
        x0 = start.vector.new_zeros(problem.groups, problem.unknowns)

        def progress(standing: Standing) -> Progress:
            return Progress(
                iteration=standing.iterations,
                cost=standing.cost,
                running=standing.running,
                terms=lambda: problem.terms(start.moved(problem.spread(standing.x))),
            )

        result = yield from mapped(lbfgs_steps(_CostOf(problem, start), x0, self.limits), progress)
        state = start.moved(problem.spread(result.x))
        reason: tuple[Ending, ...] = tuple(_OUTCOME.get(r, "converged") for r in result.reasons)
        return Solution(state=state, cost=result.cost, reason=reason, evaluations=int(result.evaluations.sum()))


class _CostOf:
    """Cost and gradient of a problem's groups with respect to their unknowns."""

    def __init__(self, problem: Problem, start: State) -> None:
        self.problem, self.start = problem, start

    def __call__(self, x: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        parts = [self._evaluate(x[i], groups[i]) for i in torch.arange(len(x), device=x.device).split(_TOGETHER)]
        costs, gradients = zip(*parts, strict=True)
        return torch.cat(costs), torch.cat(gradients)

    def _evaluate(self, x: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        with torch.enable_grad():
            x = x.detach().requires_grad_()
            moved = self.start[self.problem.rows(groups)].moved(self.problem.spread(x))
            cost = self.problem.cost(moved, groups)
            (gradient,) = torch.autograd.grad(cost.sum(), x)
        return cost.detach(), gradient
