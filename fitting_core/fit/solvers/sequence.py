"""The problem of frames fitted together: consecutive frames of a clip move, all others are held."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.fit.objective import FrameObjective, jacobians_at_once
from fitting_core.fit.solvers.banded import solve_block_banded
from fitting_core.fit.solvers.problem import OnFrames, mean_costs
from fitting_core.fit.terms.temporal import Evenness
from fitting_core.fit.terms.term import Derivative, Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.state import State
from fitting_core.least_squares import Step, damping_diagonal

if TYPE_CHECKING:
    from fitting_core.fit.fused.frames import FusedFrames


@dataclass(frozen=True)
class Coupling:
    """The frames that move, and the frames that the residuals of one term over any of them depend on."""

    free: range
    """Consecutive frames of the clip that move."""
    span: range
    """Frames that are read. Those with `reach` neighbours on either side in it have residuals."""
    reach: int

    @staticmethod
    def of(free: range, frames: int, reach: int, *, windowed: bool = False) -> "Coupling":
        """For a term with this reach in a clip of so many frames; `windowed` as in Sequence."""
        first, last = (free.start - reach, free.stop) if windowed else (free.start - 2 * reach, free.stop + 2 * reach)
        return Coupling(free, range(max(0, first), min(frames, last)), reach)

    @property
    def residuals(self) -> int:
        """How many frames have residuals."""
        return max(len(self.span) - 2 * self.reach, 0)

    @property
    def local(self) -> slice:
        """The free frames in the span."""
        return slice(self.free.start - self.span.start, self.free.stop - self.span.start)


def _estimate(objective: FrameObjective, state: State, frames: range) -> Estimate:
    return Estimate(objective.view, state, torch.arange(frames.start, frames.stop, device=state.vector.device))


class _ByStencil:
    """A term that combines a quantity of single frames, whose Jacobian it knows.

    With L the stencil, q the quantity and D its Jacobian, the half gradient of frame i is D_i^T (L^T L q)_i, and the
    blocks of the half matrix are (L^T L)_ij D_i^T D_j.
    """

    def __init__(self, term: Term, objective: FrameObjective, clip: State, coupling: Coupling) -> None:
        self.term, self.objective, self.coupling, self.stencil = term, objective, coupling, term.stencil
        span = coupling.span
        self.held = self._quantity(clip[span.start : span.stop], span)
        bands, local = self.stencil.square(len(span), self.held), coupling.local
        counts = (max(len(coupling.free) - k, 0) for k in range(len(bands)))
        self.factors = [b[local.start : local.start + n, None, None] for b, n in zip(bands, counts, strict=True)]

    def _quantity(self, state: State, frames: range) -> Float[Tensor, "n m"]:
        return self.term.quantity(_estimate(self.objective, state, frames))

    def _rows(self, state: State, frames: range) -> Float[Tensor, "n m d"]:
        e = _estimate(self.objective, state, frames)
        rows = self.term.rows(e, self.objective.jacobian)
        assert rows.extra_gradient is None, f"{self.term.name}: a stencil knows no extra gradient"
        return self.objective.rows_in_prior_space(e, rows.jacobian)

    def _residuals(self, state: State) -> Float[Tensor, "c m"]:
        """Of the free frames in their current state, the others as they were."""
        every = self.held.clone()
        every[self.coupling.local] = self._quantity(state, self.coupling.free)
        return self.stencil(every)

    def cost(self, state: State) -> Tensor:
        """Of the free frames in their current state, the others as they were."""
        return self._residuals(state).square().sum()

    def add(self, state: State, gradient: Tensor, bands: list[Tensor]) -> Tensor:
        """Adds its half gradient and half matrix, and returns its cost.

        The matrix is built by blocks: band k couples each frame with the one k frames later. In chunks of frames, which
        also need the Jacobians of the last frames before them.
        """
        residuals, first = self._residuals(state), self.coupling.free.start
        # L^T r for the free frames; L contains the weight.
        by_quantity = self.stencil.transposed(residuals, len(self.coupling.span))[self.coupling.local]
        before = gradient.new_zeros(0, self.held.shape[1], gradient.shape[1])
        at_once = jacobians_at_once(state.vector.device)
        for start in range(0, len(state), at_once):
            stop = min(start + at_once, len(state))
            rows = self._rows(state[start:stop], range(first + start, first + stop))
            gradient[start:stop] += (rows.transpose(1, 2) @ by_quantity[start:stop, :, None])[..., 0]
            known, begin = torch.cat([before, rows]), start - len(before)
            for k, factor in enumerate(self.factors):
                earlier = slice(max(start - k, 0), max(stop - k, 0))
                one, other = (known[earlier.start + by - begin : earlier.stop + by - begin] for by in (k, 0))
                bands[k][earlier] += factor[earlier] * (one.transpose(1, 2) @ other)
            before = known[1 - len(self.factors) :]
        return residuals.square().sum()


class _OfJoints(_ByStencil):
    """The same for a term on the joints, in the kernels."""

    def __init__(self, term: Evenness, objective: FrameObjective, clip: State, coupling: Coupling) -> None:
        c = objective.view.parametrisation.columns.translation
        self._translation = c if term.joints.in_camera else None
        moving = (objective.index >= c.start) & (objective.index < c.stop)
        self._moving = moving.nonzero()[:, 0] if term.joints.in_camera else moving.nonzero()[:0, 0]
        self._joints = term.joints
        super().__init__(term, objective, clip, coupling)

    @property
    def _fused(self) -> "FusedFrames":
        assert self.objective.fused is not None
        return self.objective.fused

    def _quantity(self, state: State, frames: range) -> Tensor:
        if state.vector.requires_grad:
            return super()._quantity(state, frames)
        index = torch.arange(frames.start, frames.stop)
        joints, _ = self._fused.joints(state, index, derivatives=False)
        if self._translation is not None:
            joints += state.vector[:, None, self._translation]
        return self._joints.in_still_space(joints, index).flatten(1)

    def _rows(self, state: State, frames: range) -> Tensor:
        index = torch.arange(frames.start, frames.stop)
        _, rows = self._fused.joints(state, index, derivatives=True)
        for axis, column in enumerate(self._moving):
            rows[:, axis::3, column] = 1.0
        return self._joints.rows_in_still_space(rows, index)


class _Differentiated:
    """A term that gives only its residuals.

    Residuals with disjoint frames are differentiated together: those of every (2 reach + 1)th frame.
    """

    def __init__(self, term: Term, objective: FrameObjective, clip: State, coupling: Coupling) -> None:
        self.term, self.objective, self.coupling = term, objective, coupling
        self.held = clip[coupling.span.start : coupling.span.stop]
        local = coupling.local
        self.local = torch.arange(local.start, local.stop, device=clip.vector.device)

    def _residual(self, state: State) -> Float[Tensor, "c n"]:
        if not self.coupling.residuals:
            return state.vector.new_zeros(0, 0)
        whole = self.held.put(self.local, state)
        return self.term.residual(_estimate(self.objective, whole, self.coupling.span))

    def cost(self, state: State) -> Tensor:
        """Of the free frames in their current state, the others as they were."""
        return self._residual(state).square().sum()

    def add(self, state: State, gradient: Tensor, bands: list[Tensor]) -> Tensor:
        """As in `_ByStencil`, block by block: the residual of frame c with the frames at two offsets from it."""
        residual, jacobian = self._jacobian(state)
        offsets = range(jacobian.shape[1])
        first = torch.arange(len(residual), device=self.local.device) - self.coupling.local.start
        free = [(first + k >= 0) & (first + k < len(state)) for k in offsets]  # a residual's k-th frame is free
        for later in offsets:
            at, j = free[later], jacobian[:, later]
            gradient.index_add_(0, (first + later)[at], (j.transpose(1, 2) @ residual[..., None])[at, :, 0])
            for earlier in range(later + 1):
                both = free[later] & free[earlier]
                block = j[both].transpose(1, 2) @ jacobian[both, earlier]
                bands[later - earlier].index_add_(0, (first + earlier)[both], block)
        return residual.square().sum()

    def _jacobian(self, state: State) -> tuple[Float[Tensor, "c n"], Float[Tensor, "c k n d"]]:
        """Residuals, and their derivatives by the free columns of each frame they depend on; 0 for held ones."""
        colours = 2 * self.coupling.reach + 1
        with torch.enable_grad():
            move = state.vector.new_zeros(len(state), len(self.objective.index), requires_grad=True)
            residual = self._residual(state.moved(self.objective.step(move)))
            jacobian = residual.new_zeros(len(residual), colours, residual.shape[1], move.shape[1])
            for colour in range(min(colours, len(residual))):
                centre = self.local - (self.local - colour) % colours  # whose residual looks at each free frame
                there = (centre >= 0) & (centre < len(residual))
                for n, total in enumerate(residual[colour::colours].sum(0)):
                    (by_frame,) = torch.autograd.grad(total, move, retain_graph=True, allow_unused=True)
                    if by_frame is not None:
                        jacobian[centre[there], (self.local - centre)[there], n] = by_frame[there]
        return residual.detach(), jacobian.detach()


def _coupled(term: Term, objective: FrameObjective, clip: State, coupling: Coupling) -> "_ByStencil | _Differentiated":
    """A term over time, by the method of its derivatives."""
    if type(term) is Evenness and objective.fused is not None and not objective.free.betas:
        return _OfJoints(term, objective, clip, coupling)
    return (_ByStencil if term.derivative is Derivative.STENCIL else _Differentiated)(term, objective, clip, coupling)


class Sequence(OnFrames):
    """Sum of E_o over free frames + the terms over time that depend on any of them: phase 3, a window, a re-run.

    A residual couples frames up to 2 reach apart, so that the matrix is block-banded and a step costs O(frames).

    Args:
        objective: E_o with fixed betas, and the terms over time.
        clip: all frames; those that are not free are held in this state.
        free: which frames move.
        windowed: include residuals as the paper's windows do: those of free frames that depend on none after these.
            Otherwise all residuals that depend on a free frame.
    """

    groups = 1
    coupled_in_time = True

    def __init__(self, objective: FrameObjective, clip: State, free: range, *, windowed: bool = False) -> None:
        self.objective = objective
        self.frames = torch.arange(free.start, free.stop, device=clip.vector.device)
        self.unknowns = len(free) * len(objective.index)
        self.bandwidth = 2 * max((term.reach for term in objective.coupling), default=0)
        """Frames to either side that a frame is coupled to."""
        self.coupled: dict[str, _ByStencil | _Differentiated] = {}
        for term in objective.coupling:
            coupling = Coupling.of(free, len(clip), term.reach, windowed=windowed)
            self.coupled[term.name] = _coupled(term, objective, clip, coupling)

    def rows(self, groups: Tensor) -> Tensor:
        """All free frames."""
        return torch.arange(len(self.frames), device=groups.device)

    def spread(self, x: Tensor) -> Tensor:
        """The free columns of each frame in order."""
        return self.objective.step(x.view(len(self.frames), -1))

    def cost(self, state: State, groups: Tensor) -> Float[Tensor, "1"]:
        """E of the free frames."""
        own = self.objective.cost(state, self.frames).sum()
        return (own + sum(term.cost(state) for term in self.coupled.values()))[None]

    def terms(self, state: State) -> dict[str, float]:
        """Of E_o, and those over time."""
        coupled = {name: float(term.cost(state)) / len(self.frames) for name, term in self.coupled.items()}
        return {**mean_costs(self.objective.costs(state, self.frames)), **coupled}

    def normal(self, state: State, groups: Tensor) -> tuple[Tensor, ...]:
        """Cost, gradient, diagonal blocks, and the blocks one, two, ... below."""
        n = self.objective.normal(state, self.frames)
        count, width = n.gradient.shape
        below = [n.matrix.new_zeros(max(count - k, 0), width, width) for k in range(1, self.bandwidth + 1)]
        bands, cost = [n.matrix, *below], n.cost.sum()
        for term in self.coupled.values():
            cost = cost + term.add(state, n.gradient, bands)
        return cost[None], n.gradient[None], *(band[None] for band in bands)

    def solve(self, normal: tuple[Tensor, ...], damping: Tensor) -> Step:
        """One block-banded Cholesky factorisation."""
        _, gradient, diagonal, *below = (a[0] for a in normal)
        extra = damping_diagonal(diagonal.diagonal(dim1=1, dim2=2), damping.expand(len(diagonal)))
        damped = diagonal.clone()
        damped.diagonal(dim1=1, dim2=2).add_(extra)
        solution = solve_block_banded([damped, *below], gradient)
        solved = torch.tensor([solution is not None], device=gradient.device)
        move = torch.zeros_like(gradient) if solution is None else -solution
        predicted = -(gradient * move).sum() + (extra * move * move).sum()
        return Step(self.objective.step(move), predicted[None], solved)
