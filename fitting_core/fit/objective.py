"""The per-frame objective E_o: terms summed into costs, gradients and Gauss-Newton matrices."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.kinematics import turned_bins
from fitting_core.body.model import POSE_COLUMNS
from fitting_core.fit.terms.terms import Data, Rows, Term
from fitting_core.fit.variables.estimate import Estimate, View
from fitting_core.fit.variables.point_jacobian import PointJacobian
from fitting_core.fit.variables.state import Free, State

CHUNK = 8
"""Frames whose Jacobians are formed together: (frames, 274, 116) float64 must stay in the cache."""


@dataclass(frozen=True)
class Normal:
    """Cost E of each frame, infinite as in `cost`; half gradient and half Gauss-Newton matrix in the free columns."""

    cost: Float[Tensor, "B"]
    gradient: Float[Tensor, "B d"]
    matrix: Float[Tensor, "B d d"]


class FrameObjective:
    """E_o of the frames of a clip, each frame on its own.

    Args:
        terms: what is summed.
        view: points and camera.
        free: the groups that may move; the rest of a state's columns stay.
    """

    def __init__(self, terms: Sequence[Term], view: View, free: Free) -> None:
        self.terms, self.view, self.free = list(terms), view, free
        p = view.parametrisation
        self.index = free.index(p.columns).to(p.device)
        self.jacobian = PointJacobian(view.points, view.pose_columns, free, p.hand_basis)
        self._pose_index = free.index(view.pose_columns).to(p.device)

    def residuals(self, state: State, frames: Int[Tensor, "B"]) -> dict[str, Float[Tensor, "B n"]]:
        """Weighted residuals by term."""
        estimate = Estimate(self.view, state, frames)
        return {term.name: term.residual(estimate) for term in self.terms}

    def costs(self, state: State, frames: Int[Tensor, "B"]) -> dict[str, Float[Tensor, "B"]]:
        """E of each frame by term."""
        return {name: r.square().sum(1) for name, r in self.residuals(state, frames).items()}

    def cost(self, state: State, frames: Int[Tensor, "B"]) -> Float[Tensor, "B"]:
        """E of each frame; infinite where a point lies behind the camera."""
        estimate = Estimate(self.view, state, frames)
        total = sum(
            (term.residual(estimate).square().sum(1) for term in self.terms), state.vector.new_zeros(len(state))
        )
        return torch.where(estimate.valid, total, torch.inf)

    def softened(self, *, cold: bool) -> "FrameObjective | None":
        """The same with gentler terms for staircases and, from a cold start, for robust ones; None without any."""
        terms = [_gentler(term, cold=cold) for term in self.terms]
        if all(new is old for new, old in zip(terms, self.terms, strict=True)):
            return None
        other = copy(self)
        other.terms = terms
        return other

    def trusting(self) -> "FrameObjective":
        """The same with a data term that takes every keypoint at its word, however far off it is."""
        other = copy(self)
        other.terms = [term.trusting() if isinstance(term, Data) else term for term in self.terms]
        return other

    def with_contour(self, degrees: int) -> "FrameObjective":
        """The same with the face contour's tables of heads that are turned so much further."""
        other = copy(self)
        bins = self.view.contour_bin
        assert bins is not None, "no contour landmark is looked at"
        other.view = replace(self.view, contour_bin=turned_bins(bins, degrees))
        return other

    def step(self, move: Float[Tensor, "B d"]) -> Float[Tensor, "B total"]:
        """A step in the free columns as a step of the whole state."""
        full = move.new_zeros(len(move), self.view.parametrisation.columns.total)
        full[:, self.index] = move
        return full

    def normal(self, state: State, frames: Int[Tensor, "B"]) -> Normal:
        """Costs and normal equations, in chunks of frames that stay in the cache."""
        parts = [self._normal(Estimate(self.view, state[i], frames[i])) for i in torch.arange(len(frames)).split(CHUNK)]
        return Normal(
            torch.cat([p.cost for p in parts]),
            torch.cat([p.gradient for p in parts]),
            torch.cat([p.matrix for p in parts]),
        )

    def _normal(self, e: Estimate) -> Normal:
        frames, width = len(e.frames), self.jacobian.width
        cost, gradient = e.body_pose.new_zeros(frames), e.body_pose.new_zeros(frames, width)
        matrix = e.body_pose.new_zeros(frames, width, width)
        later: list[Term] = []
        for term in self.terms:
            cost = cost + term.residual(e).square().sum(1)
            if hasattr(term, "rows"):
                _add_rows(gradient, matrix, term.rows(e, self.jacobian))  # pyright: ignore
            elif hasattr(term, "columns") and term.columns(e)[1]:  # pyright: ignore
                self._add_columns(gradient, matrix, term, e, self._pose_index)
            else:
                later.append(term)
        gradient, matrix = self.to_prior_space(e, gradient, matrix)
        for term in later:
            if hasattr(term, "columns"):
                self._add_columns(gradient, matrix, term, e, self.index)
            else:
                _add_rows(gradient, matrix, self._differentiated(term, e))
        return Normal(torch.where(e.valid, cost, torch.inf), gradient, matrix)

    def _add_columns(self, gradient: Tensor, matrix: Tensor, term, e: Estimate, index: Tensor) -> None:
        columns, _ = term.columns(e)
        match = columns[:, None] == index
        used = match.any(1)
        place = match[used].long().argmax(1)
        slope = term.slope(e)[:, used]
        gradient[:, place] += slope * term.residual(e)[:, used]
        matrix[:, place, place] += slope * slope

    def prior_jacobian(self, e: Estimate) -> Float[Tensor, "B 63 size"] | None:
        """d axis-angle / d prior's numbers, where the body is free; None for the identity."""
        p = self.view.parametrisation
        return p.prior.jacobian(e.state.vector[:, p.columns.body]) if self.free.body else None

    def to_prior_space(self, e: Estimate, gradient: Tensor, matrix: Tensor) -> tuple[Tensor, Tensor]:
        """Normal equations in the axis-angle pose -> in the prior's own numbers."""
        decoder = self.prior_jacobian(e)
        if decoder is None:
            return gradient, matrix
        chain = chain_matrix(decoder, gradient.shape[1])
        return (chain.transpose(1, 2) @ gradient[..., None])[..., 0], chain.transpose(1, 2) @ matrix @ chain

    def _differentiated(self, term: Term, e: Estimate) -> Rows:
        """Rows of a term that gives its residual only, by reverse differentiation."""
        with torch.enable_grad():
            move = e.body_pose.new_zeros(len(e.frames), len(self.index), requires_grad=True)
            moved = Estimate(self.view, e.state.moved(self.step(move)), e.frames)
            residual = term.residual(moved)
            columns = residual.sum(0)
            rows = [torch.autograd.grad(c, move, retain_graph=True, allow_unused=True)[0] for c in columns]
        jacobian = torch.stack([torch.zeros_like(move) if r is None else r for r in rows], 1)
        return Rows(residual.detach(), jacobian.detach())


def chain_matrix(decoder: Float[Tensor, "B 63 z"], width: int) -> Float[Tensor, "B w v"]:
    """blockdiag(I, decoder, I): derivative of the axis-angle columns by the prior's columns."""
    (frames, _, size), body = decoder.shape, POSE_COLUMNS["body_pose"]
    start, stop, tail = body.start, body.start + size, width - body.stop
    chain = decoder.new_zeros(frames, width, stop + tail)
    chain[:, range(start), range(start)] = 1
    chain[:, body, start:stop] = decoder
    chain[:, range(body.stop, width), range(stop, stop + tail)] = 1
    return chain


def _add_rows(gradient: Tensor, matrix: Tensor, rows: Rows) -> None:
    j = rows.jacobian
    gradient += (j.transpose(1, 2) @ rows.residual[..., None])[..., 0]
    matrix.baddbmm_(j.transpose(1, 2), j)
    if rows.extra_gradient is not None:
        gradient += rows.extra_gradient


def _gentler(term: Term, *, cold: bool) -> Term:
    if isinstance(term, Data):
        return term.widened() if cold else term
    return term.softened() if hasattr(term, "softened") else term  # pyright: ignore
