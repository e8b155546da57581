"""What viser's meshes cannot do, by a script in the page: colours at vertices, clean transparency, dark plates."""

import base64

import numpy as np
import viser
from jaxtyping import UInt8

from tcfit_app.review.browser.channel import page_call
from tcfit_app.review.scene.layers import color_table
from tcfit_app.server.viser_bridge import run_javascript


class MeshDressing:
    """Dresses the mesh nodes of one browser tab, which has a Channel. A node may have been added just before.

    Colours: viser's own way to colours at vertices is a GLB file, built and parsed anew for each frame; this adds an
    attribute to the mesh that is there, with one byte for each vertex on the wire.

    Transparency: a browser blends a mesh's triangles in the order in which they are listed, so that the back of an arm
    may shine through its front. Drawn into the depth buffer first, the mesh lets only its nearest surface through.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._call("setColorTable", _linear_table())

    def paint(self, name: str, indices: UInt8[np.ndarray, "V"] | None) -> None:
        """Gives the node's mesh colours, lines of `layers.color_table` by vertex; None takes them away.

        The mesh's own colour multiplies them: make it white.
        """
        colors = None if indices is None else base64.b64encode(indices.tobytes()).decode()
        self._dress(name, colors=colors)

    def show_front_only(self, name: str, front: bool) -> None:
        """Whether the node's mesh hides its own far side although it is transparent, or a wireframe."""
        self._dress(name, front=front)

    def keep_dark(self, name: str) -> None:
        """Draws an image node dark, and not white, until the browser has decoded its first image."""
        self._dress(name, dark=True)

    def _dress(self, name: str, **wish: object) -> None:
        self._call("dress", name, wish)

    def _call(self, name: str, *values: object) -> None:
        run_javascript(self._client, page_call(name, *values))


def _linear_table() -> list[float]:
    """The colour table as three.js wants colours at vertices: linear, 0 to 1, flattened."""
    srgb = color_table().astype(np.float64) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return linear.round(4).ravel().tolist()
