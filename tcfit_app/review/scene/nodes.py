"""Bodies and images as nodes of viser's scene, which send only what changed.

A script in the page does what viser's meshes cannot: vertex colours, correct transparency, dark placeholders.
"""

import base64
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import viser
from jaxtyping import Float, Float32, Int, UInt8

from tcfit_app.review.browser.channel import page_call
from tcfit_app.review.scene.layers import RGB, BodyLayer, color_index, color_table
from tcfit_app.server.viser_bridge import run_javascript, show_jpeg

_OPAQUE = 0.995
"""Opacity above which a body is drawn as opaque: without blending, and so without seams where it overlaps itself."""
_LINE = 2.0
"""Width of an outline, CSS pixels."""
_ABOVE = 0.003
"""How far an outline is in front of its body, in image heights, so that the body does not hide it."""
_WHITE: RGB = (255, 255, 255)
_GHOST = 0.25
"""Opacity of a ghost."""
Front = bool | Literal["ghost"]


class MeshDressing:
    """Adjusts the mesh nodes of one browser tab, which has a Channel. A node may have just been added.

    Colours: viser's own vertex colours need a GLB file, built and parsed again for each frame; this adds an attribute
        to the existing mesh, with one byte per vertex sent.

    Transparency: a browser blends a mesh's triangles in list order, so that the back of an arm may show through its
        front. The mesh is drawn into the depth buffer first, so that only its nearest surface is visible.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._call("setColorTable", _linear_table())

    def paint(
        self, name: str, indices: UInt8[np.ndarray, "V"] | None, opacities: UInt8[np.ndarray, "V"] | None
    ) -> None:
        """Set the vertex colours of the node's mesh.

        Args:
            name: Of the node.
            indices: Rows of `layers.color_table`, multiplied by the mesh's own colour, so make it white; None: white.
            opacities: 255 for the mesh's own opacity, which must be less than 1 for others to count; None: all 255.
        """
        texts = [None if a is None else base64.b64encode(a.tobytes()).decode() for a in (indices, opacities)]
        self.dress(name, colors=texts if any(texts) else None)

    def dress(self, name: str, **wish: object) -> None:
        """Change how the page draws a node.

        Args:
            name: Of the node.
            wish: `front`: whether a transparent mesh hides its own far side; "ghost": only its own. `nothing`: whether
                a mesh is invisible but hides what is behind it. `last`: lines are drawn after the bodies, which may
                hide them. `dark`: an image is dark, not white, until its first one is decoded. `colors`: see `paint`.
        """
        self._call("dress", name, wish)

    def _call(self, name: str, *values: object) -> None:
        run_javascript(self._client, page_call(name, *values))


def _linear_table() -> list[float]:
    """The colour table as three.js expects vertex colours: linear, 0 to 1, flattened."""
    srgb = color_table().astype(np.float64) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return linear.round(4).ravel().tolist()


class BodyNode:
    """One body in a browser tab. Created when first shown."""

    def __init__(
        self,
        client: viser.ClientHandle,
        name: str,
        dressing: MeshDressing,
        position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self._client, self._name, self._dressing, self._position = client, name, dressing, position
        self._node: viser.MeshHandle | None = None
        self._lines: viser.LineSegmentsHandle | None = None
        self._outlined: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
        """The vertices and opacities of the outline."""
        self._vertices = self._faces = self._values = self._opacities = None
        self._front: Front = False

    def draw(
        self,
        layer: BodyLayer,
        vertices: Float[np.ndarray, "V 3"],
        *,
        solid: bool = False,
        ghost: bool = False,
        lines: bool = False,
    ) -> None:
        """Show the layer with these vertices instead of its own (which are in camera space).

        Args:
            layer: What to draw.
            vertices: World units, compared by identity.
            solid: Opaque, regardless of the layer's opacity.
            ghost: Faint, regardless of the layer's opacity, and over bodies that it must not hide.
            lines: It may be drawn as an outline, because the view is along z.
        """
        if self._node is None or layer.faces is not self._faces:
            self._create(layer, vertices)
        elif vertices is not self._vertices:
            self._node.vertices = vertices
        assert self._node is not None
        self._vertices = vertices
        self._node.color = layer.color if layer.values is None else _WHITE
        outlined = layer.outline and lines
        opacity = _GHOST if ghost else 1.0 if solid else layer.opacity
        transparent = (opacity < _OPAQUE or layer.opacities is not None) and not outlined
        self._node.opacity = min(opacity, _OPAQUE) if transparent else None
        self._node.position = self._position
        self._node.visible = True
        self._paint(layer)
        front: Front = "ghost" if ghost else transparent
        if front != self._front:
            self._front = front
            self._dressing.dress(self._name, front=front)
        self._outline(layer if outlined else None, vertices)

    def hide(self) -> None:
        """Draw nothing, but keep the node for the next time."""
        if self._node is not None:
            self._node.visible = False

    def _create(self, layer: BodyLayer, vertices: Float[np.ndarray, "V 3"]) -> None:
        """A new node for each body model: its faces stay on the client."""
        self._node = self._client.scene.add_mesh_simple(
            self._name,
            vertices,
            np.asarray(layer.faces, np.uint32),
            color=layer.color,
            opacity=layer.opacity,
            side="front",
            cast_shadow=False,
            receive_shadow=False,
        )
        self._faces, self._values, self._opacities, self._front = layer.faces, None, None, False
        self._lines = None  # removed with the previous node

    def _outline(self, layer: BodyLayer | None, vertices: Float[np.ndarray, "V 3"]) -> None:
        """Draw an outline instead of the body, which then only hides the lines behind it; None: no outline."""
        if layer is None:
            if self._lines is not None and self._lines.visible:
                self._lines.visible = False
                self._dressing.dress(self._name, nothing=False)
            return
        before, self._outlined = self._outlined, (vertices, layer.opacities)
        if self._lines is None or any(new is not old for new, old in zip(self._outlined, before, strict=True)):
            points = outline(vertices, layer.faces, layer.opacities) - np.array([0.0, 0.0, _ABOVE], np.float32)
            if self._lines is None:
                self._lines = self._client.scene.add_line_segments(
                    f"{self._name}/outline", points, layer.color, thickness=_LINE, thickness_units="screen"
                )
                self._lines.visible = False
                self._dressing.dress(f"{self._name}/outline", last=True)
            else:
                self._lines.points = points
        self._lines.colors = np.array(layer.color, np.uint8)
        if not self._lines.visible:
            self._lines.visible = True
            self._dressing.dress(self._name, nothing=True)

    def _paint(self, layer: BodyLayer) -> None:
        """Update the vertex colours if they changed."""
        if layer.values is not self._values or layer.opacities is not self._opacities:
            self._values, self._opacities = layer.values, layer.opacities
            indices = None if layer.values is None else color_index(layer.values)
            self._dressing.paint(self._name, indices, layer.opacities)


class ImageNode:
    """One image in a browser tab: y down, seen from -z. Its world size is independent of its pixels."""

    def __init__(self, client: viser.ClientHandle, name: str, dressing: MeshDressing, first: bytes) -> None:
        self._node = client.scene.add_image(
            name, np.zeros((1, 1, 3), np.uint8), 1.0, 1.0, cast_shadow=False, receive_shadow=False
        )
        self._image = b""
        dressing.dress(name, dark=True)
        self.draw(first, (1.0, 1.0))

    def draw(
        self, image: bytes, size: tuple[float, float], position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> None:
        """Show the JPEG in a rectangle of this width and height around the position, in world units."""
        if image != self._image:
            show_jpeg(self._node, image)
            self._image = image
        self._node.render_width, self._node.render_height = size
        self._node.position = position


# --- outlines: the lines where a body's surface turns away from the viewer ---


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
