"""The temporal term E_T and the problem that it couples: consecutive frames of a clip, the rest held constant."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.body.points.pairs import Joint
from fitting_core.body.points.points import BodyPoints
from fitting_core.fit.objective import CHUNK, FrameObjective, chain_matrix
from fitting_core.fit.solvers.banded import solve_block_banded
from fitting_core.fit.solvers.problem import OnFrames, Step, damping_diagonal, mean_costs
from fitting_core.fit.variables.estimate import Estimate, View
from fitting_core.fit.variables.point_jacobian import PointJacobian
from fitting_core.fit.variables.state import Parametrisation, State

STENCIL = ((-1, -1 / 3), (0, 2 / 3), (1, -1 / 3))
"""J_i - mean(J_{i-1}, J_i, J_{i+1}) = (2 J_i - J_{i-1} - J_{i+1}) / 3 (paper, equation of E_T)."""
_SIZE = 3 * N_JOINTS


class JointPositions:
    """The 55 joints that E_T compares, in the body's own space or in camera space."""

    def __init__(self, body: BodyModel, parametrisation: Parametrisation, *, in_camera: bool) -> None:
        points = BodyPoints(
            body, [Joint(j) for j in range(N_JOINTS)], dtype=parametrisation.dtype, device=parametrisation.device
        )
        unit = torch.ones(2, dtype=parametrisation.dtype, device=parametrisation.device)
        self.view = View(parametrisation, points, unit, 0 * unit)
        self.in_camera = in_camera

    def estimate(self, state: State) -> Estimate:
        """The state's joints, evaluated when asked for."""
        return Estimate(self.view, state, torch.arange(len(state), device=state.vector.device))

    def __call__(self, state: State) -> Float[Tensor, "B 55 3"]:
        """Metres."""
        return self._positions(self.estimate(state))

    def _positions(self, e: Estimate) -> Tensor:
        return e.in_camera if self.in_camera else e.posed.points

    def with_jacobian(self, e: Estimate, objective: FrameObjective, jacobian: PointJacobian) -> tuple[Tensor, Tensor]:
        """Positions (B, 165) and their derivative (B, 165, d) by the objective's free columns."""
        identity = torch.eye(3, dtype=e.state.vector.dtype, device=e.state.vector.device)
        left = identity.expand(len(e.state), N_JOINTS, 3, 3)
        rows = jacobian(e.posed, left, translation=self.in_camera)
        decoder = objective.prior_jacobian(e)
        if decoder is not None:
            rows = rows @ chain_matrix(decoder, rows.shape[2])
        return self._positions(e).flatten(1), rows


@dataclass(frozen=True)
class Coupling:
    """Which residuals of E_T count, and which frames move.

    L, the stencil at every centre, is never written out: with its square it would be frames times frames.
    """

    free: Int[Tensor, "n"]
    """Consecutive frames of the clip that move."""
    first: int
    """First frame that any residual looks at."""
    span: int
    """How many frames from there on they look at."""
    centres: range
    """Of the residuals that count, from `first` on."""

    @staticmethod
    def of(free: range, centres: range, frames: int, device: torch.device | None = None) -> "Coupling":
        """Residuals centred on `centres` that touch a free frame; centres without two neighbours have none."""
        first, stop = max(0, free.start - 2), min(frames, free.stop + 2)
        begin, end = max(centres.start, 1, free.start - 1), min(centres.stop, frames - 1, free.stop + 1)
        counted = range(begin - first, max(begin, end) - first)
        return Coupling(torch.arange(free.start, free.stop, device=device), first, stop - first, counted)

    def _at(self, offset: int) -> slice:
        return slice(self.centres.start + offset, self.centres.stop + offset)

    def residuals(self, values: Float[Tensor, "s m"]) -> Float[Tensor, "c m"]:
        """L times values of the frames from `first` on."""
        if not self.centres:
            return values[:0]
        return torch.stack([weight * values[self._at(offset)] for offset, weight in STENCIL]).sum(0)

    def transposed(self, residuals: Float[Tensor, "c m"]) -> Float[Tensor, "s m"]:
        """L^T times residuals."""
        values = residuals.new_zeros(self.span, residuals.shape[1])
        for offset, weight in STENCIL if self.centres else ():
            values[self._at(offset)] += weight * residuals
        return values

    def bands(self, like: Tensor) -> list[Tensor]:
        """The diagonal of L^T L over the free frames, and the two below it."""
        bands = []
        for k in range(3):
            band = like.new_zeros(self.span)
            for lower, a in STENCIL if self.centres else ():
                for upper, b in STENCIL:
                    if lower - upper == k:
                        band[self._at(upper)] += a * b
            start = int(self.free[0]) - self.first
            bands.append(band[start : start + max(len(self.free) - k, 0)])
        return bands


