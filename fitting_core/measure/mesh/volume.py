"""The volume that a body's mesh encloses."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


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
