"""Find the pairs of triangles of a mesh that intersect each other; of a body, those of parts that are no neighbours."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting_core.body.bounding_tree import NO_CHILD, BoundingTree, TriangleBoxes, build_tree, refitted
from fitting_core.body.model import JOINT, JOINTS, N_JOINTS, BodyModel

_FINGERS = ("index", "middle", "ring", "pinky")

_COARSE_PART = {
    "jaw": "head",
    "left_eye": "head",
    "right_eye": "head",
    "left_foot": "left_ankle",
    "right_foot": "right_ankle",
    **{
        f"{side}_{finger}{k}": f"{side}_{finger}1"
        for side in ("left", "right")
        for finger in (*_FINGERS, "thumb")
        for k in (2, 3)
    },
}
"""Joints whose triangles belong to another joint's part: the face to the head, the toes to the foot, fingers are one
part."""

PART_OF_JOINT = np.array([JOINT[_COARSE_PART.get(name, name)] for name in JOINTS])
"""A part's number is the number of its joint nearest the pelvis."""

_TOUCHING_PARTS = (
    # Soft parts that press on each other in everyday poses: thigh on thigh, thigh on belly, armpit.
    ("left_hip", "right_hip"),
    *((f"{side}_hip", "spine1") for side in ("left", "right")),
    *((f"{side}_shoulder", spine) for side in ("left", "right") for spine in ("spine2", "spine3")),
    # Neighbouring fingers touch whenever a hand is closed.
    *((f"{side}_{a}1", f"{side}_{b}1") for side in ("left", "right") for a, b in pairwise(_FINGERS)),
    *((f"{side}_thumb1", f"{side}_index1") for side in ("left", "right")),
)
"""Neighbours beyond parent and child."""


def body_parts(model: BodyModel) -> Int[np.ndarray, "F"]:
    """Part of each triangle: that of the joints with the largest sum of skinning weights over its corners.

    Returns:
        Joint numbers, as in PART_OF_JOINT.
    """
    return parts_of_faces(model.skinning_weights, model.faces)


def parts_of_faces(skinning_weights: Float[np.ndarray, "V 55"], faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "F"]:
    """Part of each triangle of a mesh with SMPL-X's joints.

    Args:
        skinning_weights: Weight of each joint on each vertex.
        faces: Corners of every triangle.
    """
    membership = np.eye(N_JOINTS)[PART_OF_JOINT]
    weights = skinning_weights @ membership
    return weights[faces].sum(axis=1).argmax(axis=1)


def neighbouring_parts(
    parents: Int[np.ndarray, "55"], parts: Int[np.ndarray, "F"], faces: Int[np.ndarray, "F 3"]
) -> Bool[np.ndarray, "55 55"]:
    """Which parts are the same or neighbours, so that their triangles may intersect.

    Neighbours are parent and child; parts that share a vertex of the mesh; thighs with each other and with the belly;
    upper arms with the ribs beside them; fingers beside each other.

    Args:
        parents: Parent of each joint, -1 for the root.
        parts: Part of each triangle.
        faces: Corners of every triangle.

    Returns:
        Symmetric, true on the diagonal.
    """
    neighbours = np.eye(N_JOINTS, dtype=bool)
    child = np.arange(1, N_JOINTS)
    neighbours[PART_OF_JOINT[child], PART_OF_JOINT[parents[child]]] = True
    for a, b in _TOUCHING_PARTS:
        neighbours[JOINT[a], JOINT[b]] = True
    touches = np.zeros((int(faces.max(initial=-1)) + 1, N_JOINTS), dtype=np.float32)
    touches[faces, parts[:, None]] = 1
    neighbours |= touches.T @ touches > 0
    return neighbours | neighbours.T


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


def triangles_intersect(first: Float[np.ndarray, "N 3 3"], second: Float[np.ndarray, "N 3 3"]) -> Bool[np.ndarray, "N"]:
    """Whether each pair of triangles has a common point; one without area has none.

    By separating axes: the normals; in tilted planes the products of two edges, in one plane those of normal and edge.

    Args:
        first: Corners of the first triangle of each pair.
        second: Corners of the second.
    """
    edges = [np.roll(corners, -1, axis=1) - corners for corners in (first, second)]
    normals = np.stack([np.cross(edge[:, 0], edge[:, 1]) for edge in edges], axis=1)
    found = (normals != 0).any(2).all(1) & ~_separated(normals, first, second)
    near = np.flatnonzero(found)
    a, b = (edge[near] for edge in edges)
    axes = [np.cross(a[:, [i]], b) for i in range(3)]
    axes += [np.cross(normals[near, None, i], edge) for i, edge in enumerate((a, b))]
    found[near] = ~_separated(np.concatenate(axes, axis=1), first[near], second[near])
    return found


def _separated(axes: Float[np.ndarray, "N K 3"], first: np.ndarray, second: np.ndarray) -> Bool[np.ndarray, "N"]:
    """Whether one of the axes of each pair has its triangles apart."""
    a, b = (np.einsum("nki,nci->nkc", axes, corners) for corners in (first, second))
    return ((a.max(2) < b.min(2)) | (b.max(2) < a.min(2))).any(1)


