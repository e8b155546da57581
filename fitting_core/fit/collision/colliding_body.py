"""The colliding triangles of a posed body, found again for each pose."""

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.points.chosen_vertices import ChosenVertices
from fitting_core.fit.collision.detection import body_collision_finder
from fitting_core.fit.collision.distance_field import pair_vertices
from fitting_core.fit.variables.estimate import Estimate

LARGEST_EXTENT = 10.0
"""Metres from end to end: anything larger is a diverged step, and would have millions of pairs."""
POSES_AT_ONCE = 8
"""Poses whose vertices are evaluated together: the gathered correctives of 300 vertices are 3.5 MB."""
_REMEMBERED = 1024
"""Minimum number of poses whose pairs are cached; at least as many as were requested at once."""


@dataclass(frozen=True)
class CollidingPairs:
    """The colliding pairs of some frames, held fixed while residuals are differentiated."""

    frame: Int[Tensor, "P"]
    """Of each pair, ascending."""
    rank: Int[Tensor, "P"]
    """The index of each pair among its frame's."""
    ids: Int[Tensor, "B K"]
    """The vertices of each frame's pairs, padded with vertex 0."""
    corner: Int[Tensor, "P 6"]
    """Indices of each pair's vertices among its frame's."""

    @property
    def pairs(self) -> Int[Tensor, "P 2"]:
        """Pairs for `penetration`, indexing the triangles of `faces`."""
        return torch.arange(2 * len(self.frame), device=self.frame.device).view(-1, 2)

    @property
    def faces(self) -> Int[Tensor, "2P 3"]:
        """Corners of the two triangles of each pair, as indices into all frames' vertices, concatenated."""
        return (self.frame[:, None] * self.ids.shape[1] + self.corner).view(-1, 3)


class CollidingBody:
    """Mesh and search trees, constant over a fit, and the pairs of the most recent poses.

    Args:
        body: the model.
        dtype: type of the fit. The mesh is evaluated in it too, so that pairs and residuals use the same vertices;
            float32 would take 9 instead of 12 ms a frame.
        device: where vertices are computed. Pairs are searched on the CPU.
    """

    def __init__(self, body: BodyModel, *, dtype: torch.dtype, device: torch.device | str = "cpu") -> None:
        self.mesh = Mesh(body, dtype=dtype, device=device)
        self.chosen = ChosenVertices(self.mesh)
        self.faces = torch.as_tensor(body.faces.astype(np.int64))
        self.finder = body_collision_finder(body)
        # A solver evaluates the cost of a point and then, if it accepts it, the normal equations at the same point. The
        # key is the pose itself, not the frame, because a batch may hold several poses of a frame.
        self._found: OrderedDict[bytes, Tensor | None] = OrderedDict()
        self._kept = _REMEMBERED

    def pairs(self, e: Estimate) -> list[Int[Tensor, "P 2"] | None]:
        """Colliding triangles of each frame; None where the vertices are not finite or too far apart."""
        poses = torch.cat([e.state.orient.detach().flatten(1), e.state.vector.detach()], 1).cpu().numpy()
        keys = [pose.tobytes() for pose in poses]
        self._kept = max(self._kept, len(keys))
        unknown = list({key: i for i, key in enumerate(keys) if key not in self._found}.values())
        for start in range(0, len(unknown), POSES_AT_ONCE):
            part = unknown[start : start + POSES_AT_ONCE]
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
        return (
            torch.as_tensor(self.finder.find(vertices)) if extent < LARGEST_EXTENT else None
        )  # NaN is not less either

    def contacts(self, pairs: list[Tensor | None]) -> CollidingPairs:
        """The pairs of some frames, with the vertices that they need."""
        known = [torch.zeros(0, 2, dtype=torch.long) if p is None else p for p in pairs]
        ids, corner = zip(*(pair_vertices(self.faces, p).unique(return_inverse=True) for p in known), strict=True)
        counts = torch.tensor([len(p) for p in known])
        device = self.mesh.device
        return CollidingPairs(
            frame=torch.arange(len(known)).repeat_interleave(counts).to(device),
            rank=torch.cat([torch.arange(n) for n in counts.tolist()]).to(device),
            ids=torch.nn.utils.rnn.pad_sequence(list(ids), batch_first=True).to(device),
            corner=torch.cat(corner).view(-1, 6).to(device),
        )
