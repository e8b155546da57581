"""The objective of a stage: terms summed into costs, gradients and Gauss-Newton matrices of single frames.

These are E_o. Terms that couple frames, or count once for the clip, are kept here for the problems that need them.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.model import POSE_COLUMNS
from fitting_core.fit.fused.ready import fused_frames
from fitting_core.fit.terms.data import Data
from fitting_core.fit.terms.positions import RelativePosition
from fitting_core.fit.terms.term import Derivative, Rows, Term
from fitting_core.fit.variables.estimate import Estimate, SolverView
from fitting_core.fit.variables.point_jacobian import PointJacobian
from fitting_core.fit.variables.state import Free, State

_EVALUATED = 512
"""Frames whose costs by term are evaluated together: 35 kB per frame."""


def jacobians_at_once(device: torch.device) -> int:
    """Frames whose Jacobians are formed together.

    On a CPU (frames, 274, 116) float64 must stay in the cache; a GPU takes few large operations, as many as fit.
    """
    return 8 if device.type == "cpu" else 512


@dataclass(frozen=True)
class Normal:
    """Cost E of each frame, infinite as in `cost`; half gradient and half Gauss-Newton matrix in the free columns."""

    cost: Float[Tensor, "B"]
    gradient: Float[Tensor, "B d"]
    matrix: Float[Tensor, "B d d"]


class FrameObjective:
    """E_o of the frames of a clip, each frame on its own.

    Args:
        terms: of a stage.
        view: points and camera.
        free: the groups that may move; a state's other columns stay.
    """

    def __init__(self, terms: Sequence[Term], view: SolverView, free: Free) -> None:
        self.view, self.free = view, free
        self.terms = [term for term in terms if not term.reach and not term.once]
        """Terms summed in each frame."""
        self.coupling = [term for term in terms if term.reach]
        """Terms over time, for problems that fit frames together."""
        self.shared = [term for term in terms if term.once]
        """Terms that count once for all frames."""
        assert not any(term.reach for term in self.shared), "what counts once has no reach in time"
        p = view.parametrisation
        self.index = free.index(p.columns).to(p.device)
        self.jacobian = PointJacobian(view.points, view.pose_columns, free, p.hand_basis)
        self._pose_index = free.index(view.pose_columns).to(p.device)
        self.fused = fused_frames(self.terms, view, free, self.index)
        """Kernels that evaluate the terms they know; None if there are none."""

    @property
    def data(self) -> Data:
        """The data term."""
        return next(term for term in self.terms if isinstance(term, Data))

    def with_data(self, data: Data) -> "FrameObjective":
        """The same with other keypoints."""
        other = copy(self)
        other.terms = [data if term is self.data else term for term in self.terms]
        other.fused = None if self.fused is None else self.fused.with_data(data)
        return other

    @property
    def relative_position(self) -> RelativePosition | None:
        """The term of positions relative to the pelvis; None if only the image says where keypoints are."""
        return next((term for term in self.terms if isinstance(term, RelativePosition)), None)

    def with_relative_position(self, term: RelativePosition) -> "FrameObjective":
        """The same with other positions relative to the pelvis."""
        other = copy(self)
        other.terms = [term if old is self.relative_position else old for old in self.terms]
        other.fused = None if self.fused is None else fused_frames(other.terms, self.view, self.free, self.index)
        return other

    def costs(self, state: State, frames: Int[Tensor, "B"]) -> dict[str, Float[Tensor, "B"]]:
        """E of each frame by term."""
        index = torch.arange(len(frames), device=frames.device)
        parts = [costs_of(self.terms, Estimate(self.view, state[i], frames[i])) for i in index.split(_EVALUATED)]
        return {name: torch.cat([part[name] for part in parts]) for name in parts[0]}

    def coupled_costs(self, state: State, first: int | None = None) -> dict[str, float]:
        """Terms over time, each summed over a clip whose frames are all in `state`, or over those residuals that begin
        in its first frames; 0 if it is too short."""
        return {
            term.name: self._coupled_cost(term, state if first is None else state[: first + 2 * term.reach])
            for term in self.coupling
        }

    def _coupled_cost(self, term: Term, state: State) -> float:
        frames, total = torch.arange(len(state), device=state.vector.device), 0.0
        for start in range(0, len(state) - 2 * term.reach, _EVALUATED):
            i = frames[start : start + _EVALUATED + 2 * term.reach]
            total += float(term.residual(Estimate(self.view, state[i], i)).square().sum())
        return total

    def shared_costs(self, state: State) -> dict[str, Float[Tensor, "1"]]:
        """Terms that count once, evaluated on any one frame."""
        return costs_of(self.shared, self._first(state))

    def shared_normal(self, state: State) -> Normal:
        """Cost and normal equations of the terms that count once, evaluated on any one frame."""
        return self._normal(self._first(state), self.shared)

    def _first(self, state: State) -> Estimate:
        return Estimate(self.view, state[:1], torch.zeros(1, dtype=torch.long, device=state.vector.device))

    def cost(self, state: State, frames: Int[Tensor, "B"]) -> Float[Tensor, "B"]:
        """E of each frame; infinite if a point is behind the camera."""
        if self.fused is None or state.vector.requires_grad:
            return self._cost(state, frames, self.terms)
        known = self.fused.cost(state, frames)
        return known + self._cost(state, frames, self.fused.others) if self.fused.others else known

    def _cost(self, state: State, frames: Tensor, terms: list[Term]) -> Tensor:
        estimate = Estimate(self.view, state, frames)
        total = sum((term.residual(estimate).square().sum(1) for term in terms), state.vector.new_zeros(len(state)))
        return torch.where(estimate.valid, total, torch.inf)

    def softened(self, *, cold: bool) -> "FrameObjective | None":
        """The same with gentler staircases and, from a cold start, gentler robust terms; None if there are none."""
        terms = [term.softened(cold=cold) for term in self.terms]
        same = all(new is old for new, old in zip(terms, self.terms, strict=True))
        if same:
            return None
        other = copy(self)
        other.terms, other.fused = terms, fused_frames(terms, self.view, self.free, self.index)
        return other

    def step(self, move: Float[Tensor, "B d"]) -> Float[Tensor, "B total"]:
        """A step in the free columns as a step of the whole state."""
        full = move.new_zeros(len(move), self.view.parametrisation.columns.total)
        full[:, self.index] = move
        return full

    def normal(self, state: State, frames: Int[Tensor, "B"]) -> Normal:
        """Costs and normal equations, in torch in chunks of frames that stay in the cache."""
        if self.fused is None:
            return self._in_chunks(state, frames, self.terms)
        known = Normal(*self.fused.normal(state, frames))
        if not self.fused.others:
            return known
        rest = self._in_chunks(state, frames, self.fused.others)
        return Normal(known.cost + rest.cost, known.gradient + rest.gradient, known.matrix + rest.matrix)

    def _in_chunks(self, state: State, frames: Tensor, terms: list[Term]) -> Normal:
        index = torch.arange(len(frames), device=frames.device)
        parts = [
            self._normal(Estimate(self.view, state[i], frames[i]), terms)
            for i in index.split(jacobians_at_once(frames.device))
        ]
        return Normal(
            torch.cat([p.cost for p in parts]),
            torch.cat([p.gradient for p in parts]),
            torch.cat([p.matrix for p in parts]),
        )

    def _normal(self, e: Estimate, terms: list[Term]) -> Normal:
        frames, width = len(e.frames), self.jacobian.width
        cost, gradient = e.body_pose.new_zeros(frames), e.body_pose.new_zeros(frames, width)
        matrix = e.body_pose.new_zeros(frames, width, width)
        for term in terms:
            cost = cost + term.residual(e).square().sum(1)
            if add := _IN_POSE_SPACE.get(term.derivative):
                add(self, gradient, matrix, term, e)
        gradient, matrix = self.to_prior_space(e, gradient, matrix)
        for term in terms:
            if add := _IN_PRIOR_SPACE.get(term.derivative):
                add(self, gradient, matrix, term, e)
        return Normal(torch.where(e.valid, cost, torch.inf), gradient, matrix)

    def _add_rows(self, gradient: Tensor, matrix: Tensor, term: Term, e: Estimate) -> None:
        _add(gradient, matrix, term.rows(e, self.jacobian))

    def _add_differentiated(self, gradient: Tensor, matrix: Tensor, term: Term, e: Estimate) -> None:
        _add(gradient, matrix, self._differentiated(term, e))

    def _add_columns(self, gradient: Tensor, matrix: Tensor, term: Term, e: Estimate) -> None:
        _add_diagonal(gradient, matrix, term, e, self.index)

    def _add_pose_columns(self, gradient: Tensor, matrix: Tensor, term: Term, e: Estimate) -> None:
        _add_diagonal(gradient, matrix, term, e, self._pose_index)

    def prior_jacobian(self, e: Estimate) -> Float[Tensor, "B 63 size"] | None:
        """d axis-angle / d prior's numbers, if the body is free; None for the identity."""
        p = self.view.parametrisation
        return p.prior.jacobian(e.state.vector[:, p.columns.body]) if self.free.body else None

    def to_prior_space(self, e: Estimate, gradient: Tensor, matrix: Tensor) -> tuple[Tensor, Tensor]:
        """Normal equations in the axis-angle pose -> in the prior's own numbers."""
        decoder = self.prior_jacobian(e)
        if decoder is None:
            return gradient, matrix
        chain = _chain(decoder, gradient.shape[1])
        return (chain.transpose(1, 2) @ gradient[..., None])[..., 0], chain.transpose(1, 2) @ matrix @ chain

    def rows_in_prior_space(self, e: Estimate, rows: Float[Tensor, "B n width"]) -> Float[Tensor, "B n d"]:
        """A Jacobian by the columns of the axis-angle pose -> by the prior's own numbers."""
        decoder = self.prior_jacobian(e)
        return rows if decoder is None else rows @ _chain(decoder, rows.shape[2])

    def _differentiated(self, term: Term, e: Estimate) -> Rows:
        """Rows of a term that gives only its residual, by reverse differentiation."""
        with torch.enable_grad():
            move = e.body_pose.new_zeros(len(e.frames), len(self.index), requires_grad=True)
            moved = Estimate(self.view, e.state.moved(self.step(move)), e.frames)
            residual = term.residual(moved)
            columns = residual.sum(0)
            rows = [torch.autograd.grad(c, move, retain_graph=True, allow_unused=True)[0] for c in columns]
        jacobian = torch.stack([torch.zeros_like(move) if r is None else r for r in rows], 1)
        return Rows(residual.detach(), jacobian.detach())


