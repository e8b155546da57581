"""The collision term of E_o: the intrusion penalty of the body's triangles that collide with each other."""

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.points.chosen_vertices import ChosenVertices, PosedVertices, Pulls
from fitting_core.fit.terms.collision.detection import body_collision_finder
from fitting_core.fit.terms.collision.distance_field import SIGMA, pair_vertices, penetration, residuals_with_jacobian
from fitting_core.fit.terms.term import Derivative, Rows, Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.point_jacobian import PointJacobian

LARGEST = 10.0
"""Metres from end to end: what is larger is no body but a step gone wild, and its pairs would be millions."""
SOFT_SIGMA = 1e-3
"""Metres, cone height of the softened term, which Levenberg-Marquardt minimises first.

Mean objective of phase 1 on 10 frames of real footage, three of them with an arm in the torso, hands and thighs, or
ankles: 316 without, 276 with 1e-2, 224 with 3e-3, 199 with 1e-3, where all are free. L-BFGS on the faithful term: 213.
"""
_CHUNK = 8
"""Poses whose vertices are evaluated together: the gathered correctives of 300 vertices are 3.5 MB."""
_REMEMBERED = 1024
"""Poses whose pairs are kept at least; as many as were asked for at once, if that is more."""


@dataclass(frozen=True)
class Contacts:
    """The colliding pairs of some frames, held fixed while residuals are differentiated."""

    frame: Int[Tensor, "P"]
    """Of each pair, ascending."""
    rank: Int[Tensor, "P"]
    """Which of its frame's pairs it is."""
    ids: Int[Tensor, "B K"]
    """The vertices of each frame's pairs; vertex 0 fills up."""
    corner: Int[Tensor, "P 6"]
    """Places of each pair's vertices among its frame's."""

    @property
    def pairs(self) -> Int[Tensor, "P 2"]:
        """Pairs as `penetration` wants them, for the triangles of `faces`."""
        return torch.arange(2 * len(self.frame), device=self.frame.device).view(-1, 2)

    @property
    def faces(self) -> Int[Tensor, "2P 3"]:
        """Corners of the two triangles of each pair, as places among all frames' vertices, one after another."""
        return (self.frame[:, None] * self.ids.shape[1] + self.corner).view(-1, 3)


class CollidingBody:
    """What is constant over a fit: mesh and search trees; and the pairs of the poses seen last.

    Args:
        body: the model.
        dtype: type of the fit. The mesh is evaluated in it as well, so that pairs and residuals see the same vertices;
            float32 would take 9 instead of 12 ms a frame.
        device: where vertices are computed. Pairs are searched on the CPU.
    """

    def __init__(self, body: BodyModel, *, dtype: torch.dtype, device: torch.device | str = "cpu") -> None:
        self.mesh = Mesh(body, dtype=dtype, device=device)
        self.chosen = ChosenVertices(self.mesh)
        self.faces = torch.as_tensor(body.faces.astype(np.int64))
        self.finder = body_collision_finder(body)
        # A solver evaluates the cost of a point and then, if it takes it, the normal equations at the same point.
        # Kept by the pose itself and not by the frame, of which a batch may hold several poses.
        self._found: OrderedDict[bytes, Tensor | None] = OrderedDict()
        self._kept = _REMEMBERED

    def pairs(self, e: Estimate) -> list[Int[Tensor, "P 2"] | None]:
        """Colliding triangles of each frame; None where the vertices are not finite or too far apart."""
        poses = torch.cat([e.state.orient.detach().flatten(1), e.state.vector.detach()], 1).cpu().numpy()
        keys = [pose.tobytes() for pose in poses]
        self._kept = max(self._kept, len(keys))
        unknown = list({key: i for i, key in enumerate(keys) if key not in self._found}.values())
        for start in range(0, len(unknown), _CHUNK):
            part = unknown[start : start + _CHUNK]
            for i, vertices in zip(part, self._vertices(e, part), strict=True):
                self._found[keys[i]] = self._find(vertices)
        for key in keys:
            self._found.move_to_end(key)
        while len(self._found) > self._kept:
            self._found.popitem(last=False)
        return [self._found[key] for key in keys]

    @torch.no_grad()
    def _vertices(self, e: Estimate, rows: list[int]) -> Float[np.ndarray, "n V 3"]:
        p, state = e.view.parametrisation, e.state[torch.tensor(rows, device=self.mesh.device)]
        local = torch.cat([state.orient[:, None], rotations.exp(p.pose(state, p.body_pose(state)))], 1)
        return self.mesh.vertices(local, p.coefficients(state)).cpu().numpy()

    def _find(self, vertices: Float[np.ndarray, "V 3"]) -> Tensor | None:
        extent = np.ptp(vertices, axis=0).max()
        return torch.as_tensor(self.finder.find(vertices)) if extent < LARGEST else None  # NaN is not less either

    def contacts(self, pairs: list[Tensor | None]) -> Contacts:
        """The pairs of some frames, with the vertices that they need."""
        known = [torch.zeros(0, 2, dtype=torch.long) if p is None else p for p in pairs]
        ids, corner = zip(*(pair_vertices(self.faces, p).unique(return_inverse=True) for p in known), strict=True)
        counts = torch.tensor([len(p) for p in known])
        device = self.mesh.device
        return Contacts(
            frame=torch.arange(len(known)).repeat_interleave(counts).to(device),
            rank=torch.cat([torch.arange(n) for n in counts.tolist()]).to(device),
            ids=torch.nn.utils.rnn.pad_sequence(list(ids), batch_first=True).to(device),
            corner=torch.cat(corner).view(-1, 6).to(device),
        )


