"""The objective of a stage: terms summed into costs, gradients and Gauss-Newton matrices of single frames.

These are E_o. E_T, which couples frames, and terms that count once for the clip are kept here for the problems that
need them.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.fit.fused.ready import fused_frames
from fitting_core.fit.terms.data import Data
from fitting_core.fit.terms.positions import RelativePosition
from fitting_core.fit.terms.temporal import REACH, JointPositions, Smoothness
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate, SolverView
from fitting_core.fit.variables.state import Free, State

if TYPE_CHECKING:
    from fitting_core.fit.fused.frames import Evaluated, FusedFrames

_EVALUATED = 512
"""Frames whose costs by term are evaluated together: 35 kB per frame."""


def jacobians_at_once(device: torch.device) -> int:
    """Frames whose Jacobians are formed together.

    Forward differentiation carries every intermediate value once for each column: 2 MB per frame for the points.
    """
    return 16 if device.type == "cpu" else 128


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
        self.terms = [term for term in terms if not isinstance(term, Smoothness) and not term.once]
        """Terms summed in each frame."""
        self.smoothness = next((term for term in terms if isinstance(term, Smoothness)), None)
        """E_T, for problems that fit frames together."""
        self.shared = [term for term in terms if term.once]
        """Terms that count once for all frames."""
        p = view.parametrisation
        self.index = free.index(p.columns).to(p.device)
        self.fused = fused_frames(self.terms, view, free, self.index)
        """Kernels of the terms that have one; None if no term has."""

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

    def costs_over_time(self, state: State, first: int | None = None) -> dict[str, float]:
        """E_T by its name, if it counts, summed over a clip whose frames are all in `state`, or over those residuals
        that begin in its first frames; 0 if it is too short."""
        if self.smoothness is None:
            return {}
        state = state if first is None else state[: first + 2 * REACH]
        frames, total = torch.arange(len(state), device=state.vector.device), 0.0
        for start in range(0, len(state) - 2 * REACH, _EVALUATED):
            i = frames[start : start + _EVALUATED + 2 * REACH]
            total += float(self.smoothness.residual(Estimate(self.view, state[i], i)).square().sum())
        return {self.smoothness.name: total}

    def shared_costs(self, state: State) -> dict[str, Float[Tensor, "1"]]:
        """Terms that count once, evaluated on any one frame."""
        return costs_of(self.shared, Estimate(self.view, state[:1], self._first))

    def shared_normal(self, state: State) -> Normal:
        """Cost and normal equations of the terms that count once, evaluated on any one frame."""
        return self._normal(state[:1], self._first, self.shared)

    @property
    def _first(self) -> Int[Tensor, "1"]:
        return self.index.new_zeros(1)

    def cost(self, state: State, frames: Int[Tensor, "B"]) -> Float[Tensor, "B"]:
        """E of each frame; infinite if a point is behind the camera."""
        if self.fused is None or state.vector.requires_grad:
            return self._cost(state, frames, self.terms)
        return self._with_others(self.fused.evaluated(state, frames).cost, state, frames)

    def _with_others(self, known: Tensor, state: State, frames: Tensor) -> Tensor:
        """Costs of the terms that have kernels, and of those that have none."""
        assert self.fused is not None
        return known + self._cost(state, frames, self.fused.others) if self.fused.others else known

    def _cost(self, state: State, frames: Tensor, terms: list[Term]) -> Tensor:
        estimate = Estimate(self.view, state, frames)
        total = sum((term.residual(estimate).square().sum(1) for term in terms), state.vector.new_zeros(len(state)))
        return torch.where(estimate.valid, total, torch.inf)

    def softened(self, *, cold: bool) -> "FrameObjective | None":
        """The same with gentler staircases and, from a cold start, gentler robust terms; None if no term is gentler."""
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
        return full.index_copy(1, self.index, move)

    def normal(self, state: State, frames: Int[Tensor, "B"]) -> Normal:
        """Costs and normal equations, in torch in chunks of frames that stay in the cache."""
        if self.fused is None:
            return self._in_chunks(state, frames, self.terms)
        return self._normal_with_others(self.fused.evaluated(state, frames, normal=True), state, frames)

    def _normal_with_others(self, found: "Evaluated", state: State, frames: Tensor) -> Normal:
        assert self.fused is not None
        known = Normal(found.cost, found.gradient, found.matrix)
        if not self.fused.others:
            return known
        rest = self._in_chunks(state, frames, self.fused.others)
        return Normal(known.cost + rest.cost, known.gradient + rest.gradient, known.matrix + rest.matrix)

    def _in_chunks(self, state: State, frames: Tensor, terms: list[Term]) -> Normal:
        index = torch.arange(len(frames), device=frames.device)
        parts = [self._normal(state[i], frames[i], terms) for i in index.split(jacobians_at_once(frames.device))]
        return Normal(
            torch.cat([p.cost for p in parts]),
            torch.cat([p.gradient for p in parts]),
            torch.cat([p.matrix for p in parts]),
        )

    def _normal(self, state: State, frames: Tensor, terms: list[Term]) -> Normal:
        """The gradient by reverse differentiation of the cost; the matrix J^T J without the pose correctives' part of
        J, which costs most and only shapes the steps."""
        move = state.vector.new_zeros(len(frames), len(self.index))
        matrix = move.new_zeros(*move.shape, len(self.index))
        if not terms:
            return Normal(move.sum(1), move, matrix)
        with torch.enable_grad():
            move.requires_grad_()
            cost = self._cost(state.moved(self.step(move)), frames, terms)
            (gradient,) = torch.autograd.grad(cost.sum(), move)
        estimate, automatic = Estimate(self.view, state, frames), list[Term]()
        for term in terms:
            jacobian = term.jacobian(estimate, self.index)
            if jacobian is None:
                automatic.append(term)
            else:
                matrix.baddbmm_(jacobian.mT, jacobian)
        if automatic:
            jacobian = self._differentiated(automatic, state, frames)
            matrix.baddbmm_(jacobian.mT, jacobian)
        return Normal(cost.detach(), gradient / 2, matrix)

    def _differentiated(self, terms: list[Term], state: State, frames: Tensor) -> Float[Tensor, "B n d"]:
        def residuals(state: State) -> Tensor:
            e = Estimate(self.view, state, frames, correctives_held=True)
            return torch.cat([term.reweighted(e) for term in terms], 1)

        return self.differentiated(residuals, state)

    def differentiated(self, function: Callable[[State], Float[Tensor, "B n"]], state: State) -> Float[Tensor, "B n d"]:
        """The Jacobian of a function of single frames by their free columns, by forward differentiation.

        One step moves all frames: as they are independent, its derivative is that of each frame by its own columns.
        """

        def moved(step: Float[Tensor, "d"]) -> Tensor:
            return function(state.moved(self.step(step.expand(len(state), -1))))

        return torch.func.jacfwd(moved)(state.vector.new_zeros(len(self.index)))

    def joints(self, which: JointPositions, state: State, frames: Int[Tensor, "B"]) -> Float[Tensor, "B 165"]:
        """A body's joints."""
        return self.cost_and_joints(which, state, frames)[1]

    def cost_and_joints(
        self, which: JointPositions, state: State, frames: Int[Tensor, "B"]
    ) -> tuple[Float[Tensor, "B"], Float[Tensor, "B 165"]]:
        """E of each frame as of `cost`, and a body's joints."""
        fused = self._posing(state)
        if fused is None:
            return self.cost(state, frames), which.of(which.estimate(state, frames)).flatten(1)
        found = fused.evaluated(state, frames, joints=True)
        return self._with_others(found.cost, state, frames), self._placed(which, found.joints, state, frames)

    def normal_and_joints(
        self, which: JointPositions, state: State, frames: Int[Tensor, "B"]
    ) -> tuple[Normal, Float[Tensor, "B 165"], Float[Tensor, "B 165 d"]]:
        """Costs and normal equations, a body's joints, and their derivatives by the free columns."""
        fused = self._posing(state)
        if fused is None:
            joints = which.of(which.estimate(state, frames)).flatten(1)
            return self.normal(state, frames), joints, self.joint_jacobian(which, state, frames)
        found = fused.evaluated(state, frames, normal=True, rows=True)
        joints, rows = self._placed(which, found.joints, state, frames), self._placed_rows(which, found.rows, frames)
        return self._normal_with_others(found, state, frames), joints, rows

    def joint_jacobian(self, which: JointPositions, state: State, frames: Int[Tensor, "B"]) -> Float[Tensor, "B 165 d"]:
        """Derivatives of a body's joints by the free columns."""
        fused = self._posing(state)
        if fused is not None:
            return self._placed_rows(which, fused.evaluated(state, frames, rows=True).rows, frames)
        parts = torch.arange(len(frames), device=frames.device).split(jacobians_at_once(frames.device))
        return torch.cat(
            [
                self.differentiated(lambda s, i=i: which.of(which.estimate(s, frames[i])).flatten(1), state[i])
                for i in parts
            ]
        )

    def _placed(self, which: JointPositions, joints: Tensor, state: State, frames: Tensor) -> Float[Tensor, "B 165"]:
        """Joints that have no translation where `which` has them."""
        if which.in_camera:
            joints += state.vector[:, None, self.view.parametrisation.columns.translation]
        return which.in_still_space(joints, frames).flatten(1)

    def _placed_rows(self, which: JointPositions, rows: Tensor, frames: Tensor) -> Float[Tensor, "B 165 d"]:
        if which.in_camera and self.free.translation:
            translation = self.view.parametrisation.columns.translation.start
            first = int((self.index == translation).nonzero())
            for axis in range(3):
                rows[:, axis::3, first + axis] = 1.0
        return which.rows_in_still_space(rows, frames)

    def _posing(self, state: State) -> "FusedFrames | None":
        """The kernels if they pose the joints: of a shape that is held, and where nothing is differentiated."""
        return None if self.free.betas or state.vector.requires_grad else self.fused


def costs_of(terms: list[Term], e: Estimate) -> dict[str, Float[Tensor, "B"]]:
    """Sums of squared residuals by term."""
    return {term.name: term.residual(e).square().sum(1) for term in terms}
