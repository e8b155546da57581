"""L-BFGS with strong Wolfe line search on a batch of independent problems."""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.fit.solvers.line_search import LineSearches

SMALLEST_CURVATURE = 1e-10
"""Pairs with y.s at or below this would spoil the positive definiteness and are skipped."""


class CurvatureHistory:
    """The last pairs of step s and gradient change y of each row, and the quasi-Newton directions they give.

    The two-loop recursion (Nocedal and Wright, Numerical Optimization, 2nd edition, algorithm 7.4) is written as two
    triangular solves with R[i, j] = s_i.y_j, i <= j in order of time, so that it needs no Python loop over the history.
    First loop: R alpha = S g. Second loop, with r = gamma (g - Y^T alpha): R^T c = diag(R) alpha - Y r, and the
    direction is -(r + S^T c).
    """

    def __init__(self, like: Float[Tensor, "b n"], *, size: int) -> None:
        """Storage for the last `size` pairs of every row of `like`: b (2 size n + size^2) numbers."""
        b, n = like.shape
        self.count = torch.zeros(b, dtype=torch.long, device=like.device)
        """Pairs stored since the row was last reset, (b,)."""
        self._size = size
        # Rings: pair k is in slot k % size. Unused slots are zero, with a one on the diagonal of R, so they drop out.
        # Products below the diagonal of R in order of time may be stale: they are never read.
        self._steps, self._changes = like.new_zeros(b, size, n), like.new_zeros(b, size, n)
        self._products = torch.eye(size, dtype=like.dtype, device=like.device).repeat(b, 1, 1)
        self._gamma = like.new_ones(b)

    def add(self, rows: Int[Tensor, " m"], steps: Float[Tensor, "m n"], changes: Float[Tensor, "m n"]) -> None:
        """Store the pairs of these rows that have curvature."""
        curvature = (steps * changes).sum(-1)
        curved = curvature > SMALLEST_CURVATURE
        rows, steps, changes, curvature = rows[curved], steps[curved], changes[curved], curvature[curved]
        if not len(rows):
            return
        slots = self.count[rows] % self._size
        used = self._used(rows)
        self._products[rows, :used, slots] = _times(self._steps[:, :used][rows], changes)
        self._products[rows, slots, slots] = curvature
        self._steps[rows, slots], self._changes[rows, slots] = steps, changes
        self._gamma[rows] = curvature / changes.square().sum(-1)
        self.count[rows] += 1

    def forget(self, rows: Int[Tensor, " m"]) -> None:
        """Empty the history of these rows."""
        self.count[rows] = 0
        self._steps[rows], self._changes[rows] = 0, 0
        self._products[rows] = torch.eye(self._size, dtype=self._products.dtype, device=self._products.device)
        self._gamma[rows] = 1

    def direction(self, rows: Int[Tensor, " m"], gradient: Float[Tensor, "m n"]) -> Float[Tensor, "m n"]:
        """Quasi-Newton directions at points with these gradients; minus the gradient if the history is empty."""
        used = self._used(rows)
        if not used:
            return -gradient
        steps, changes = self._steps[:, :used][rows], self._changes[:, :used][rows]
        order = self._order(rows, used)
        products = self._products[rows[:, None, None], order[:, :, None], order[:, None, :]]

        alpha = _solved(products, _times(steps, gradient).gather(1, order), upper=True)
        r = self._gamma[rows, None] * (gradient - _times(changes.mT, torch.zeros_like(alpha).scatter(1, order, alpha)))
        right = products.diagonal(dim1=1, dim2=2) * alpha - _times(changes, r).gather(1, order)
        c = _solved(products.mT, right, upper=False)
        return -(r + _times(steps.mT, torch.zeros_like(c).scatter(1, order, c)))

    def _used(self, rows: Tensor) -> int:
        """How many slots the fullest of these rows uses."""
        return min(int(self.count[rows].max()), self._size)

    def _order(self, rows: Tensor, used: int) -> Tensor:
        """Slots from the oldest pair to the newest, (m, used)."""
        count = self.count[rows]
        oldest = torch.where(count > self._size, count % self._size, 0)
        return (oldest[:, None] + torch.arange(used, device=count.device)) % self._size


def _times(matrices: Tensor, vectors: Tensor) -> Tensor:
    return torch.bmm(matrices, vectors[:, :, None])[:, :, 0]


def _solved(triangles: Tensor, vectors: Tensor, *, upper: bool) -> Tensor:
    return torch.linalg.solve_triangular(triangles, vectors[:, :, None], upper=upper)[:, :, 0]


CostFunction = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
"""function(x (m, n), rows (m,)) -> cost (m,), gradient (m, n): some rows of the batch, by index."""


