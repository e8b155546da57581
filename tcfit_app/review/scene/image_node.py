"""A flat image in viser's scene that takes encoded images as they are."""

import numpy as np
import viser

from tcfit_app.review.scene.layers import FrameImage
from tcfit_app.review.scene.mesh_dressing import MeshDressing
from tcfit_app.server.viser_bridge import show_encoded


class ImageNode:
    """One image of any size in a browser tab: y down, seen from -z. The image's own size is nowhere in it."""

    def __init__(self, client: viser.ClientHandle, name: str, dressing: MeshDressing, first: FrameImage) -> None:
        self._node = client.scene.add_image(
            name, np.zeros((1, 1, 3), np.uint8), 1.0, 1.0, cast_shadow=False, receive_shadow=False
        )
        self._image: FrameImage | None = None
        dressing.keep_dark(name)
        self.draw(first, (1.0, 1.0))

    def draw(
        self, image: FrameImage, size: tuple[float, float], position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> None:
        """Shows the image in a rectangle of that width and height around the position, in world units."""
        if image is not self._image:
            show_encoded(self._node, image.data, image.format)
            self._image = image
        self._node.render_width, self._node.render_height = size
        self._node.position = position
