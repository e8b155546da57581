"""The viewer's camera in one browser tab: fits posters into the window, and remembers where the user went."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import viser
from jaxtyping import Float

from tcfit_app.review.scene.poses import Pose, Rectangle, Window, overview_pose, poster_pose, space_pose, straightened
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
        window = self._current_window()
        if self._scene is not None and window != self._window:
            self._window = window
            if not self.moved:
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