class Sequence(OnFrames):
    """Sum of E_o over free frames + w_T^2 sum over centres |sum_k s_k J_{centre + k}|^2: phase 3, a window, a re-run.

    With L the stencil at every centre and c = L^T L, the half gradient of frame i is w^2 D_i^T sum_j c_ij J_j and the
    blocks of the half matrix are w^2 c_ij D_i^T D_j: block-pentadiagonal, so that a step costs O(frames).

    Args:
        objective: E_o with fixed betas.
        joints: evaluates what E_T compares.
        held: (T, 55, 3) the joints of every frame of the clip; those of free frames are not read.
        coupling: which frames move and which residuals count.
        weight: w_T.
    """

    groups = 1
    coupled_in_time = True

    def __init__(
        self, objective: FrameObjective, joints: JointPositions, held: Tensor, coupling: Coupling, weight: float
    ) -> None:
        self.objective, self.joints, self.coupling, self.weight = objective, joints, coupling, weight
        p = objective.view.parametrisation
        self.jacobian = PointJacobian(joints.view.points, joints.view.pose_columns, objective.free, p.hand_basis)
        self.held = held[coupling.first : coupling.first + coupling.span].reshape(-1, _SIZE)
        self.local = coupling.free - coupling.first
        self.unknowns = len(self.local) * len(objective.index)
        self.bands = coupling.bands(held)

    def rows(self, groups: Tensor) -> Tensor:
        """All free frames."""
        return torch.arange(len(self.local), device=groups.device)

    def spread(self, x: Tensor) -> Tensor:
        """Frame after frame their free columns."""
        return self.objective.step(x.view(len(self.local), -1))

    def _all_joints(self, positions: Float[Tensor, "n 165"]) -> Float[Tensor, "s 165"]:
        every = self.held.clone()
        every[self.local] = positions
        return every

    def temporal_cost(self, positions: Float[Tensor, "n 165"]) -> Tensor:
        """E_T summed over the counted residuals."""
        return self.weight**2 * self.coupling.residuals(self._all_joints(positions)).square().sum()

    def cost(self, state: State, groups: Tensor) -> Float[Tensor, "1"]:
        """E of the free frames."""
        own = self.objective.cost(state, self.coupling.free).sum()
        return (own + self.temporal_cost(self.joints(state).flatten(1)))[None]

    def terms(self, state: State) -> dict[str, float]:
        """Of E_o, and E_T as "temporal"."""
        temporal = self.temporal_cost(self.joints(state).flatten(1)) / len(self.local)
        return {**mean_costs(self.objective.costs(state, self.coupling.free)), "temporal": float(temporal)}

    def normal(self, state: State, groups: Tensor) -> tuple[Tensor, ...]:
        """Cost, gradient, diagonal blocks, and the blocks one and two below."""
        n = self.objective.normal(state, self.coupling.free)
        positions, blocks, rows = self._temporal_blocks(state, n.matrix)
        cost = n.cost.sum() + self.temporal_cost(positions)
        residuals = self.coupling.residuals(self._all_joints(positions))
        pull = self.weight**2 * self.coupling.transposed(residuals)[self.local]
        gradient = n.gradient + _pulled_back(rows, pull)
        return cost[None], gradient[None], *(b[None] for b in blocks)

    def _temporal_blocks(self, state: State, diagonal: Tensor) -> tuple[Tensor, list[Tensor], list[Tensor]]:
        """Joint positions, the three bands of the matrix, and the Jacobians chunk by chunk."""
        count, width = diagonal.shape[:2]
        bands = [diagonal, *(diagonal.new_empty(max(count - k, 0), width, width) for k in (1, 2))]
        scale = [self.weight**2 * band[:, None, None] for band in self.bands]
        positions = []
        rows_kept: list[Tensor] = []
        before = diagonal.new_zeros(0, _SIZE, width)
        for i in torch.arange(count).split(CHUNK):
            here, rows = self.joints.with_jacobian(self.joints.estimate(state[i]), self.objective, self.jacobian)
            positions.append(here)
            reach = torch.cat([before, rows])
            start, first = int(i[0]), int(i[0]) - len(before)
            bands[0][i] += scale[0][i] * (rows.transpose(1, 2) @ rows)
            for k in (1, 2):
                j = torch.arange(max(start - k, 0), max(int(i[-1]) + 1 - k, 0))
                if len(j):
                    bands[k][j] = scale[k][j] * (reach[j + k - first].transpose(1, 2) @ reach[j - first])
            rows_kept.append(rows)
            before = reach[-2:]
        return torch.cat(positions), bands, rows_kept

    def solve(self, normal: tuple[Tensor, ...], damping: Tensor) -> Step:
        """One block-banded Cholesky factorisation."""
        _, gradient, diagonal, off1, off2 = (a[0] for a in normal)
        extra = damping_diagonal(diagonal.diagonal(dim1=1, dim2=2), damping.expand(len(diagonal)))
        damped = diagonal.clone()
        damped.diagonal(dim1=1, dim2=2).add_(extra)
        solution = solve_block_banded(damped, off1, off2, gradient)
        solved = torch.tensor([solution is not None], device=gradient.device)
        move = torch.zeros_like(gradient) if solution is None else -solution
        predicted = -(gradient * move).sum() + (extra * move * move).sum()
        return Step(self.objective.step(move), predicted[None], solved)


def _pulled_back(rows: list[Tensor], pull: Float[Tensor, "n 165"]) -> Float[Tensor, "n d"]:
    parts = [(r.transpose(1, 2) @ p[..., None])[..., 0] for r, p in zip(rows, pull.split(CHUNK), strict=True)]
    return torch.cat(parts)
