"""viser's scene in one browser tab: the 2D and the 3D mode, and the viewer's camera in them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import viser
from jaxtyping import Float

from tcfit_app.review.scene.layers import RGB
from tcfit_app.review.scene.nodes import MeshDressing
from tcfit_app.review.scene.poses import (
    Pose,
    Rectangle,
    Window,
    clear_pose,
    nearer_pose,
    poster_pose,
    space_pose,
    straightened,
)
from tcfit_app.review.scene.poster import PosterNodes, Posters, world_of_pixels
from tcfit_app.review.scene.space import Space, SpaceNodes
from tcfit_app.review.scene.windows import Division
from tcfit_app.server.viser_bridge import place_camera

Scene = Literal["posters", "space"]
"""The scenes."""

_SLACK = 0.1
"""Tolerance relative to the camera's distance: within it the 3D view stays put, rather than move with every frame."""


@dataclass
class _Place:
    """The camera's pose in a scene."""

    pose: Pose
    moved: bool = False
    """Moved by the user, or by a zoom that the user requested."""
    by_hand: bool = False
    """The browser has a newer pose, because the user moved the camera since."""
    part: Rectangle | None = None
    """The part of the picture that was zoomed to, if the user has not moved the camera since."""


class Cameras:
    """Sets a client's camera, and leaves it alone once the user has moved it.

    The page reports that the user moves it (`touched`); viser's reported camera is no sign of that, because a busy
    browser reports an old one for seconds.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._scene: Scene | None = None
        self._places: dict[Scene, _Place] = {}
        self._bounds = np.array([[-0.5, -0.5, 3.0], [0.5, 0.9, 4.0]])
        self._canvas: tuple[float, float] | None = None
        self._window = self._current_window()
        self._division: Division | None = None

    def _enter(self, scene: Scene) -> None:
        """Go to a scene: to the user's last pose in it, or to the whole view."""
        if scene == self._scene:
            return
        if self._scene is not None:
            self._places[self._scene] = replace(self._places[self._scene], pose=self.pose, by_hand=False)
        self._scene = scene
        place = self._places.get(scene)
        if place is not None and place.moved:
            self._go(place.pose, moved=True, part=place.part)
        else:
            self._go(self._fitted(scene))

    def show_posters(self, division: Division) -> None:
        """Go to posters in these windows: to the user's last pose, to what was zoomed to, or to the whole picture."""
        other = division != self._division
        self._division = division
        self._enter("posters")
        if other and (part := self._places["posters"].part):
            self.zoom_to(part)
        if not self.moved and self.pose != (fitted := self._fitted("posters")):
            self._go(fitted)

    def show_space(self, bounds: Float[np.ndarray, "2 3"] | None) -> None:
        """Go to 3D, with bodies in this box: to the user's last pose, or to one that shows them well; also when the box
        changes completely."""
        self._bounds = self._bounds if bounds is None else bounds
        self._enter("space")
        fitted = self._fitted("space")
        if not self.moved and math.dist(self.pose.position, fitted.position) > _SLACK * fitted.distance:
            self._go(fitted)

    def reset(self) -> None:
        """Reset to the whole view of the current scene."""
        if self._scene is not None:
            self._go(self._fitted(self._scene))

    def zoom_to(self, rectangle: Rectangle) -> None:
        """In 2D: fit a part of the picture, in the poster world, to its window."""
        if self._scene == "posters" and self._division is not None:
            left, top, right, bottom = rectangle
            scale = self._division.scale_of(right - left, bottom - top)
            self._go(self._flat((left + right) / 2, (top + bottom) / 2, scale), moved=True, part=rectangle)

    def centre(self, x: float, y: float) -> None:
        """In 2D: bring a point of the picture, in the poster world, to the centre of its window, at the same scale."""
        if self._scene == "posters":
            pose = self.pose
            self._go(replace(pose, position=(x, y, pose.position[2]), look_at=(x, y, pose.look_at[2])), moved=True)

    def zoom_in_space(self, bounds: Float[np.ndarray, "2 3"], obstacles: Float[np.ndarray, "n 3"]) -> None:
        """In 3D: fit a bounding box (least and greatest coordinates) to the window, from the current direction; from
        another one if the camera would be inside or behind a body with these vertices."""
        self._go(clear_pose(nearer_pose(self.pose, bounds, self._window), obstacles), moved=True)

    def touched(self) -> None:
        """The user moves the camera."""
        if self._scene is not None:
            place = self._places[self._scene]
            place.moved, place.by_hand, place.part = True, True, None

    def follow(self, canvas: tuple[float, float] | None = None) -> None:
        """Refit the 3D scene to a new window unless the user has moved the camera; posters have their own windows.

        Args:
            canvas: Width and height in CSS pixels, if reported by the page; otherwise viser's, in device pixels.
        """
        self._canvas = canvas or self._canvas
        before, self._window = self._window, self._current_window()
        if self._scene == "space" and self._window != before and not self.moved:
            self._go(self._fitted("space"))

    @property
    def window(self) -> Window:
        """The canvas, as far as known."""
        return self._window

    @property
    def moved(self) -> bool:
        """Whether the user has left the whole view of the current scene."""
        return self._scene is not None and self._places[self._scene].moved

    @property
    def pose(self) -> Pose:
        """The camera's pose as far as known; something must have been shown."""
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
        return Window(width=max(width, 1), height=max(height, 1))

    def _fitted(self, scene: Scene) -> Pose:
        if scene == "space":
            return space_pose(self._bounds, self._window)
        assert self._division is not None
        return self._flat(0.0, 0.0, self._division.scale)

    def _flat(self, x: float, y: float, scale: float) -> Pose:
        assert self._division is not None
        return poster_pose((x, y), scale, whole=self._division.scale, canvas=self._window)

    def _go(self, pose: Pose, *, moved: bool = False, part: Rectangle | None = None) -> None:
        assert self._scene is not None
        self._places[self._scene] = _Place(pose, moved, part=part)
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