class Reason(IntEnum):
    """Why the minimisation of a row ended."""

    CONVERGED = 0
    """The cost fell by less than the relative tolerance over a round, or can fall by no more than rounding."""
    GRADIENT = 1
    """No component of the gradient is larger than the gradient tolerance."""
    ROUNDS = 2
    """All rounds are used up."""
    LINE_SEARCH = 3
    """No lower point was found along the steepest descent: the cost is at rounding error, or the gradient is wrong."""
    START_NOT_FINITE = 4
    """Cost or gradient of the start are not finite; the row is returned unchanged."""


@dataclass(frozen=True, kw_only=True)
class Result:
    """The end of a minimisation, by row."""

    x: Float[Tensor, "b n"]
    """The point of lowest cost among all evaluated."""
    cost: Float[Tensor, " b"]
    """Cost at x; +inf if the start was not finite."""
    evaluations: Int[Tensor, " b"]
    """Function calls that included this row."""
    iterations: Int[Tensor, " b"]
    """Accepted steps."""
    rounds: Int[Tensor, " b"]
    """Finished rounds."""
    reasons: tuple[Reason, ...]
    """Why each row ended."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """When a row ends, and the size of its memory."""

    rounds: int = 30
    """Maximum number of rounds; the history outlives a round."""
    iterations: int = 30
    """Maximum number of steps per round."""
    history: int = 100
    """Stored curvature pairs."""
    line_evaluations: int = 25
    """Maximum number of evaluations per line search."""
    relative_tolerance: float = 1e-9
    """A row ends when a round lowers its cost by no more than this, relative to the larger of the cost and one."""
    gradient_tolerance: float = 1e-9
    """A row ends when no component of its gradient is larger."""
    change_tolerance: float = 1e-12
    """A round ends when a step changes the cost, or every variable, by no more than this."""


class Standing(NamedTuple):
    """State of a minimisation between two calls of its function."""

    cost: Float[Tensor, " b"]
    """Lowest so far; +inf if the start was not finite."""
    iterations: int
    """Accepted steps of the row with the most."""
    running: int
    """Rows that have not ended."""
    x: Float[Tensor, "b n"]
    """The point with cost `cost`; the minimiser's own, to be read before it goes on."""


def lbfgs_steps(function: CostFunction, x0: Float[Tensor, "b n"], limits: Limits) -> Generator[Standing, None, Result]:
    """Minimises the cost of each row, yielding after each call of the function; rows share only these calls.

    Every row has its own history, line search and end, and leaves the batch when it ends. Each call evaluates one trial
    point for every remaining row, wherever in its line search that is. The schedule is the usual one: rounds of
    iterations, unit first trials except min(1, 1 / |g|_1) without history. A trial whose cost or gradient is not finite
    counts as too long a step.

    Args:
        function: Costs and gradients of some rows. It may build graphs; nothing here is differentiated through.
        x0: Starts. Dtype and device are kept, the tensor is not changed.
        limits: When a row ends.
    """
    minimiser = _Minimiser(function, x0.detach().clone(), limits)
    minimiser.start()
    while len(rows := minimiser.running()):
        minimiser.evaluate_trials(rows)
        yield minimiser.standing()
    return minimiser.result()


