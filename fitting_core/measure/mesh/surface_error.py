"""The vertex-to-surface error of the paper: a rigid alignment by ICP, then distances to the closest points of faces."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.measure.mesh.closest_point import SurfaceTree
from fitting_core.metrics import Similarity

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


def resting(similarity: Similarity, frame: int) -> Similarity:
    """One frame's transformation as one of a single frame."""
    one = slice(frame, frame + 1)
    return replace(
        similarity,
        rotation=similarity.rotation[one],
        translation=similarity.translation[one],
        scale=similarity.scale[one],
    )
