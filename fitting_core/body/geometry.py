"""Sides, rotations between directions, mirror images, and the normals of a mesh."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Multiplies positions: swaps the body's left and right."""
MIRROR_ROTATION = np.array([1.0, -1.0, -1.0])
"""Multiplies axis-angle vectors: the same swap for rotations."""


def unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """The same directions with length 1."""
    vectors = np.asarray(vectors, float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def axis_angle(vector: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """Rotation matrices of axis-angle vectors in radians."""
    vector = np.asarray(vector, float)
    return Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix().reshape(*vector.shape[:-1], 3, 3)


def shortest_rotation(
    source: Float[np.ndarray, "*n 3"], target: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n 3 3"]:
    """The rotations by the smallest angle from directions to others.

    To the opposite direction that is half a turn about any axis across; none where a vector has no length.
    """
    source, target = (v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12) for v in (source, target))
    axis = np.cross(source, target)
    sine, cosine = np.linalg.norm(axis, axis=-1, keepdims=True), (source * target).sum(-1, keepdims=True)
    across = np.cross(source, np.where(abs(source[..., :1]) < 0.6, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    axis = np.where((sine < 1e-9) & (cosine < 0), across, axis)
    axis = axis / np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-12)
    return axis_angle(np.arctan2(sine, cosine) * axis)


def twist(rotations: Rotation, axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n"]:
    """Angles (radians, -pi to pi) by which rotations turn about a unit axis: swing-twist decomposition."""
    q = rotations.as_quat()
    angle = 2 * np.arctan2(q[:, :3] @ axis, q[:, 3])
    return (angle + np.pi) % (2 * np.pi) - np.pi


def frame(first: Float[np.ndarray, "*n 3"], second: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """Right-handed axes as columns: along `first`, and `second` made orthogonal to it."""
    first = unit(first)
    second = unit(second - (second * first).sum(-1, keepdims=True) * first)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def vertex_normals(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Float[np.ndarray, "V 3"]:
    """Unit normals of the vertices, the mean over their faces, weighted by area; 0 for a vertex of no face."""
    a, b, c = (vertices[corner] for corner in faces.T)
    normals = np.cross(b - a, c - a)
    sums = [np.bincount(faces.reshape(-1), np.repeat(normals[:, axis], 3), len(vertices)) for axis in range(3)]
    total = np.stack(sums, 1)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-20)