@dataclass(frozen=True)
class Collision(Term):
    """weight x the conical distance field of colliding triangles at each other's corners (METHOD, E_C).

    Costs about 25-40 ms per frame and point on one core (mesh 12, search 10-28), where all other terms take 1 ms.
    Pairs are found anew at every point and held fixed for its derivatives, so that the cost jumps where triangles begin
    to touch. A frame whose vertices are no body at all has an infinite residual.
    """

    weight: float
    body: CollidingBody
    sigma: float = SIGMA
    """Metres, the height of the cones above the surface."""
    name: str = "collision"
    derivative: ClassVar = Derivative.ROWS

    def softened(self, *, cold: bool) -> "Collision":
        """With higher cones: at the faithful height a slope of 1e4 per metre at the surface stops every step."""
        return replace(self, sigma=max(self.sigma, SOFT_SIGMA))

    def residual(self, e: Estimate) -> Float[Tensor, "B n"]:
        """Six residuals for each pair, zeros after a frame's last pair."""
        pairs = self.body.pairs(e)
        most = max((len(p) for p in pairs if p is not None), default=0)
        out = [self._padded(contacts, posed, most) for contacts, posed in self._chunks(e, pairs)]
        residual = torch.cat(out).flatten(1)
        lost = [p is None for p in pairs]
        if any(lost):
            column = torch.where(torch.tensor(lost, device=residual.device), torch.inf, 0.0).to(residual)
            residual = torch.cat([residual, column[:, None]], 1)
        return residual

    def _chunks(self, e: Estimate, pairs: list[Tensor | None]) -> Iterator[tuple[Contacts, PosedVertices]]:
        p = e.view.parametrisation
        pose, coefficients = p.pose(e.state, e.body_pose), p.coefficients(e.state)
        for start in range(0, len(pairs), _CHUNK):
            i = slice(start, start + _CHUNK)
            contacts = self.body.contacts(pairs[i])
            yield contacts, self.body.chosen.forward(e.state.orient[i], pose[i], coefficients[i], contacts.ids)

    def _padded(self, contacts: Contacts, posed: PosedVertices, most: int) -> Float[Tensor, "B P 6"]:
        psi = penetration(posed.vertices.flatten(0, 1), contacts.faces, contacts.pairs, sigma=self.sigma)
        out = psi.new_zeros(len(contacts.ids), most, 6)
        return out.index_put((contacts.frame, contacts.rank), self.weight * psi)

    def rows(self, e: Estimate, jacobian: PointJacobian) -> Rows:
        """Only corners inside a cone: elsewhere the residual is zero with zero slope."""
        parts = [self._rows(contacts, posed, jacobian) for contacts, posed in self._chunks(e, self.body.pairs(e))]
        most = max(p.residual.shape[1] for p in parts)

        def padded(rows: Tensor) -> Tensor:
            return torch.cat([rows, rows.new_zeros(len(rows), most - rows.shape[1], *rows.shape[2:])], 1)

        extra = [p.extra_gradient for p in parts if p.extra_gradient is not None]
        return Rows(
            torch.cat([padded(p.residual) for p in parts]),
            torch.cat([padded(p.jacobian) for p in parts]),
            torch.cat(extra),
        )

    def _rows(self, contacts: Contacts, posed: PosedVertices, jacobian: PointJacobian) -> Rows:
        flat = posed.vertices.flatten(0, 1)
        psi, by_corner = residuals_with_jacobian(flat, contacts.faces, contacts.pairs, sigma=self.sigma)
        pair, which = (psi > 0).nonzero(as_tuple=True)
        frame, residual = contacts.frame[pair], self.weight * psi[pair, which]
        pulls = Pulls(frame, contacts.corner[pair], self.weight * by_corner[pair, which])
        chosen = self.body.chosen
        rows = jacobian.in_free_columns(
            chosen.by_joint(posed, pulls), chosen.by_coefficient(posed, pulls) if jacobian.needs_coefficients else None
        )
        pull = torch.zeros_like(flat)
        place = (frame[:, None] * posed.ids.shape[1] + pulls.chosen).flatten()
        pull.index_add_(0, place, (residual[:, None, None] * pulls.left).flatten(0, 1))
        through = chosen.by_correctives(posed, pull.view_as(posed.vertices))
        frames, rank, most = len(posed.ids), *_ranks(frame)
        return Rows(
            residual.new_zeros(frames, most).index_put((frame, rank), residual),
            rows.new_zeros(frames, most, rows.shape[1]).index_put((frame, rank), rows),
            jacobian.in_free_columns(through),
        )


def _ranks(frame: Int[Tensor, "R"]) -> tuple[Int[Tensor, "R"], int]:
    """Which row of its frame each row is (frames ascend), and the largest count."""
    if not len(frame):
        return frame, 0
    counts = frame.bincount()
    first = counts.cumsum(0) - counts
    return torch.arange(len(frame), device=frame.device) - first[frame], int(counts.max())