def costs_of(terms: list[Term], e: Estimate) -> dict[str, Float[Tensor, "B"]]:
    """Sums of squared residuals by term."""
    return {term.name: term.residual(e).square().sum(1) for term in terms}


def _chain(decoder: Float[Tensor, "B 63 z"], width: int) -> Float[Tensor, "B w v"]:
    """blockdiag(I, decoder, I): derivative of the axis-angle columns by the prior's columns."""
    (frames, _, size), body = decoder.shape, POSE_COLUMNS["body_pose"]
    start, stop, tail = body.start, body.start + size, width - body.stop
    chain = decoder.new_zeros(frames, width, stop + tail)
    chain[:, range(start), range(start)] = 1
    chain[:, body, start:stop] = decoder
    chain[:, range(body.stop, width), range(stop, stop + tail)] = 1
    return chain


def _add(gradient: Tensor, matrix: Tensor, rows: Rows) -> None:
    j = rows.jacobian
    gradient += (j.transpose(1, 2) @ rows.residual[..., None])[..., 0]
    matrix.baddbmm_(j.transpose(1, 2), j)
    if rows.extra_gradient is not None:
        gradient += rows.extra_gradient


def _add_diagonal(gradient: Tensor, matrix: Tensor, term: Term, e: Estimate, index: Tensor) -> None:
    match = term.columns(e)[:, None] == index
    used = match.any(1)
    place = match[used].long().argmax(1)
    slope = term.slope(e)[:, used]
    gradient[:, place] += slope * term.residual(e)[:, used]
    matrix[:, place, place] += slope * slope


_Adding = Callable[[FrameObjective, Tensor, Tensor, Term, Estimate], None]
_IN_POSE_SPACE: dict[Derivative, _Adding] = {
    Derivative.ROWS: FrameObjective._add_rows,
    Derivative.POSE_COLUMNS: FrameObjective._add_pose_columns,
}
_IN_PRIOR_SPACE: dict[Derivative, _Adding] = {
    Derivative.COLUMNS: FrameObjective._add_columns,
    Derivative.AUTOMATIC: FrameObjective._add_differentiated,
}
"""How a term enters the normal equations: before they are transformed into the pose prior's own space, or after."""
