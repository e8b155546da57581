"""Pairs of triangles whose bounding boxes overlap, found in a tree of boxes.

The answer is exact for any topology of the tree: it equals that of testing every pair of boxes.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting_core.body.bounding_tree import NO_CHILD, BoundingTree, TriangleBoxes, refitted

LEAF_SIZE = 4
"""Triangles in a leaf. 4 measured fastest on 26,972 triangles; 1 doubles the nodes to refit."""


def overlapping_triangles(
    tree: BoundingTree,
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    group_pairs: Int[np.ndarray, "R 2"],
) -> Int[np.ndarray, "P 2"]:
    """Pairs of triangles of the given pairs of groups whose bounding boxes touch or overlap.

    Args:
        tree: Built over as many triangles.
        vertices: Finite.
        faces: Corners of every triangle.
        group_pairs: Unordered and without repetition; (g, g) asks for the pairs within group g.

    Returns:
        Triangle numbers, the smaller first, every pair once, in no particular order.
    """
    wanted = np.zeros(len(tree.first), dtype=bool)
    wanted[group_pairs] = True
    slots, nodes = refitted(tree, vertices, faces, wanted)
    slot_pairs = _slot_pairs(tree, _overlapping_leaves(tree, nodes, group_pairs))
    slot_pairs = slot_pairs[_overlap(slots, slot_pairs)]
    return np.sort(tree.order[slot_pairs], axis=1)


def _overlap(boxes: TriangleBoxes, pairs: Int[np.ndarray, "P 2"]) -> Bool[np.ndarray, "P"]:
    a, b = pairs.T
    apart = (boxes.low[a] > boxes.high[b]) | (boxes.low[b] > boxes.high[a])
    return ~(apart[:, 0] | apart[:, 1] | apart[:, 2])


def _overlapping_leaves(
    tree: BoundingTree, nodes: TriangleBoxes, pairs: Int[np.ndarray, "R 2"]
) -> Int[np.ndarray, "M 2"]:
    """Descend from pairs of roots to all pairs of leaves whose boxes overlap, breadth first."""
    found = [np.zeros((0, 2), dtype=np.int64)]
    while len(pairs):
        pairs = pairs[_overlap(nodes, pairs)]
        at_leaves = (tree.children[pairs, 0] == NO_CHILD).all(axis=1)
        found.append(pairs[at_leaves])
        pairs = _children_of_pairs(tree, pairs[~at_leaves])
    return np.concatenate(found)


def _children_of_pairs(tree: BoundingTree, pairs: Int[np.ndarray, "M 2"]) -> Int[np.ndarray, "K 2"]:
    """Replace the node of more triangles by its children; a node paired with itself by its children's three pairs."""
    alone = pairs[:, 0] == pairs[:, 1]
    left, right = tree.children[pairs[alone, 0]].T
    within = [np.stack(pair, axis=1) for pair in ((left, left), (right, right), (left, right))]
    pairs = pairs[~alone]
    sizes = (tree.last - tree.first)[pairs]
    swap = sizes[:, 0] < sizes[:, 1]
    larger, smaller = np.where(swap[:, None], pairs[:, ::-1], pairs).T
    across = [np.stack([tree.children[larger, side], smaller], axis=1) for side in (0, 1)]
    return np.concatenate(within + across)


def _slot_pairs(tree: BoundingTree, leaf_pairs: Int[np.ndarray, "M 2"]) -> Int[np.ndarray, "K 2"]:
    """All pairs of slots of the pairs of leaves; each once where a leaf is paired with itself."""
    row, column = (grid.reshape(-1) for grid in np.indices((tree.leaf_size, tree.leaf_size)))
    a = tree.first[leaf_pairs[:, :1]] + row
    b = tree.first[leaf_pairs[:, 1:]] + column
    valid = (a < tree.last[leaf_pairs[:, :1]]) & (b < tree.last[leaf_pairs[:, 1:]])
    valid &= (leaf_pairs[:, :1] != leaf_pairs[:, 1:]) | (row < column)
    return np.stack([a[valid], b[valid]], axis=1)