# Directions towards the lights (x right, y down, z away from the camera), colours, intensities: a key light from the
# camera's upper left, a weak fill from its right, and a rim light from behind.
_LIGHTS: tuple[tuple[str, tuple[float, float, float], RGB, float], ...] = (
    ("key", (-0.5, -0.7, -0.9), (255, 250, 242), 2.5),
    ("fill", (0.9, -0.1, -0.6), (226, 236, 255), 0.55),
    ("rim", (0.3, -0.6, 1.0), (255, 255, 255), 0.9),
)
_AMBIENT = 0.6


class SceneView:
    """Draws snapshots into one browser tab, sending only differences from the last one.

    For one thread at a time. Create it when the client has connected.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        with client.atomic():
            _light(client)
            dressing = MeshDressing(client)
            self._posters, self._space = PosterNodes(client, dressing), SpaceNodes(client, dressing)
        self.rings = self._space.rings
        """In 3D."""
        self.cameras = Cameras(client)
        self._last: Snapshot | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Show it, and hide the other mode."""
        with self._client.atomic():
            self.move(snapshot)
            if isinstance(snapshot, Posters):
                self.cameras.show_posters(snapshot.divide(self.cameras.window))
            else:
                self.cameras.show_space(snapshot.bounds())
            self._posters.set_visible(isinstance(snapshot, Posters))
            self._space.set_visible(isinstance(snapshot, Space))

    def move(self, snapshot: Snapshot) -> None:
        """Draw what has moved since the last one, of the same mode and with the same view."""
        if isinstance(snapshot, Posters):
            self._posters.draw(snapshot)
        else:
            self._space.draw(snapshot)
        self._last = snapshot

    def zoom_to(self, pixels: Rectangle) -> None:
        """In 2D: fit a rectangle of image pixels (left, top, right, bottom) to each picture's window."""
        if not isinstance(self._last, Posters):
            return
        corners = np.array(pixels, float).reshape(2, 2)
        world = world_of_pixels(corners, self._last.camera.size)
        self.cameras.zoom_to((*world[0].tolist(), *world[1].tolist()))

    def centre(self, pixel: Float[np.ndarray, "2"]) -> None:
        """In 2D: bring an image pixel to the centre of each picture's window, at the same scale."""
        if isinstance(self._last, Posters):
            x, y = world_of_pixels(pixel, self._last.camera.size).tolist()
            self.cameras.centre(x, y)

    def zoom_about_middle(self, pixels: float) -> None:
        """In 2D: fit this fraction of the picture's height and width, around its centre, to each picture's window."""
        height, half = (self._last.camera.size[1], pixels / 2) if self._last else (1, 0.5)
        self.cameras.zoom_to((-half / height, -half / height, half / height, half / height))

    def zoom_in_space(self, points: Sequence[Float[np.ndarray, "n 3"]]) -> None:
        """In 3D: fit points of the bodies on show, in camera space, to the window; NaN are ignored."""
        if not isinstance(self._last, Space):
            return
        there = np.concatenate([found @ self._last.turn.T + self._last.place for found in points])
        there = there[np.isfinite(there).all(-1)]
        self.cameras.zoom_in_space(np.stack([there.min(0), there.max(0)]), self._last.obstacles())


def _light(client: viser.ClientHandle) -> None:
    """Replace viser's lights by soft light from the video camera's side, and set y down."""
    scene = client.scene
    scene.set_up_direction("-y")
    scene.configure_default_lights(enabled=False, cast_shadow=False)
    scene.configure_environment_map(None)
    scene.add_light_ambient("/light/ambient", intensity=_AMBIENT)
    for name, direction, color, intensity in _LIGHTS:
        scene.add_light_directional(
            f"/light/{name}", color=color, intensity=intensity, cast_shadow=False, position=direction
        )
