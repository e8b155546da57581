"""Boxes in boxes around the triangles of a mesh: a bounding volume hierarchy.

Its topology is built once, by halving groups of triangles across their longest side; for new vertex positions only the
boxes are refitted, and only those of groups that are asked for.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

NO_CHILD = -1


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundingTree:
    """Topology of a forest of boxes over triangles: one binary tree for each group of triangles.

    Node g is the root of group g.
    """

    order: Int[np.ndarray, "F"]
    """Triangle at each slot; a node holds a run of slots."""
    slot_group: Int[np.ndarray, "F"]
    """Group of each slot's triangle, ascending."""
    node_group: Int[np.ndarray, "N"]
    """Group of each node's triangles."""
    first: Int[np.ndarray, "N"]
    """First slot of each node."""
    last: Int[np.ndarray, "N"]
    """One past the last slot of each node."""
    children: Int[np.ndarray, "N 2"]
    """Nodes below each node; NO_CHILD below a leaf."""
    level_starts: tuple[int, ...]
    """First node of each level, roots first; the nodes of a level are consecutive. Ends with the number of nodes."""
    leaf_size: int
    """Most triangles in a leaf."""
    leaves: Int[np.ndarray, "L"]
    """Leaf nodes by their first slot."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TriangleBoxes:
    """Axis-aligned boxes, closed."""

    low: Float[np.ndarray, "N 3"]
    high: Float[np.ndarray, "N 3"]


def build_tree(
    centers: Float[np.ndarray, "F 3"], *, leaf_size: int, groups: Int[np.ndarray, "F"] | None = None
) -> BoundingTree:
    """Build the forest over triangles with these centres.

    Args:
        centers: Centre of each triangle, in any pose that keeps near triangles near: the rest pose of a body.
        leaf_size: Most triangles in a leaf.
        groups: Group of each triangle: numbers from 0 without gaps. None puts all into group 0.

    Returns:
        One tree per group, of median splits across the longest side.
    """
    groups = np.zeros(len(centers), dtype=np.int64) if groups is None else np.asarray(groups)
    order = np.argsort(groups, kind="stable")
    present, starts, counts = np.unique(groups[order], return_index=True, return_counts=True)
    assert (present == np.arange(len(present))).all(), "groups must be numbered without gaps"
    first, last, children, level_starts = _split_ranges(order, centers, starts, starts + counts, leaf_size)
    leaves = np.flatnonzero(children[:, 0] == NO_CHILD)
    return BoundingTree(
        order=order,
        slot_group=groups[order],
        node_group=groups[order][first],
        first=first,
        last=last,
        children=children,
        level_starts=level_starts,
        leaf_size=leaf_size,
        leaves=leaves[np.argsort(first[leaves])],
    )


def refitted(
    tree: BoundingTree, vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], wanted: Bool[np.ndarray, "G"]
) -> tuple[TriangleBoxes, TriangleBoxes]:
    """Boxes of the triangles, by slot, and of the nodes; those of groups that are not wanted are not filled in."""
    slots = _slot_boxes(tree, vertices, faces, wanted)
    return slots, _node_boxes(tree, slots, wanted)


def _split_ranges(
    order: np.ndarray, centers: np.ndarray, starts: np.ndarray, ends: np.ndarray, leaf_size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[int, ...]]:
    """Halve the ranges of slots, level by level, until each holds at most `leaf_size`; sorts `order` accordingly."""
    ranks = centers.argsort(axis=0).argsort(axis=0)
    firsts, lasts, children, level_starts = [], [], [], [0]
    while len(starts):
        inner = ends - starts > leaf_size
        below = np.full((len(starts), 2), NO_CHILD, dtype=np.int64)
        next_level = level_starts[-1] + len(starts)
        below[inner] = next_level + np.arange(2 * inner.sum()).reshape(-1, 2)
        firsts.append(starts)
        lasts.append(ends)
        children.append(below)
        level_starts.append(next_level)
        starts, ends = starts[inner], ends[inner]
        if len(starts):
            _sort_along_sides(order, centers, ranks, starts, ends)
        middle = (starts + ends) // 2
        starts = np.stack([starts, middle], axis=1).reshape(-1)
        ends = np.stack([middle, ends], axis=1).reshape(-1)
    empty = np.zeros(0, dtype=np.int64)
    nodes = np.concatenate([np.zeros((0, 2), dtype=np.int64), *children])
    return np.concatenate([empty, *firsts]), np.concatenate([empty, *lasts]), nodes, tuple(level_starts)


def _slot_boxes(
    tree: BoundingTree, vertices: np.ndarray, faces: np.ndarray, wanted: Bool[np.ndarray, "G"]
) -> TriangleBoxes:
    """Boxes of the triangles of the wanted groups; the others' are not filled in."""
    slots = np.flatnonzero(wanted[tree.slot_group])
    a, b, c = (vertices[corners] for corners in faces[tree.order[slots]].T)
    low, high = np.empty((len(tree.order), 3)), np.empty((len(tree.order), 3))
    low[slots] = np.minimum(np.minimum(a, b), c)
    high[slots] = np.maximum(np.maximum(a, b), c)
    return TriangleBoxes(low=low, high=high)


def _node_boxes(tree: BoundingTree, slots: TriangleBoxes, wanted: Bool[np.ndarray, "G"]) -> TriangleBoxes:
    """Boxes of the nodes of the wanted groups, around the boxes of their triangles."""
    low, high = np.empty((len(tree.first), 3)), np.empty((len(tree.first), 3))
    leaves = tree.leaves[wanted[tree.node_group[tree.leaves]]]
    first, end = tree.first[leaves], tree.last[leaves]
    low[leaves], high[leaves] = slots.low[first], slots.high[first]
    for step in range(1, tree.leaf_size):
        slot = np.minimum(first + step, end - 1)
        low[leaves] = np.minimum(low[leaves], slots.low[slot])
        high[leaves] = np.maximum(high[leaves], slots.high[slot])
    for start, stop in zip(tree.level_starts[-2::-1], tree.level_starts[:0:-1], strict=True):
        inner = (tree.children[start:stop, 0] != NO_CHILD) & wanted[tree.node_group[start:stop]]
        inner = start + np.flatnonzero(inner)
        left, right = tree.children[inner].T
        low[inner] = np.minimum(low[left], low[right])
        high[inner] = np.maximum(high[left], high[right])
    return TriangleBoxes(low=low, high=high)


def _sort_along_sides(
    order: np.ndarray, centers: np.ndarray, ranks: Int[np.ndarray, "F 3"], starts: np.ndarray, ends: np.ndarray
) -> None:
    """Sort each range of slots along the axis on which its centres reach farthest: all by one key of range and rank."""
    counts = ends - starts
    firsts = counts.cumsum() - counts
    part = np.repeat(np.arange(len(starts)), counts)
    slots = np.arange(len(part)) + (starts - firsts)[part]
    triangles = order[slots]
    points = centers[triangles]
    side = np.maximum.reduceat(points, firsts) - np.minimum.reduceat(points, firsts)
    order[slots] = triangles[np.argsort(part * len(ranks) + ranks[triangles, side.argmax(1)[part]])]