@dataclass(frozen=True, kw_only=True, eq=False)
class CollisionFinder:
    """Precomputed tables of a mesh: create it once, then call `find` for every frame."""

    faces: Int[np.ndarray, "F 3"]
    part_pairs: Int[np.ndarray, "R 2"]
    """Pairs of parts whose triangles count as colliding, parts renumbered without gaps; (p, p): within a part."""
    part_vertices: Int[np.ndarray, "M"]
    """Vertices of part 0, then of part 1, ...; one on a border belongs to every part that it touches."""
    part_starts: Int[np.ndarray, "Q"]
    """Where each part starts in `part_vertices`; every part has one."""
    tree: BoundingTree
    """Boxes over the triangles, one tree per part."""
    resting: Int[np.ndarray, "K"]
    """Pairs that intersect in the rest pose and never count, as s F + t, ascending."""

    def find(self, vertices: Float[np.ndarray, "V 3"]) -> Int[np.ndarray, "P 2"]:
        """Pairs (s, t), s < t, of triangles that intersect, in ascending order.

        Triangles that share a vertex never count, nor does a triangle without area. Touching counts.

        Args:
            vertices: Metres; finite.
        """
        assert np.isfinite(vertices).all(), "collisions of vertices that are not finite"
        vertices = np.asarray(vertices, dtype=np.float64)
        pairs = overlapping_triangles(self.tree, vertices, self.faces, self._near_parts(vertices))
        pairs = pairs[~self._share_vertex(pairs)]
        corners = vertices[self.faces[pairs]]
        pairs = pairs[triangles_intersect(corners[:, 0], corners[:, 1])]
        keys = np.sort(self._keys(pairs))
        keys = keys[~np.isin(keys, self.resting, assume_unique=True)]
        return np.stack([keys // len(self.faces), keys % len(self.faces)], axis=1)

    def without_resting(self, vertices: Float[np.ndarray, "V 3"]) -> "CollisionFinder":
        """A finder for which the pairs that intersect in this rest pose, too, do not count.

        Args:
            vertices: The mesh at rest, of any shape.
        """
        return replace(self, resting=np.union1d(self.resting, self._keys(self.find(vertices))))

    def _keys(self, pairs: Int[np.ndarray, "P 2"]) -> Int[np.ndarray, "P"]:
        return pairs[:, 0] * len(self.faces) + pairs[:, 1]

    def _near_parts(self, vertices: Float[np.ndarray, "V 3"]) -> Int[np.ndarray, "R 2"]:
        """The pairs of parts whose bounding boxes overlap: in most poses few."""
        points = vertices[self.part_vertices]
        low, high = np.minimum.reduceat(points, self.part_starts), np.maximum.reduceat(points, self.part_starts)
        a, b = self.part_pairs.T
        return self.part_pairs[((low[a] <= high[b]) & (low[b] <= high[a])).all(axis=1)]

    def _share_vertex(self, pairs: Int[np.ndarray, "P 2"]) -> Bool[np.ndarray, "P"]:
        first, second = self.faces[pairs[:, 0]], self.faces[pairs[:, 1]]
        shared = np.zeros(len(pairs), dtype=bool)
        for i in range(3):
            for j in range(3):
                shared |= first[:, i] == second[:, j]
        return shared


def collision_finder(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    *,
    parts: Int[np.ndarray, "F"] | None = None,
    ignored: Bool[np.ndarray, "Q Q"] | None = None,
) -> CollisionFinder:
    """A finder for any mesh.

    Args:
        vertices: The mesh in a typical pose: it shapes the search tree, and has no influence on what is found.
        faces: Corners of every triangle.
        parts: Part of each triangle, 0 or more; None makes the whole mesh one part.
        ignored: Symmetric: pairs of parts whose triangles may intersect; None ignores none.
    """
    faces = np.asarray(faces, dtype=np.int64)
    parts = np.zeros(len(faces), dtype=np.int64) if parts is None else np.asarray(parts)
    present, groups = np.unique(parts, return_inverse=True)
    counted = np.ones((len(present),) * 2, dtype=bool) if ignored is None else ~ignored[np.ix_(present, present)]
    part_of_vertex, part_vertices = np.divmod(np.unique(groups[:, None] * len(vertices) + faces), max(len(vertices), 1))
    return CollisionFinder(
        faces=faces,
        part_pairs=np.argwhere(np.triu(counted)),
        part_vertices=part_vertices,
        part_starts=np.searchsorted(part_of_vertex, np.arange(len(present))),
        tree=build_tree(np.asarray(vertices, dtype=np.float64)[faces].mean(axis=1), leaf_size=LEAF_SIZE, groups=groups),
        resting=np.zeros(0, dtype=np.int64),
    )


def body_collision_finder(model: BodyModel) -> CollisionFinder:
    """A finder for self-collision of a body.

    Triangles of the same or neighbouring parts do not count, nor do pairs that already intersect in the template.

    Args:
        model: The body.
    """
    parts = body_parts(model)
    ignored = neighbouring_parts(model.parents, parts, model.faces)
    finder = collision_finder(model.template, model.faces, parts=parts, ignored=ignored)
    return finder.without_resting(model.template)
