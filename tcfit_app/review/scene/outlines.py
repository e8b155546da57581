"""Outlines: the lines where a body's surface turns away from the viewer. Arithmetic, no viser."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of a mesh."""

    ends: Int[np.ndarray, "E 2"]
    """Vertices."""
    sides: Int[np.ndarray, "E 2"]
    """The faces on both sides; the same one twice at a border."""


class _ByIdentity:
    """Faces as a key, by identity: one array serves all frames of a body."""

    def __init__(self, faces: Int[np.ndarray, "F 3"]) -> None:
        self.faces = faces

    def __hash__(self) -> int:
        return id(self.faces)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByIdentity) and other.faces is self.faces


def edges_of(faces: Int[np.ndarray, "F 3"]) -> Edges:
    """The edges of a mesh, cached for the most recent bodies."""
    return _edges(_ByIdentity(faces))


@lru_cache(maxsize=4)
def _edges(key: _ByIdentity) -> Edges:
    faces = np.asarray(key.faces)
    half = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    ends, first, which = np.unique(half, axis=0, return_index=True, return_inverse=True)
    last = np.zeros(len(ends), int)
    last[which.reshape(-1)] = np.arange(len(half))  # of several assignments, the last wins
    return Edges(ends=ends, sides=np.stack([first, last], 1) // 3)


def outline(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    opacities: UInt8[np.ndarray, "V"] | None = None,
) -> Float32[np.ndarray, "n 2 3"]:
    """Edges between a front-facing and a back-facing face, of a body viewed along z; hidden ones too, and those at the
    rim of a hole. Lines cannot be transparent, so where vertices are, every second edge is left out."""
    a, b, c = (vertices[faces[:, i], :2] for i in range(3))
    seen = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) > (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    edges = edges_of(faces)
    one, other = seen[edges.sides[:, 0]], seen[edges.sides[:, 1]]
    rim = edges.sides[:, 0] == edges.sides[:, 1]
    ends = edges.ends[(one != other) | rim]
    if opacities is not None:
        unsure = np.flatnonzero((opacities[ends] < 255).any(1))
        ends = np.delete(ends, unsure[1::2], axis=0)
    return np.asarray(vertices[ends], np.float32)
