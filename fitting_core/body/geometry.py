"""Rotations between directions, mirror images, and nearest points on triangles."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Multiplies positions: swaps the body's left and right."""
MIRROR_ROTATION = np.array([1.0, -1.0, -1.0])
"""Multiplies axis-angle vectors: the same swap for rotations."""
_CANDIDATES = 48  # triangles tried per point: the nearest by their centres


def unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """The same directions with length 1."""
    vectors = np.asarray(vectors, float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def axis_angle(vector: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """Rotation matrices of axis-angle vectors in radians."""
    vector = np.asarray(vector, float)
    return Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix().reshape(*vector.shape[:-1], 3, 3)


def shortest_rotation(source: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation by the smallest angle that turns one direction to another (not to its opposite)."""
    source, target = unit(source), unit(target)
    axis = np.cross(source, target)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return np.eye(3)
    return axis_angle(axis / sine * np.arctan2(sine, source @ target))


def frame(first: Float[np.ndarray, "3"], second: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Right-handed axes as columns: along `first`, and `second` made orthogonal to it."""
    first = unit(first)
    second = unit(second - (second @ first) * first)
    return np.stack([first, second, np.cross(first, second)], axis=1)


def nearest_on_triangles(
    points: Float[np.ndarray, "P 3"], triangles: Float[np.ndarray, "F 3 3"]
) -> tuple[Int[np.ndarray, "P"], Float[np.ndarray, "P 3"]]:
    """The nearest point on a mesh for each point.

    Returns:
        The triangle of each nearest point, and its barycentric coordinates there (not negative, sum 1).
    """
    count = min(_CANDIDATES, len(triangles))
    candidates = np.asarray(KDTree(triangles.mean(1)).query(points, count)[1]).reshape(len(points), count)
    barycentric = _nearest_barycentric(points[:, None], triangles[candidates])
    found = np.einsum("pck,pckd->pcd", barycentric, triangles[candidates])
    best = np.linalg.norm(found - points[:, None], axis=-1).argmin(1)
    rows = np.arange(len(points))
    return candidates[rows, best], barycentric[rows, best]


def _nearest_barycentric(
    points: Float[np.ndarray, "P C 3"], triangles: Float[np.ndarray, "P C 3 3"]
) -> Float[np.ndarray, "P C 3"]:
    """Of each triangle, the point nearest to the given one: inside it, or on its nearest edge."""
    a, b, c = np.moveaxis(triangles, -2, 0)
    normal = np.cross(b - a, c - a)
    area = np.maximum((normal**2).sum(-1), 1e-30)
    u = (np.cross(c - b, points - b) * normal).sum(-1) / area
    v = (np.cross(a - c, points - c) * normal).sum(-1) / area
    options = [np.stack([u, v, 1 - u - v], axis=-1)]
    for i in range(3):
        start, end = triangles[..., i, :], triangles[..., (i + 1) % 3, :]
        along = ((points - start) * (end - start)).sum(-1) / np.maximum(((end - start) ** 2).sum(-1), 1e-30)
        along = np.clip(along, 0, 1)
        edge = np.zeros((*along.shape, 3))
        edge[..., i], edge[..., (i + 1) % 3] = 1 - along, along
        options.append(edge)
    stacked = np.stack(options)
    distance = np.linalg.norm(np.einsum("opck,pckd->opcd", stacked, triangles) - points, axis=-1)
    distance[0] = np.where((options[0] >= 0).all(-1), distance[0], np.inf)
    return np.take_along_axis(stacked, distance.argmin(0)[None, ..., None], axis=0)[0]
