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

Mode = Literal["posters", "space"]

STRIP_HEIGHT = 132.0
"""Of the timeline that covers the canvas's bottom, CSS pixels."""
_ECHO_SECONDS = 0.7
"""For how long after a command an old pose that the browser still reports is not taken for the user's doing."""


@dataclass
class _Place:
    """Where the camera is in a mode."""

    pose: Pose
    moved: bool = False
    """By the user, or by a zoom that the user asked for."""


class Cameras:
    """Sets the camera of a client and follows what the user does with it.

    Nothing here runs in a callback: `follow` is called by the draw loop and looks at what the browser last reported.
    """

    def __init__(self, client: viser.ClientHandle, *, strip_height: float = STRIP_HEIGHT) -> None:
        self._client, self._strip_height = client, strip_height
        self._mode: Mode | None = None
        self._places: dict[Mode, _Place] = {}
        self._whole: Rectangle = (-1.0, -0.5, 1.0, 0.5)
        self._bounds = np.array([[-0.5, -0.5, 3.0], [0.5, 0.9, 4.0]])
        self._canvas: tuple[float, float] | None = None
        self._window = self._current_window()
        self._sent_at = -math.inf

    def show_posters(self, whole: Rectangle) -> None:
        """To 2D, with posters in that part of the poster world: where the user was, or all of them."""
        if whole == self._whole and self._mode == "posters":
            return
        self.follow()
        if whole != self._whole:
            self._whole = whole
            self._places.pop("posters", None)
        self._enter("posters")

    def show_space(self, bounds: Float[np.ndarray, "2 3"] | None) -> None:
        """To 3D, with bodies in that box: where the user was, or where they are seen well."""
        self._bounds = self._bounds if bounds is None else bounds
        if self._mode != "space":
            self.follow()
            self._enter("space")

    def reset(self) -> None:
        """Back to the whole view of the current mode. In 3D, where nothing is left to reset, it takes the video camera
        into view as well, and back again.
        """
        if self._mode is None:
            return
        self.follow()
        bodies = space_pose(self._bounds, self._window)
        if self._mode == "space" and self._places["space"].pose.close_to(bodies):
            self._go(overview_pose(self._bounds, self._window))
        else:
            self._go(self._fitted(self._mode))

    def zoom_to(self, rectangle: Rectangle) -> None:
        """In 2D: a part of the poster world fills the window."""
        self._go(poster_pose(rectangle, self._whole, self._window), moved=True)

    def follow(self, canvas: tuple[float, float] | None = None) -> None:
        """Notices what the user did to camera and window, and refits posters to a new window unless they are zoomed.

        Args:
            canvas: Width and height in CSS pixels, where the page tells them; else the browser's report is used, which
                counts device pixels.
        """
        self._canvas = canvas or self._canvas
        if self._mode is None:
            return
        self._notice_user(self._mode)
        window = self._current_window()
        if window != self._window:
            self._window = window
            if self._mode == "posters" and not self._places["posters"].moved:
                self._go(self._fitted("posters"))

    @property
    def moved(self) -> bool:
        """Whether the user has left the whole view of the current mode."""
        return self._mode is not None and self._places[self._mode].moved

    def _notice_user(self, mode: Mode) -> None:
        place = self._places[mode]
        seen = self._seen(place.pose)
        if seen.close_to(place.pose):
            self._sent_at = -math.inf
        elif time.monotonic() - self._sent_at > _ECHO_SECONDS:
            if mode == "posters" and not is_straight(seen):
                self._go(straightened(seen), moved=True)
            else:
                self._places[mode] = _Place(seen, moved=True)

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

    def _enter(self, mode: Mode) -> None:
        self._mode = mode
        place = self._places.get(mode)
        self._go(place.pose if place and place.moved else self._fitted(mode), moved=bool(place and place.moved))

    def _fitted(self, mode: Mode) -> Pose:
        if mode == "space":
            return space_pose(self._bounds, self._window)
        return poster_pose(self._whole, self._whole, self._window)

    def _go(self, pose: Pose, *, moved: bool = False) -> None:
        assert self._mode is not None
        self._places[self._mode] = _Place(pose, moved)
        self._sent_at = time.monotonic()
        # viser's own setters leave out what equals the last report, which may be older than the last command.
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
