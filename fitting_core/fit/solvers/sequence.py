"""The problem of frames fitted together: consecutive frames of a clip move, all others are held."""

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.solvers.banded import solve_block_banded
from fitting_core.fit.solvers.problem import OnFrames, mean_costs
from fitting_core.fit.terms.temporal import REACH, Smoothness, off_mean
from fitting_core.fit.variables.state import State
from fitting_core.least_squares import Descent, Step, damping_diagonal

_SPOILS = 0.01
"""Share of the predicted decrease of all frames: a frame that misses its own by more is damped more."""
_STIFFEN, _SOFTEN, _STIFFEST = 10.0, 2.0, 1e8
"""Factors of a frame's damping after a step that it spoiled and after any other, and the most it is multiplied by."""


def span_of(free: range, frames: int, *, windowed: bool = False) -> range:
    """The frames that residuals of E_T over any of the free frames depend on; those with a neighbour on either side in
    it have a residual.

    Args:
        free: Consecutive frames that move.
        frames: Number of frames of the clip.
        windowed: As in `Sequence`.
    """
    before, after = (REACH, 0) if windowed else (2 * REACH, 2 * REACH)
    return range(max(0, free.start - before), min(frames, free.stop + after))


class _SmoothnessOf:
    """E_T over a span of frames of which some move.

    With L the map from joints q to residuals, r = L q, and D the Jacobian of the joints of one frame, the half gradient
    of frame i is D_i^T (L^T r)_i, and the blocks of the half matrix are (L^T L)_ij D_i^T D_j.
    """

    def __init__(self, term: Smoothness, objective: FrameObjective, clip: State, free: range, span: range) -> None:
        self.term = term
        self.local = slice(free.start - span.start, free.stop - span.start)
        """The free frames in the span."""
        self.held = objective.joints(term.joints, clip[span.start : span.stop], _index(span, clip))
        # L^T L, with c = 1 on frames that have a residual: c[i-1] + 4 c[i] + c[i+1] on the diagonal, -2 (c[i] + c[i+1])
        # next to it and c[i+1] two below it, times (weight / 3)^2.
        c = self.held.new_zeros(len(span) + 4)
        c[3 : len(span) + 1] = 1.0
        before, here, after = c[1:-3], c[2:-2], c[3:-1]
        bands = (before + 4 * here + after, -2 * (here + after), after)
        self.factors = [
            (term.weight / 3) ** 2 * band[self.local][: max(len(free) - k, 0), None, None]
            for k, band in enumerate(bands)
        ]

    def _residuals(self, joints: Float[Tensor, "n 165"]) -> Float[Tensor, "c 165"]:
        """With these joints of the free frames, the others as they were."""
        everything = self.held.clone()
        everything[self.local] = joints
        return self.term.weight * off_mean(everything)

    def cost(self, joints: Float[Tensor, "n 165"]) -> Tensor:
        """With these joints of the free frames, the others as they were."""
        return self._residuals(joints).square().sum()

    def change(self, before: Float[Tensor, "n 165"], after: Float[Tensor, "n 165"]) -> Float[Tensor, "n"]:
        """By how much the cost changes between two places of the free frames' joints, divided among them.

        |r1|^2 - |r0|^2 = (r1 - r0).(r1 + r0) = (j1 - j0).L^T (r1 + r0), exactly.
        """
        return ((after - before) * self._by_joints(self._residuals(before) + self._residuals(after))).sum(1)

    def _by_joints(self, residuals: Float[Tensor, "c 165"]) -> Float[Tensor, "n 165"]:
        """L^T r: residual i is w/3 (-q[i] + 2 q[i+1] - q[i+2]), so it goes to these three frames by these factors."""
        by_joints = torch.zeros_like(self.held)
        for offset, factor in ((0, -1), (1, 2), (2, -1)):
            by_joints[offset : offset + len(residuals)] += self.term.weight / 3 * factor * residuals
        return by_joints[self.local]

    def add(self, joints: Tensor, rows: Float[Tensor, "n 165 d"], gradient: Tensor, bands: list[Tensor]) -> Tensor:
        """Adds its half gradient and half matrix, and returns its cost.

        The matrix is built by blocks: band k couples each frame with the one k frames later.

        Args:
            joints: of the free frames.
            rows: their derivatives D by the free columns.
            gradient: of the free frames.
            bands: of the matrix.
        """
        residuals = self._residuals(joints)
        gradient += (rows.mT @ self._by_joints(residuals)[..., None])[..., 0]
        # Block (i + k, i) of the half matrix: factor x D_{i+k}^T D_i.
        for k, (band, factor) in enumerate(zip(bands, self.factors, strict=True)):
            band += factor * (rows[k:].mT @ rows[: len(band)])
        return residuals.square().sum()


def _index(frames: range, state: State) -> Tensor:
    return torch.arange(frames.start, frames.stop, device=state.vector.device)


