"""All that viser's scene shows in one browser tab: the 2D and the 3D mode, and the viewer's camera in them."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import viser
from jaxtyping import Float

from tcfit_app.review.scene.layers import RGB
from tcfit_app.review.scene.nodes import MeshDressing
from tcfit_app.review.scene.poses import Pose, Rectangle, Window, overview_pose, poster_pose, space_pose, straightened
from tcfit_app.review.scene.poster import PosterNodes, Posters, world_of_pixels
from tcfit_app.review.scene.space import Space, SpaceNodes
from tcfit_app.server.viser_bridge import place_camera

Scene = Rectangle | Literal["space"]
"""What there is to look at: posters, told by their extent in the world, or the 3D scene."""

_SLACK = 0.1
"""Of the camera's distance: so far from where it should be it stays in 3D, rather than move with every frame."""


@dataclass
class _Place:
    """Where the camera is in a scene."""

    pose: Pose
    moved: bool = False
    """By the user, or by a zoom that the user asked for."""
    by_hand: bool = False
    """The browser knows the pose, which the user has changed since."""


class Cameras:
    """Sets the camera of a client, and leaves it alone once the user has moved it.

    That the user moves it comes from the page (`touched`), not from the camera that the browser reports: a busy browser
    goes on reporting an old one for seconds.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client, self._covered = client, 0.0
        self._scene: Scene | None = None
        self._places: dict[Scene, _Place] = {}
        self._bounds = np.array([[-0.5, -0.5, 3.0], [0.5, 0.9, 4.0]])
        self._canvas: tuple[float, float] | None = None
        self._window = self._current_window()

    def enter(self, scene: Scene) -> None:
        """To a scene: where the user was in it, or where all of it is seen. For 3D see `show_space`."""
        if scene == self._scene:
            return
        if self._scene is not None:
            self._places[self._scene] = _Place(self.pose, self.moved)
        self._scene = scene
        place = self._places.get(scene)
        moved = place is not None and place.moved
        self._go(place.pose if place and moved else self._fitted(scene), moved=moved)

    def show_space(self, bounds: Float[np.ndarray, "2 3"] | None) -> None:
        """To 3D, with bodies in that box: where the user was, or where they are seen well, also when the box becomes
        quite another one.
        """
        self._bounds = self._bounds if bounds is None else bounds
        self.enter("space")
        fitted = self._fitted("space")
        if not self.moved and math.dist(self.pose.position, fitted.position) > _SLACK * fitted.distance:
            self._go(fitted)

    def reset(self) -> None:
        """Back to the whole view of the current scene. In 3D, where nothing is left to reset, it takes the video camera
        into view as well, and back again.
        """
        if self._scene is None:
            return
        fitted = self._fitted(self._scene)
        overview = self._scene == "space" and self.pose.close_to(fitted)
        self._go(overview_pose(self._bounds, self._window) if overview else fitted, moved=overview)

    def zoom_to(self, rectangle: Rectangle) -> None:
        """In 2D: a part of the poster world fills the window."""
        if self._scene is not None and self._scene != "space":
            self._go(poster_pose(rectangle, self._scene, self._window), moved=True)

    def touched(self) -> None:
        """The user moves the camera."""
        if self._scene is not None:
            self._places[self._scene].moved = self._places[self._scene].by_hand = True

    def follow(self, canvas: tuple[float, float] | None = None, covered: float | None = None) -> None:
        """Refits the scene to a new window unless the user has moved the camera.

        Args:
            canvas: Width and height in CSS pixels, where the page tells them; else the browser's report is used, which
                counts device pixels.
            covered: CSS pixels at the canvas's bottom over which something else lies, where that changes.
        """
        self._canvas = canvas or self._canvas
        self._covered = self._covered if covered is None else covered
        before, self._window = self._window, self._current_window()
        if self._scene is not None and self._window != before and not self.moved:
            self._go(self._fitted(self._scene))

    @property
    def moved(self) -> bool:
        """Whether the user has left the whole view of the current scene."""
        return self._scene is not None and self._places[self._scene].moved

    @property
    def pose(self) -> Pose:
        """Where the camera is, as far as is known; something must have been shown."""
        assert self._scene is not None
        place = self._places[self._scene]
        if not place.by_hand:
            return place.pose
        seen = self._seen(place.pose)
        return seen if self._scene == "space" else straightened(seen)

    def _seen(self, like: Pose) -> Pose:
        camera = self._client.camera
        return replace(
            like,
            position=tuple(camera.position.tolist()),
            look_at=tuple(camera.look_at.tolist()),
            up=tuple(camera.up_direction.tolist()),
        )

    def _current_window(self) -> Window:
        camera = self._client.camera
        width, height = self._canvas or (camera.image_width, camera.image_height)
        return Window(width=max(width, 1), height=max(height, 1), covered=self._covered)

    def _fitted(self, scene: Scene) -> Pose:
        if scene == "space":
            return space_pose(self._bounds, self._window)
        return poster_pose(scene, scene, self._window)

    def _go(self, pose: Pose, *, moved: bool = False) -> None:
        assert self._scene is not None
        self._places[self._scene] = _Place(pose, moved)
        place_camera(
            self._client,
            fov=pose.fov,
            near=pose.near,
            far=pose.far,
            up=pose.up,
            position=pose.position,
            look_at=pose.look_at,
            least_distance=pose.least_distance,
            most_distance=pose.most_distance,
        )


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
