"""The viewer's camera in one browser tab: fits posters into the window, and remembers where the user went."""

import math
import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import viser
from jaxtyping import Float
from viser import _messages

from tcfit_app.view.poses import (
    Pose,
    Rectangle,
    Window,
    is_straight,
    overview_pose,
    poster_pose,
    space_pose,
    straightened,
)

Scene = Rectangle | Literal["space"]
"""What there is to look at: posters, told by their extent in the world, or the 3D scene."""

STRIP_HEIGHT = 132.0
"""Of the timeline that covers the canvas's bottom, CSS pixels."""
_ECHO_SECONDS = 0.7
"""For how long after a command another pose that the browser reports is not taken for the user's doing."""
_STALE_SECONDS = 15.0
"""The same for the pose of before: a busy browser keeps it until it gets to the command."""


@dataclass
class _Place:
    """Where the camera is in a scene."""

    pose: Pose
    moved: bool = False
    """By the user, or by a zoom that the user asked for."""


class Cameras:
    """Sets the camera of a client and follows what the user does with it.

    Nothing here runs in a callback: `follow` is called by the draw loop and looks at what the browser last reported.
    """

    def __init__(self, client: viser.ClientHandle, *, strip_height: float = STRIP_HEIGHT) -> None:
        self._client, self._strip_height = client, strip_height
        self._scene: Scene | None = None
        self._places: dict[Scene, _Place] = {}
        self._bounds = np.array([[-0.5, -0.5, 3.0], [0.5, 0.9, 4.0]])
        self._canvas: tuple[float, float] | None = None
        self._window = self._current_window()
        self._sent_at = -math.inf
        self._before: Pose | None = None

    def show_posters(self, whole: Rectangle) -> None:
        """To 2D, with posters in that part of the poster world: where the user was, or all of them."""
        self._enter(whole)

    def show_space(self, bounds: Float[np.ndarray, "2 3"] | None) -> None:
        """To 3D, with bodies in that box: where the user was, or where they are seen well."""
        self._bounds = self._bounds if bounds is None else bounds
        self._enter("space")

    def reset(self) -> None:
        """Back to the whole view of the current scene. In 3D, where nothing is left to reset, it takes the video camera
        into view as well, and back again.
        """
        if self._scene is None:
            return
        self.follow()
        fitted = self._fitted(self._scene)
        if self._scene == "space" and self.pose.close_to(fitted):
            fitted = overview_pose(self._bounds, self._window)
        self._go(fitted)

    def zoom_to(self, rectangle: Rectangle) -> None:
        """In 2D: a part of the poster world fills the window."""
        if self._scene is not None and self._scene != "space":
            self._go(poster_pose(rectangle, self._scene, self._window), moved=True)

    def follow(self, canvas: tuple[float, float] | None = None) -> None:
        """Notices what the user did to camera and window, and refits posters to a new window unless they are zoomed.

        Args:
            canvas: Width and height in CSS pixels, where the page tells them; else the browser's report is used, which
                counts device pixels.
        """
        self._canvas = canvas or self._canvas
        if self._scene is None:
            return
        self._notice_user(self._scene)
        window = self._current_window()
        if window != self._window:
            self._window = window
            if self._scene != "space" and not self.moved:
                self._go(self._fitted(self._scene))

    @property
    def moved(self) -> bool:
        """Whether the user has left the whole view of the current scene."""
        return self._scene is not None and self._places[self._scene].moved

    @property
    def pose(self) -> Pose:
        """Where the camera is, as far as is known; something must have been shown."""
        assert self._scene is not None
        return self._places[self._scene].pose

    def _notice_user(self, scene: Scene) -> None:
        seen = self._seen(self.pose)
        if seen.close_to(self.pose):
            self._sent_at = -math.inf
        elif not self._is_echo(seen):
            if scene != "space" and not is_straight(seen):
                self._go(straightened(seen), moved=True)
            else:
                self._places[scene] = _Place(seen, moved=True)

    def _is_echo(self, seen: Pose) -> bool:
        """Whether this is no news of the user, but from before the browser had carried out the last command."""
        passed = time.monotonic() - self._sent_at
        before = self._before
        stale = before is not None and before.close_to(replace(seen, fov=before.fov))
        return passed < (_STALE_SECONDS if stale else _ECHO_SECONDS)

    def _seen(self, like: Pose) -> Pose:
        camera = self._client.camera
        return replace(
            like,
            position=tuple(camera.position.tolist()),
            look_at=tuple(camera.look_at.tolist()),
            up=tuple(camera.up_direction.tolist()),
            fov=camera.fov,
        )

    def _current_window(self) -> Window:
        camera = self._client.camera
        width, height = self._canvas or (camera.image_width, camera.image_height)
        return Window(width=max(width, 1), height=max(height, 1), covered=self._strip_height)

    def _enter(self, scene: Scene) -> None:
        if scene == self._scene:
            return
        self.follow()
        self._scene = scene
        place = self._places.get(scene)
        moved = place is not None and place.moved
        self._go(place.pose if place and moved else self._fitted(scene), moved=moved)

    def _fitted(self, scene: Scene) -> Pose:
        if scene == "space":
            return space_pose(self._bounds, self._window)
        return poster_pose(scene, scene, self._window)

    def _go(self, pose: Pose, *, moved: bool = False) -> None:
        assert self._scene is not None
        self._places[self._scene] = _Place(pose, moved)
        self._before = self._seen(pose)
        self._sent_at = time.monotonic()
        # viser's own setters leave out what equals the last report, which may be older than the last command.
        with self._client.atomic():
            for message in _pose_messages(pose):
                self._client._websock_connection.queue_message(message)


def _pose_messages(pose: Pose) -> list[_messages.Message]:
    """In the order in which the browser must apply them: a bound on the distance moves a camera that is beyond it."""
    return [
        _messages.SetCameraFovMessage(pose.fov),
        _messages.SetCameraNearMessage(pose.near),
        _messages.SetCameraFarMessage(pose.far),
        _messages.SetCameraUpDirectionMessage(pose.up),
        _messages.SetCameraPositionMessage(pose.position),
        _messages.SetCameraLookAtMessage(pose.look_at),
        _messages.SetCameraMinOrbitDistanceMessage(pose.least_distance),
        _messages.SetCameraMaxOrbitDistanceMessage(pose.most_distance),
    ]
