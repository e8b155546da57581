"""The collision term of E_o: the intrusion penalty of the body's triangles that collide with each other."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.model import N_BETAS, N_EXPRESSION, N_JOINTS
from fitting_core.body.points.chosen_vertices import PosedVertices, VertexRows
from fitting_core.fit.collision.colliding_body import POSES_AT_ONCE, CollidingBody, CollidingPairs
from fitting_core.fit.collision.distance_field import SIGMA, penetration, residuals_with_jacobian
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.entry import Entry
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate

SOFT_SIGMA = 1e-3
"""Metres, cone height of the softened term, which Levenberg-Marquardt minimises first.

Mean objective of phase 1 on 10 frames of real footage, three of them with an arm in the torso, hands and thighs, or
ankles: 316 without, 276 with 1e-2, 224 with 3e-3, 199 with 1e-3, where all are free. L-BFGS on the faithful term: 213.
"""


@dataclass(frozen=True)
class Collision(Term):
    """weight x the conical distance field of colliding triangles at each other's corners (paper, E_C).

    Costs about 25-40 ms per frame and point on one core (mesh 12, search 10-28); all other terms take 1 ms. Pairs are
    found again at every point and fixed for its derivatives, so the cost jumps when triangles begin to touch. A frame
    whose vertices do not form a body has an infinite residual.
    """

    weight: float
    body: CollidingBody
    sigma: float = SIGMA
    """Metres, the height of the cones above the surface."""
    name: str = "collision"

    def softened(self, *, cold: bool) -> "Collision":
        """With higher cones: at the faithful height a slope of 1e4 per metre at the surface stops every step."""
        return replace(self, sigma=max(self.sigma, SOFT_SIGMA))

    def residual(self, e: Estimate) -> Float[Tensor, "B n"]:
        """Six residuals per pair, zeros after a frame's last pair."""
        pairs = self.body.pairs(e)
        most = max((len(p) for p in pairs if p is not None), default=0)
        out = [self._padded(contacts, posed, most) for contacts, posed in self._chunks(e, pairs)]
        residual = torch.cat(out).flatten(1)
        lost = [p is None for p in pairs]
        if any(lost):
            column = torch.where(torch.tensor(lost, device=residual.device), torch.inf, 0.0).to(residual)
            residual = torch.cat([residual, column[:, None]], 1)
        return residual

    def _chunks(self, e: Estimate, pairs: list[Tensor | None]) -> Iterator[tuple[CollidingPairs, PosedVertices]]:
        p = e.view.parametrisation
        pose, coefficients = p.pose(e.state, e.body_pose), p.coefficients(e.state)
        for start in range(0, len(pairs), POSES_AT_ONCE):
            i = slice(start, start + POSES_AT_ONCE)
            contacts = self.body.contacts(pairs[i])
            yield contacts, self.body.chosen.forward(e.state.orient[i], pose[i], coefficients[i], contacts.ids)

    def _padded(self, contacts: CollidingPairs, posed: PosedVertices, most: int) -> Float[Tensor, "B P 6"]:
        psi = penetration(posed.vertices.flatten(0, 1), contacts.faces, contacts.pairs, sigma=self.sigma)
        out = psi.new_zeros(len(contacts.ids), most, 6)
        return out.index_put((contacts.frame, contacts.rank), self.weight * psi)

    def jacobian(self, e: Estimate, index: Int[Tensor, "d"]) -> Float[Tensor, "B n d"]:
        """In closed form: 17 ms a frame with 150 pairs, where forward differentiation takes 130 or more.

        Only corners inside a cone have rows: elsewhere the residual is zero with zero slope.
        """
        parts = [self._rows(contacts, posed) for contacts, posed in self._chunks(e, self.body.pairs(e))]
        most = max(rows.shape[1] for rows in parts)
        rows = torch.cat([torch.nn.functional.pad(rows, (0, 0, 0, most - rows.shape[1])) for rows in parts])
        by_joint, by_beta, by_expression = rows.split([3 * N_JOINTS, N_BETAS, N_EXPRESSION], 2)
        p = e.view.parametrisation
        found = by_joint @ p.pose_jacobian(e.state)
        found[:, :, p.columns.betas] = by_beta
        found[:, :, p.columns.expression] = by_expression
        return found[:, :, index]

    def _rows(self, contacts: CollidingPairs, posed: PosedVertices) -> Float[Tensor, "B n 185"]:
        """By the axis-angle of all joints, then by betas and expression."""
        psi, by_corner = residuals_with_jacobian(
            posed.vertices.flatten(0, 1), contacts.faces, contacts.pairs, sigma=self.sigma
        )
        pair, which = (psi > 0).nonzero(as_tuple=True)
        rows = VertexRows(contacts.frame[pair], contacts.corner[pair], self.weight * by_corner[pair, which])
        chosen = self.body.chosen
        found = torch.cat([chosen.by_joint(posed, rows).flatten(1), chosen.by_coefficient(posed, rows)], 1)
        rank, most = _ranks(rows.frame)
        return found.new_zeros(len(contacts.ids), most, found.shape[1]).index_put((rows.frame, rank), found)


def _ranks(frame: Int[Tensor, "R"]) -> tuple[Int[Tensor, "R"], int]:
    """The index within its frame of each row (frames ascend), and the largest count."""
    if not len(frame):
        return frame, 0
    counts = frame.bincount()
    first = counts.cumsum(0) - counts
    return torch.arange(len(frame), device=frame.device) - first[frame], int(counts.max())


def _make(context: TermContext, looked: UsedKeypoints, s: int) -> Term | None:
    weight = context.config.weights.collision[s]
    return Collision(weight, context.colliding()) if weight else None


ENTRY = Entry(
    name="collision",
    kind=Collision,
    about="body parts do not go through each other",
    make=_make,
    weights=("collision",),
)
