"""Do two triangles intersect? Exact, vectorised.

Every decision is the sign of an orientation determinant. It is computed in float64 with an error bound (Shewchuk,
"Adaptive precision floating-point arithmetic and fast robust geometric predicates", 1997, stage A), and again in
rational arithmetic in the few cases that the bound leaves open. So no epsilon is chosen and no crossing is missed.
"""

from fractions import Fraction

import numpy as np
from jaxtyping import Bool, Float, Int

_ROUNDOFF = 2.0**-53
_ERROR_FACTOR = (7 + 56 * _ROUNDOFF) * _ROUNDOFF
_UNDERFLOW = 1e-290
"""Below this, products may have lost digits to underflow, and the relative error bound does not hold."""

_EDGES = ((0, 1), (1, 2), (2, 0))


def triangles_intersect(first: Float[np.ndarray, "N 3 3"], second: Float[np.ndarray, "N 3 3"]) -> Bool[np.ndarray, "N"]:
    """Whether each pair of triangles has a common point.

    Triangles are closed: touching counts. Coplanar ones intersect if they overlap or touch within their plane. A
    triangle without area intersects nothing: it has no inside to intrude on.

    Args:
        first: Corners of the first triangle of each pair; finite.
        second: Corners of the second.
    """
    result = np.zeros(len(first), dtype=bool)
    sides_of_first = _sides(first, second)
    open_pairs = np.flatnonzero(_meets_plane(sides_of_first))
    first, second, sides_of_first = first[open_pairs], second[open_pairs], sides_of_first[open_pairs]
    sides_of_second = _sides(second, first)
    kept = _meets_plane(sides_of_second)
    open_pairs, first, second = open_pairs[kept], first[kept], second[kept]
    sides_of_first, sides_of_second = sides_of_first[kept], sides_of_second[kept]

    flat = (sides_of_first == 0).all(axis=1) | (sides_of_second == 0).all(axis=1)
    result[open_pairs[flat]] = [_coplanar_intersect(a, b) for a, b in zip(first[flat], second[flat], strict=True)]
    tilted = ~flat
    crossing = _edges_cross(first[tilted], second[tilted], sides_of_first[tilted])
    crossing |= _edges_cross(second[tilted], first[tilted], sides_of_second[tilted])
    result[open_pairs[tilted]] = crossing
    return result


def orientation(
    a: Float[np.ndarray, "N 3"], b: Float[np.ndarray, "N 3"], c: Float[np.ndarray, "N 3"], d: Float[np.ndarray, "N 3"]
) -> Int[np.ndarray, "N"]:
    """Exact sign of (b - a) x (c - a) . (d - a): 1 where d lies above the plane of a, b, c seen counterclockwise.

    Args:
        a: Points; finite, like the others.
        b: Points.
        c: Points.
        d: Points.
    """
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        determinant, magnitude = _determinant(b - a, c - a, d - a)
        certain = np.abs(determinant) > _ERROR_FACTOR * magnitude + _UNDERFLOW
    signs = np.zeros(len(a), dtype=np.int8)
    signs[certain] = np.sign(determinant[certain])
    unsure = np.flatnonzero(~certain)
    if len(unsure):
        a, b, c, d = (_rational(points[unsure]) for points in (a, b, c, d))
        exact, _ = _determinant(b - a, c - a, d - a)
        signs[unsure] = np.sign(exact).astype(np.int8)
    return signs


def _rational(numbers: np.ndarray) -> np.ndarray:
    """The same numbers as fractions: floats are fractions, so nothing is lost."""
    return np.array([Fraction(x) for x in numbers.reshape(-1).tolist()], dtype=object).reshape(numbers.shape)


def _determinant(u: np.ndarray, v: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Determinant of rows u, v, w, and the sum of the absolute values of its six products."""
    determinant, magnitude = 0, 0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        plus, minus = u[:, i] * v[:, j], u[:, j] * v[:, i]
        determinant = determinant + (plus - minus) * w[:, k]
        magnitude = magnitude + (np.abs(plus) + np.abs(minus)) * np.abs(w[:, k])
    return np.asarray(determinant), np.asarray(magnitude)


def _sides(triangles: np.ndarray, others: np.ndarray) -> Int[np.ndarray, "N 3"]:
    """On which side of each triangle's plane the other's corners lie."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return np.stack([orientation(a, b, c, others[:, k]) for k in range(3)], axis=1)


def _meets_plane(sides: Int[np.ndarray, "N 3"]) -> Bool[np.ndarray, "N"]:
    return (sides.min(axis=1) <= 0) & (sides.max(axis=1) >= 0)


def _edges_cross(triangles: np.ndarray, others: np.ndarray, sides: np.ndarray) -> Bool[np.ndarray, "N"]:
    """Whether an edge of the other triangle that does not lie in the triangle's plane meets the triangle.

    Edges within the plane need no test. The triangles are not coplanar, so where such an edge meets the triangle,
    either one of its ends does, and belongs to an edge that leaves the plane, or the triangle's edge meets the other.
    """
    crossing = np.zeros(len(triangles), dtype=bool)
    for i, j in _EDGES:
        meets = np.flatnonzero((sides[:, i] * sides[:, j] <= 0) & (sides[:, i] != sides[:, j]) & ~crossing)
        start, end, corners = others[meets, i], others[meets, j], triangles[meets]
        turns = [orientation(start, end, corners[:, k], corners[:, m]) for k, m in _EDGES]
        turns = np.stack(turns, axis=1)
        crossing[meets] = (turns >= 0).all(axis=1) | (turns <= 0).all(axis=1)
    return crossing


def _coplanar_intersect(first: Float[np.ndarray, "3 3"], second: Float[np.ndarray, "3 3"]) -> bool:
    """Two triangles in one plane: projected along an axis, then separating edges, in rational arithmetic."""
    a, b = _rational(first), _rational(second)
    for axes in ((0, 1), (1, 2), (2, 0)):
        flat_a, flat_b = a[:, axes], b[:, axes]
        turn_a, turn_b = _turn(*flat_a), _turn(*flat_b)
        if turn_a and turn_b:
            return not (_edge_separates(flat_a, flat_b, turn_a) or _edge_separates(flat_b, flat_a, turn_b))
    return False


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> Fraction:
    """Twice the signed area of a triangle in the plane."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _edge_separates(triangle: np.ndarray, other: np.ndarray, turn: Fraction) -> bool:
    """Whether the other triangle lies wholly and strictly outside one edge of the triangle."""
    return any(all(_turn(triangle[i], triangle[j], corner) * turn < 0 for corner in other) for i, j in _EDGES)
