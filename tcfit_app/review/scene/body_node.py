"""A mesh in viser's scene that sends only what changed, with colours at its vertices where wanted."""

import numpy as np
import viser
from jaxtyping import Float

from tcfit_app.review.scene.layers import RGB, BodyLayer, color_index
from tcfit_app.review.scene.mesh_dressing import MeshDressing

_OPAQUE = 0.995
"""From here on a body is drawn as opaque: without blending, and so without a seam where it lies over itself."""
_WHITE: RGB = (255, 255, 255)


class BodyNode:
    """One body in a browser tab. Nothing is made before it is first shown."""

    def __init__(
        self,
        client: viser.ClientHandle,
        name: str,
        dressing: MeshDressing,
        position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self._client, self._name, self._dressing, self._position = client, name, dressing, position
        self._node: viser.MeshHandle | None = None
        self._vertices = self._faces = self._values = None
        self._limit, self._front = 0.0, False

    def draw(
        self,
        layer: BodyLayer,
        vertices: Float[np.ndarray, "V 3"],
        position: tuple[float, float, float] | None = None,
        *,
        solid: bool = False,
    ) -> None:
        """Shows the layer with these vertices in place of its own (which are in camera space).

        Args:
            layer: What to draw.
            vertices: World units, compared by identity.
            position: Of the node; None leaves it.
            solid: Opaque, whatever the layer's opacity is.
        """
        self._position = position or self._position
        if self._node is None or layer.faces is not self._faces:
            self._create(layer, vertices)
        elif vertices is not self._vertices:
            self._node.vertices = vertices
        assert self._node is not None
        self._vertices = vertices
        self._node.color = layer.color if layer.values is None else _WHITE
        transparent = layer.opacity < _OPAQUE and not solid
        self._node.opacity = layer.opacity if transparent else None
        self._node.wireframe = layer.wireframe
        self._node.position = self._position
        self._node.visible = True
        self._paint(layer)
        self._show_front_only(transparent or layer.wireframe)

    def hide(self) -> None:
        """Draws nothing, and keeps what was there for the next time."""
        if self._node is not None:
            self._node.visible = False

    def _create(self, layer: BodyLayer, vertices: Float[np.ndarray, "V 3"]) -> None:
        """A node of its own for each body model: its faces stay on the client."""
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
        self._faces, self._values, self._front = layer.faces, None, False

    def _paint(self, layer: BodyLayer) -> None:
        """Colours at the vertices, if they changed."""
        if layer.values is self._values and (layer.values is None or layer.limit == self._limit):
            return
        self._values, self._limit = layer.values, layer.limit
        indices = None if layer.values is None else color_index(layer.values, layer.limit)
        self._dressing.paint(self._name, indices)

    def _show_front_only(self, front: bool) -> None:
        if front != self._front:
            self._front = front
            self._dressing.show_front_only(self._name, front)
