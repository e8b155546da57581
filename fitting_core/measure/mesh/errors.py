"""What is measured on whole meshes: volumes, the vertex-to-surface error, the error of every vertex."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fitting_core.body.mesh import Mesh, shared_mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.measure.mesh.closest_point import SurfaceTree
from fitting_core.measure.mesh.surface_error import resting, vertex_to_surface
from fitting_core.measure.mesh.volume import Enclosed
from fitting_core.metrics import similarity

_TOGETHER = 16
"""Frames whose meshes are in memory at once."""
_BODY = slice(0, JOINT["right_wrist"] + 1)
"""Joints by which bodies are laid onto each other before their surfaces are."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedBody:
    """A body over T frames."""

    body: BodyModel
    params: BodyParams

    def volumes(self) -> Float[np.ndarray, "T"]:
        """Volume of the closed mesh of each frame, dm^3."""
        enclosed, mesh = Enclosed.of(self.body), shared_mesh(self.body)
        parts = _parts(len(self.params))
        return np.concatenate([np.zeros(0), *(enclosed(mesh(self.params[part]).numpy()) for part in parts)])


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshErrors:
    """Errors of T frames; NaN in frames that were left out."""

    vertex_to_surface: Float[np.ndarray, "T"]
    """Mean over the vertices after rigid alignment, metres."""
    per_vertex: Float[np.ndarray, "T"] | None
    """Mean distance of the same vertex with the pelvises at one place, metres; None where the topologies differ."""


def mesh_errors(
    estimate: PosedBody, truth: PosedBody, *, every: int = 1, done: Callable[[int], object] | None = None
) -> MeshErrors:
    """How far a body's surface lies from another one's.

    Args:
        estimate: T frames.
        truth: The same T frames; its body may be another one.
        every: Measure the first frame and every so many frames after it.
        done: Called with the number of frames that have just been measured.
    """
    frames = np.arange(0, len(estimate.params), every)
    same = np.array_equal(estimate.body.faces, truth.body.faces)
    surface, vertex = np.full((2, len(estimate.params)), np.nan)
    ours, theirs = shared_mesh(estimate.body), shared_mesh(truth.body)
    tree = SurfaceTree.of(truth.body.template, truth.body.faces)
    for part in np.split(frames, range(_TOGETHER, len(frames), _TOGETHER)):
        one, other = _posed(ours, estimate.params, part), _posed(theirs, truth.params, part)
        start = similarity(one[1][:, _BODY], other[1][:, _BODY], scaled=False)
        for i, frame in enumerate(part):
            distances = vertex_to_surface(one[0][i], tree.moved(other[0][i]), resting(start, i))
            surface[frame] = distances.mean()
        if same:
            rooted = [vertices - joints[:, [JOINT["pelvis"]]] for vertices, joints in (one, other)]
            vertex[part] = np.linalg.norm(rooted[0] - rooted[1], axis=-1).mean(1)
        if done is not None:
            done(len(part))
    return MeshErrors(vertex_to_surface=surface, per_vertex=vertex if same else None)


def _posed(
    mesh: Mesh, params: BodyParams, frames: Int[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n V 3"], Float[np.ndarray, "n 55 3"]]:
    some = params[frames.tolist()]
    return mesh(some).numpy().astype(np.float64), mesh.joints(some).numpy().astype(np.float64)


def _parts(count: int) -> list[slice]:
    return [slice(first, first + _TOGETHER) for first in range(0, count, _TOGETHER)]