class Sequence(OnFrames):
    """Sum of E_o over free frames + E_T as far as it depends on any of them: phase 3, a window, a re-run.

    A residual couples frames up to 2 reach apart, so that the matrix is block-banded and a step costs O(frames).

    Args:
        objective: E_o with fixed betas, and E_T.
        clip: all frames; those that are not free are held in this state.
        free: which frames move.
        windowed: include residuals as the paper's windows do: those of free frames that depend on none after these.
            Otherwise all residuals that depend on a free frame.
    """

    groups = 1
    coupled = True

    def __init__(self, objective: FrameObjective, clip: State, free: range, *, windowed: bool = False) -> None:
        self.objective = objective
        self.frames = torch.arange(free.start, free.stop, device=clip.vector.device)
        self.unknowns = len(free) * len(objective.index)
        term, span = objective.smoothness, span_of(free, len(clip), windowed=windowed)
        self.smoothness = None if term is None else _SmoothnessOf(term, objective, clip, free, span)
        self.stiffness = clip.vector.new_ones(len(free))
        """By how many times more than the others a frame is damped."""

    def descent(self, start: State) -> Descent[State]:
        """Frames are also damped one by one."""
        return _SequenceDescent(self, start)

    def rows(self, groups: Tensor) -> Tensor:
        """All free frames."""
        return torch.arange(len(self.frames), device=groups.device)

    def spread(self, x: Tensor) -> Tensor:
        """The free columns of each frame in order."""
        return self.objective.step(x.view(len(self.frames), -1))

    def cost(self, state: State, groups: Tensor) -> Float[Tensor, "1"]:
        """E of the free frames."""
        self.latest = self.evaluated(state)
        own, joints = self.latest
        return (own.sum() if self.smoothness is None else own.sum() + self.smoothness.cost(joints))[None]

    def evaluated(self, state: State) -> tuple[Float[Tensor, "n"], Tensor]:
        """E_o of the free frames and, if E_T counts, their joints (n, 165)."""
        if self.smoothness is None:
            own = self.objective.cost(state, self.frames)
            return own, own
        return self.objective.cost_and_joints(self.smoothness.term.joints, state, self.frames)

    def terms(self, state: State) -> dict[str, float]:
        """Of E_o, and E_T."""
        costs = mean_costs(self.objective.costs(state, self.frames))
        if self.smoothness is not None:
            joints = self.objective.joints(self.smoothness.term.joints, state, self.frames)
            costs[self.smoothness.term.name] = float(self.smoothness.cost(joints)) / len(self.frames)
        return costs

    def normal(self, state: State, groups: Tensor) -> tuple[Tensor, ...]:
        """Cost, gradient, diagonal blocks, and the blocks one and two below, if E_T counts."""
        if self.smoothness is None:
            n = self.objective.normal(state, self.frames)
            return n.cost.sum()[None], n.gradient[None], n.matrix[None]
        n, joints, rows = self.objective.normal_and_joints(self.smoothness.term.joints, state, self.frames)
        count, width = n.gradient.shape
        bands = [n.matrix, *(n.matrix.new_zeros(max(count - k, 0), width, width) for k in range(1, 2 * REACH + 1))]
        cost = n.cost.sum() + self.smoothness.add(joints, rows, n.gradient, bands)
        return cost[None], n.gradient[None], *(band[None] for band in bands)

    def solve(self, normal: tuple[Tensor, ...], damping: Tensor) -> Step:
        """One block-banded Cholesky factorisation."""
        _, gradient, diagonal, *below = (a[0] for a in normal)
        # Each frame is damped by the mean of its own diagonal, in place: a copy of the blocks takes 50 kB a frame.
        own = diagonal.diagonal(dim1=1, dim2=2)
        extra, undamped = damping_diagonal(own, damping * self.stiffness), own.clone()
        own.add_(extra)
        solution = solve_block_banded([diagonal, *below], gradient)
        own.copy_(undamped)
        solved = torch.tensor([solution is not None], device=gradient.device)
        move = torch.zeros_like(gradient) if solution is None else -solution
        self.predicted = -(move * (gradient - extra * move)).sum(1)
        """Decrease by frame. E(x + d) = E + 2 g.d + d^T H d, where H d = -g - D d."""
        return Step(self.objective.step(move), self.predicted.sum()[None], solved)


class _SequenceDescent(Descent[State]):
    """Damps a frame more whose cost behaves otherwise than predicted.

    With one damping for all, one frame in a bent valley keeps all others from moving: of 38 steps of 149 signing frames
    12 were refused, for one or two frames each (evaluation/RESULTS/speed.md).
    """

    def __init__(self, problem: Sequence, start: State) -> None:
        problem.stiffness = torch.ones_like(problem.stiffness)
        super().__init__(problem, start, torch.zeros(1, dtype=torch.long, device=start.vector.device))
        self.sequence, self.at = problem, problem.evaluated(start)

    def _update_damping(self, groups: Tensor, better: Tensor, gain: Tensor) -> None:
        problem = self.sequence
        (before, placed), (after, moved) = self.at, problem.latest
        change = after - before
        if problem.smoothness is not None:
            change = change + problem.smoothness.change(placed, moved)
        spoils = change + problem.predicted > _SPOILS * problem.predicted.sum()
        spoils &= problem.stiffness < _STIFFEST
        problem.stiffness = torch.where(spoils, _STIFFEN * problem.stiffness, problem.stiffness / _SOFTEN).clamp_min(1)
        if bool(better):
            self.at = problem.latest
        if bool(better) or not bool(spoils.any()):
            super()._update_damping(groups, better, gain)
