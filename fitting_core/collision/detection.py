"""Find the pairs of triangles of a mesh that intersect each other."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting_core.body.model import BodyModel
from fitting_core.collision.broad_phase import BoundingTree, build_tree, overlapping_triangles
from fitting_core.collision.intersection import triangles_intersect
from fitting_core.collision.parts import body_parts, neighbouring_parts


@dataclass(frozen=True, kw_only=True, eq=False)
class CollisionFinder:
    """What is known of a mesh before its vertices move: make it once, then call `find` for every frame."""

    faces: Int[np.ndarray, "F 3"]
    part_pairs: Int[np.ndarray, "R 2"]
    """Pairs of parts whose triangles count as colliding; (p, p) for collisions within a part."""
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
        triangles = np.asarray(vertices, dtype=np.float64)[self.faces]
        pairs = overlapping_triangles(self.tree, triangles, self.part_pairs)
        pairs = pairs[~self._share_vertex(pairs)]
        pairs = pairs[triangles_intersect(triangles[pairs[:, 0]], triangles[pairs[:, 1]])]
        keys = np.sort(pairs[:, 0] * len(self.faces) + pairs[:, 1])
        keys = keys[~np.isin(keys, self.resting, assume_unique=True)]
        return np.stack(np.divmod(keys, len(self.faces)), axis=1) if len(keys) else np.zeros((0, 2), dtype=np.int64)

    def without_resting(self, vertices: Float[np.ndarray, "V 3"]) -> "CollisionFinder":
        """A finder for which the pairs that intersect in this rest pose, too, do not count.

        Args:
            vertices: The mesh at rest, of any shape.
        """
        pairs = self.find(vertices)
        keys = pairs[:, 0] * len(self.faces) + pairs[:, 1]
        return replace(self, resting=np.union1d(self.resting, keys))

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
    count = int(parts.max(initial=-1)) + 1
    counted = np.ones((count, count), dtype=bool) if ignored is None else ~ignored[:count, :count]
    return CollisionFinder(
        faces=faces,
        part_pairs=np.argwhere(np.triu(counted)),
        tree=build_tree(vertices[faces].mean(axis=1), groups=parts),
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


def find_collisions(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    *,
    parts: Int[np.ndarray, "F"] | None = None,
    ignored: Bool[np.ndarray, "Q Q"] | None = None,
) -> Int[np.ndarray, "P 2"]:
    """Pairs of intersecting triangles of one mesh; for many poses of it, keep a `collision_finder`.

    Args:
        vertices: Metres; finite.
        faces: Corners of every triangle.
        parts: Part of each triangle, 0 or more; None makes the whole mesh one part.
        ignored: Symmetric: pairs of parts whose triangles may intersect; None ignores none.

    Returns:
        As `CollisionFinder.find`.
    """
    return collision_finder(vertices, faces, parts=parts, ignored=ignored).find(vertices)
