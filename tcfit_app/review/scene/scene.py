"""All that viser's scene shows in one browser tab: the 2D and the 3D mode, and the viewer's camera in them."""

import numpy as np
import viser

from tcfit_app.review.scene.cameras import Cameras
from tcfit_app.review.scene.layers import RGB
from tcfit_app.review.scene.nodes import MeshDressing
from tcfit_app.review.scene.poses import Rectangle
from tcfit_app.review.scene.poster import PosterNodes, Posters, world_of_pixels
from tcfit_app.review.scene.space import Space, SpaceNodes

Snapshot = Posters | Space

# Directions towards the lights in camera space (x right, y down, z away from the camera), colours, intensities: a key
# light from the upper left of the camera, a weak fill from its right, and a rim from behind.
_LIGHTS: tuple[tuple[str, tuple[float, float, float], RGB, float], ...] = (
    ("key", (-0.5, -0.7, -0.9), (255, 250, 242), 2.5),
    ("fill", (0.9, -0.1, -0.6), (226, 236, 255), 0.55),
    ("rim", (0.3, -0.6, 1.0), (255, 255, 255), 0.9),
)
_AMBIENT = 0.6


class SceneView:
    """Draws snapshots into one browser tab and sends only what differs from the last one.

    One thread at a time may use it. Make it when the client has connected.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        with client.atomic():
            _light(client)
            dressing = MeshDressing(client)
            self._posters, self._space = PosterNodes(client, dressing), SpaceNodes(client, dressing)
        self.cameras = Cameras(client)
        self._last: Snapshot | None = None

    def show(self, snapshot: Snapshot) -> tuple[str, ...]:
        """Shows it, and hides the other mode. Returns what it cannot show, and why, in words for the user."""
        with self._client.atomic():
            if isinstance(snapshot, Posters):
                problems = self._posters.draw(snapshot)
                self.cameras.enter(snapshot.bounds)
            else:
                problems = self._space.draw(snapshot)
                self.cameras.show_space(snapshot.bounds())
            self._posters.set_visible(isinstance(snapshot, Posters))
            self._space.set_visible(isinstance(snapshot, Space))
        self._last = snapshot
        return tuple(problems)

    def zoom_to(self, pixels: Rectangle) -> None:
        """In 2D: a rectangle of image pixels (left, top, right, bottom) of the first poster fills the window."""
        if not isinstance(self._last, Posters):
            return
        corners = np.array(pixels, float).reshape(2, 2)
        world = world_of_pixels(corners, self._last.camera.size, self._last.places[0])
        self.cameras.zoom_to((*world[0].tolist(), *world[1].tolist()))


def _light(client: viser.ClientHandle) -> None:
    """Soft light from the video camera's side, in place of viser's, and y downwards."""
    scene = client.scene
    scene.set_up_direction("-y")
    scene.configure_default_lights(enabled=False, cast_shadow=False)
    scene.configure_environment_map(None)
    scene.add_light_ambient("/light/ambient", intensity=_AMBIENT)
    for name, direction, color, intensity in _LIGHTS:
        scene.add_light_directional(
            f"/light/{name}", color=color, intensity=intensity, cast_shadow=False, position=direction
        )