class _Minimiser:
    """State of all rows. Methods take the indices of the rows to advance."""

    RUNNING = -1

    def __init__(self, function: CostFunction, x0: Tensor, limits: Limits) -> None:
        self.function, self.limits = function, limits
        self.curvature = CurvatureHistory(x0, size=min(limits.history, limits.rounds * limits.iterations))
        self.lines = LineSearches(x0, evaluations=limits.line_evaluations, smallest_move=limits.change_tolerance)
        self.x, self.gradient, self.direction = x0, torch.zeros_like(x0), torch.zeros_like(x0)
        self.cost = x0.new_full((len(x0),), torch.inf)
        self.round_cost = self.cost.clone()
        self.best_x, self.best_cost = x0.clone(), self.cost.clone()
        self.evaluations = torch.zeros_like(self.cost, dtype=torch.long)
        self.iterations, self.rounds = torch.zeros_like(self.evaluations), torch.zeros_like(self.evaluations)
        self.round_iterations = torch.zeros_like(self.evaluations)
        self.reason = torch.full_like(self.evaluations, self.RUNNING)

    def running(self) -> Tensor:
        return (self.reason == self.RUNNING).nonzero()[:, 0]

    def start(self) -> None:
        rows = self.running()
        if not len(rows):
            return
        self.cost, self.gradient = self.evaluate(self.x, rows)
        self.round_cost = self.cost.clone()
        self.end(rows[self.cost.isinf()], Reason.START_NOT_FINITE)
        self.end_where_flat(self.running())
        self.begin_lines(self.running())

    def evaluate(self, x: Tensor, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Costs and gradients; +inf and zero if one of them is not finite. Stores the best points."""
        cost, gradient = (value.detach() for value in self.function(x, rows))
        assert cost.shape == rows.shape and gradient.shape == x.shape, (cost.shape, gradient.shape, x.shape)
        usable = cost.isfinite() & gradient.isfinite().all(-1)
        cost, gradient = torch.where(usable, cost, torch.inf), torch.where(usable[:, None], gradient, 0)
        self.evaluations[rows] += 1
        better = cost < self.best_cost[rows]
        self.best_cost[rows[better]], self.best_x[rows[better]] = cost[better], x[better]
        return cost, gradient

    def evaluate_trials(self, rows: Tensor) -> None:
        """One evaluation of each row: some find their point and take the step, some fail, the others continue."""
        direction = self.direction[rows]
        cost, gradient = self.evaluate(self.x[rows] + self.lines.step[rows, None] * direction, rows)
        slope = (gradient * direction).sum(-1)
        found, failed = self.lines.advance(rows, cost=cost, gradient=gradient, slope=slope)
        self.take_steps(rows[found])
        self.restart(rows[failed])
        moved = rows[found | failed]
        self.begin_lines(moved[self.reason[moved] == self.RUNNING])

    def take_steps(self, rows: Tensor) -> None:
        step, cost, _ = self.lines.low[rows].unbind(-1)
        move, gradient = step[:, None] * self.direction[rows], self.lines.low_gradient[rows]
        self.curvature.add(rows, move, gradient - self.gradient[rows])
        tolerance = self.limits.change_tolerance
        tiny = (move.abs().amax(-1) <= tolerance) | (self.cost[rows] - cost <= tolerance)
        self.x[rows] += move
        self.cost[rows], self.gradient[rows] = cost, gradient
        self.iterations[rows] += 1
        self.round_iterations[rows] += 1
        self.end_where_flat(rows)
        self.end_rounds(rows[tiny | (self.round_iterations[rows] >= self.limits.iterations)])

    def end_rounds(self, rows: Tensor) -> None:
        rows = rows[self.reason[rows] == self.RUNNING]
        last, cost = self.round_cost[rows], self.cost[rows]
        size = torch.maximum(last.abs(), cost.abs()).clamp(min=1)
        self.rounds[rows] += 1
        self.round_iterations[rows] = 0
        self.round_cost[rows] = cost
        self.end(rows[self.rounds[rows] >= self.limits.rounds], Reason.ROUNDS)
        self.end(rows[last - cost <= self.limits.relative_tolerance * size], Reason.CONVERGED)

    def restart(self, rows: Tensor) -> None:
        """After a failed line search: retry with steepest descent, unless that is what failed."""
        self.end(rows[self.curvature.count[rows] == 0], Reason.LINE_SEARCH)
        self.curvature.forget(rows)

    def begin_lines(self, rows: Tensor) -> None:
        if not len(rows):
            return
        gradient, cost = self.gradient[rows], self.cost[rows]
        direction = self.curvature.direction(rows, gradient)
        slope = (gradient * direction).sum(-1)
        descends = (slope < 0) & direction.isfinite().all(-1)
        self.curvature.forget(rows[~descends])
        direction = torch.where(descends[:, None], direction, -gradient)
        fresh = self.curvature.count[rows] == 0
        step = torch.where(fresh, 1 / gradient.abs().sum(-1), 1).clamp(max=1)
        self.direction[rows] = direction
        self.lines.begin(rows, step=step, cost=cost, gradient=gradient, direction=direction)
        # A quasi-Newton step that promises less than the cost's rounding: a line search would measure noise.
        self.end(rows[~fresh & (-slope <= torch.finfo(cost.dtype).eps * cost.abs())], Reason.CONVERGED)

    def end_where_flat(self, rows: Tensor) -> None:
        self.end(rows[self.gradient[rows].abs().amax(-1) <= self.limits.gradient_tolerance], Reason.GRADIENT)

    def end(self, rows: Tensor, reason: Reason) -> None:
        self.reason[rows] = int(reason)

    def standing(self) -> Standing:
        return Standing(self.best_cost.clone(), int(self.iterations.max()), len(self.running()), self.best_x)

    def result(self) -> Result:
        return Result(
            x=self.best_x,
            cost=self.best_cost,
            evaluations=self.evaluations,
            iterations=self.iterations,
            rounds=self.rounds,
            reasons=tuple(Reason(reason) for reason in self.reason.tolist()),
        )
