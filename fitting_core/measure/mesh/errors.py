"""Measures of whole meshes: volumes, the vertex-to-surface error of the paper, the error of each vertex."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from fitting_core.body.mesh import Mesh, shared_mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.measure.mesh.closest_point import SurfaceTree
from fitting_core.metrics import Similarity, similarity


@dataclass(frozen=True, kw_only=True, eq=False)
class Enclosed:
    """Measures one topology. Holes (SMPL-X's files have some at the eyes) are closed by fans around their middle."""

    faces: Int[np.ndarray, "F 3"]
    edges: Int[np.ndarray, "E 2"]
    """Of the holes' rims, in the direction in which a face that closes them has them."""
    hole: Int[np.ndarray, "E"]
    """To which hole each edge belongs, counted from 0."""

    @staticmethod
    def of(faces: Int[np.ndarray, "F 3"]) -> "Enclosed":
        """Any triangles that go round the same way, seen from outside."""
        directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
        count = int(faces.max()) + 1
        there, back = directed @ [count, 1], directed @ [1, count]
        rim = directed[~np.isin(there, back)][:, ::-1]
        links = coo_matrix((np.ones(len(rim)), (rim[:, 0], rim[:, 1])), shape=(count, count))
        _, label = connected_components(links, directed=False)
        _, hole = np.unique(label[rim[:, 0]], return_inverse=True)
        return Enclosed(faces=faces, edges=rim, hole=hole)

    def __call__(self, vertices: Float[np.ndarray, "T V 3"]) -> Float[np.ndarray, "T"]:
        """Volume in dm^3 of each frame (vertices in metres).

        The sum over triangles of the signed volume of the tetrahedron with a point in the middle, by the divergence
        theorem: what lies inside twice, where limbs run into each other, counts twice.
        """
        return np.array([self._volume(frame) for frame in vertices])

    def _volume(self, vertices: Float[np.ndarray, "V 3"]) -> float:
        # Around the middle and in float64: far from the origin large volumes would cancel.
        points = vertices.astype(np.float64) - vertices.mean(0)
        total = _tetrahedra(*points[self.faces.T])
        if len(self.edges):
            one, other = points[self.edges.T]
            middles = np.stack([np.bincount(self.hole, one[:, axis]) for axis in range(3)], 1)
            middles /= np.bincount(self.hole)[:, None]
            total += _tetrahedra(one, other, middles[self.hole])
        return 1e3 * float(total)


def _tetrahedra(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "n 3"], c: Float[np.ndarray, "n 3"]) -> float:
    return float(np.einsum("ni,ni->", a, np.cross(b, c))) / 6


SAMPLE = 1500
"""Vertices that the alignment looks at. With all 13492 the mean error of 12 pairs of bodies was another by 0.5 % on
average and 2.3 % at most: ICP has local minima."""
_ROUNDS = 30
_ENOUGH = 1e-3
"""Share of the mean square by which a round must improve on the one before."""
_FIRST_DAMPING = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fitted:
    """Where the estimate's sampled vertices have got to."""

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    moved: Float[np.ndarray, "n 3"]
    away: Float[np.ndarray, "n 3"]
    """From the closest point of the surface to the vertex."""
    normals: Float[np.ndarray, "n 3"]

    @property
    def cost(self) -> float:
        return float(np.square(self.away).sum(1).mean())


def vertex_to_surface(
    vertices: Float[np.ndarray, "V 3"], surface: SurfaceTree, start: Similarity
) -> Float[np.ndarray, "V"]:
    """Distances in metres from every vertex of a mesh, rigidly aligned, to the closest points on the faces of another.

    Args:
        vertices: The estimate.
        surface: The truth.
        start: A rigid motion (of one frame) that brings the first roughly onto the second, such as by their joints.
    """
    vertices = np.asarray(vertices, np.float64)
    rotation, translation = closest_rigid(vertices[:: max(1, len(vertices) // SAMPLE)], surface, start)
    return surface.closest(vertices @ rotation.T + translation).distance


def closest_rigid(
    points: Float[np.ndarray, "n 3"], surface: SurfaceTree, start: Similarity
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """The rotation and translation at which the mean square distance of points from a surface is least, near a start.

    Iterative closest points (P. Besl, N. McKay, PAMI 14(2), 1992) with Gauss-Newton steps on the distances, whose
    minima are the same: 10 rounds on average over 12 pairs of bodies. After 40 rounds the alternation of matching and
    aligning had ended between 1.5 % below and 6.7 % above their mean squares.
    """
    best = _placed(points, surface, start.rotation[0], start.translation[0])
    damping = _FIRST_DAMPING
    for _ in range(_ROUNDS):
        turn, shift = _step(best, damping)
        tried = _placed(points, surface, turn @ best.rotation, turn @ best.translation + shift)
        if tried.cost > best.cost:
            damping = max(10 * damping, _FIRST_DAMPING)
            if damping > 1e3:
                break
            continue
        done = tried.cost > (1 - _ENOUGH) * best.cost
        best, damping = tried, damping / 10
        if done:
            break
    return best.rotation, best.translation


def _placed(points: np.ndarray, surface: SurfaceTree, rotation: np.ndarray, translation: np.ndarray) -> _Fitted:
    moved = points @ rotation.T + translation
    closest = surface.closest(moved)
    away = moved - closest.point
    a, b, c = np.moveaxis(surface.vertices[surface.faces[closest.face]], 1, 0)
    # On the surface itself the distance has no direction: there the face's normal is the one that it will have.
    normal = np.where(closest.distance[:, None] > 1e-9, away, np.cross(b - a, c - a))
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    return _Fitted(rotation=rotation, translation=translation, moved=moved, away=away, normals=normal)


def _step(at: _Fitted, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """A damped Gauss-Newton step on the distances, as a rotation and the translation after it."""
    middle = at.moved.mean(0)
    jacobian = np.concatenate([np.cross(at.moved - middle, at.normals), at.normals], 1)
    hessian, gradient = jacobian.T @ jacobian, jacobian.T @ np.einsum("ni,ni->n", at.away, at.normals)
    step = -np.linalg.solve(hessian + damping * np.diag(hessian.diagonal()) + 1e-12 * np.eye(6), gradient)
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    return turn, middle + step[3:] - turn @ middle


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
        enclosed, mesh = Enclosed.of(self.body.faces), shared_mesh(self.body)
        parts = (self.params[start : start + _TOGETHER] for start in range(0, len(self.params), _TOGETHER))
        return np.concatenate([np.zeros(0), *(enclosed(mesh(part).numpy()) for part in parts)])


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
        every: Interval of the measured frames, from the first.
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
            distances = vertex_to_surface(one[0][i], tree.moved(other[0][i]), start[i : i + 1])
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
