"""Strong Wolfe line searches of many independent problems, one evaluation of each at a time."""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

SUFFICIENT_DECREASE = 1e-4
"""c1: the cost must fall by this share of what the initial slope promises."""
CURVATURE = 0.9
"""c2: the slope must shrink to this share of the initial slope."""
MARGIN = 0.1
"""A trial keeps this share of the bracket away from its ends."""
SLOW = 0.66
"""A bracket that kept more than this share of its width is halved next, so that interpolation cannot stall."""
GROWTH = (1.01, 10.0)
"""Bounds of the next step relative to the last while there is no upper bound."""

STEP, COST, SLOPE = range(3)


class LineSearches:
    """Bracket and zoom (Nocedal and Wright, Numerical Optimization, 2nd edition, algorithms 3.5 and 3.6) by row.

    Both algorithms are one rule here: `low` is the best point so far with sufficient decrease, `high` bounds the
    bracket on its other side, at an infinite step while none does. A point is (step, cost, slope) with the slope along
    the direction. A trial with infinite cost or a slope that is not finite counts as too long.
    """

    def __init__(self, like: Float[Tensor, "b n"], *, evaluations: int, smallest_move: float) -> None:
        """Rows of storage.

        Args:
            like: Number of rows and variables, dtype and device.
            evaluations: A search ends with the best point after this many trials.
            smallest_move: It also ends when the bracket moves no variable by more than this.
        """
        self.evaluations, self.smallest_move = evaluations, smallest_move
        self.step = like.new_zeros(len(like))
        """The step to evaluate next, (b,)."""
        self.low = like.new_zeros(len(like), 3)
        self.low_gradient = torch.zeros_like(like)
        self._start, self._high = torch.zeros_like(self.low), torch.zeros_like(self.low)
        self._reach, self._width = torch.zeros_like(self.step), torch.zeros_like(self.step)
        self._trials = torch.zeros_like(self.step, dtype=torch.long)

    def begin(
        self,
        rows: Int[Tensor, " m"],
        *,
        step: Float[Tensor, " m"],
        cost: Float[Tensor, " m"],
        gradient: Float[Tensor, "m n"],
        direction: Float[Tensor, "m n"],
    ) -> None:
        """Start searches from points with this cost and gradient along descents; `step` is the first trial."""
        slope = (gradient * direction).sum(-1)
        start = torch.stack([torch.zeros_like(cost), cost, slope], dim=-1)
        self.step[rows], self._reach[rows] = step, direction.abs().amax(-1)
        self.low[rows], self._start[rows], self.low_gradient[rows] = start, start, gradient
        self._high[rows] = self._width[rows] = self._high.new_tensor(torch.inf)
        self._trials[rows] = 0

    def advance(
        self,
        rows: Int[Tensor, " m"],
        *,
        cost: Float[Tensor, " m"],
        gradient: Float[Tensor, "m n"],
        slope: Float[Tensor, " m"],
    ) -> tuple[Bool[Tensor, " m"], Bool[Tensor, " m"]]:
        """Process the evaluation at `step` and choose the next step.

        Returns:
            Rows whose search found its point, in `low` and `low_gradient`, and rows whose search failed: no trial was
            below the start. The others need an evaluation at the new `step`.
        """
        trial = torch.stack([self.step[rows], cost, slope], dim=-1)
        last_low, last_high, start = self.low[rows], self._high[rows], self._start[rows]
        enough = cost <= start[:, COST] + SUFFICIENT_DECREASE * trial[:, STEP] * start[:, SLOPE]
        lower = enough & (cost < last_low[:, COST]) & slope.isfinite()
        turned = lower & (slope * (last_high - last_low)[:, STEP] >= 0)
        low = torch.where(lower[:, None], trial, last_low)
        high = torch.where(lower[:, None], torch.where(turned[:, None], last_low, last_high), trial)
        self.low[rows], self._high[rows] = low, high
        self.low_gradient[rows[lower]] = gradient[lower]

        width = (high - low)[:, STEP].abs()
        inside = _interpolated(low, high, halve=width > SLOW * self._width[rows])
        self.step[rows] = torch.where(width.isinf(), _extrapolated(last_low, trial), inside)
        self._width[rows] = width
        self._trials[rows] += 1

        wolfe = lower & (slope.abs() <= -CURVATURE * start[:, SLOPE])
        spent = (self._trials[rows] >= self.evaluations) | (width * self._reach[rows] <= self.smallest_move)
        below = low[:, STEP] > 0
        return wolfe | (spent & below), spent & ~below


def _interpolated(low: Tensor, high: Tensor, *, halve: Tensor) -> Tensor:
    """A step within the bracket: the minimum of the cubic, or the middle if it has no minimum or `halve` is set."""
    a, b = torch.minimum(low, high)[:, STEP], torch.maximum(low, high)[:, STEP]
    step = _cubic_minimum(low, high)
    step = torch.where(step.isfinite() & ~halve, step, (a + b) / 2)
    return step.clamp(a + MARGIN * (b - a), b - MARGIN * (b - a))


def _extrapolated(last: Tensor, point: Tensor) -> Tensor:
    """A step beyond the point; the longest allowed if the cubic through both points has no minimum."""
    longest = GROWTH[1] * point[:, STEP]
    step = _cubic_minimum(last, point)
    shortest = point[:, STEP] + (GROWTH[0] - 1) * (point - last)[:, STEP]
    return torch.where(step.isfinite(), step, longest).clamp(shortest, longest)


def _cubic_minimum(p: Tensor, q: Tensor) -> Tensor:
    """Minimiser of the cubic through two points and their slopes (Nocedal and Wright, equation 3.59); NaN if none."""
    (a, f_a, s_a), (b, f_b, s_b) = p.unbind(-1), q.unbind(-1)
    d1 = s_a + s_b - 3 * (f_a - f_b) / (a - b)
    d2 = (b - a).sign() * (d1.square() - s_a * s_b).sqrt()
    return b - (b - a) * (s_b + d2 - d1) / (s_b - s_a + 2 * d2)
