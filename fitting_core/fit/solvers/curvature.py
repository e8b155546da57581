"""The curvature memory of L-BFGS for many independent problems."""

import torch
from jaxtyping import Float, Int
from torch import Tensor

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
