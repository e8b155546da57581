"""Where the viewer's camera stands, and what of it is the user's doing. No browser."""

import contextlib
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from viser import _messages

from fitting_core.body.model import BodyModel
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.review.scene.poses import (
    POSTER_FOV,
    Pose,
    Rectangle,
    Vector,
    Window,
    clear_pose,
    nearer_pose,
    poster_pose,
    space_pose,
)
from tcfit_app.review.scene.scene import Cameras
from tcfit_app.review.scene.windows import Division, divide
from tests.samples.posed import still_params

WIDTH = 1.6
CORNERS = (-0.8, -0.5), (0.8, 0.5)
BOUNDS = np.array([[-0.4, -0.9, 3.0], [0.5, 0.9, 3.6]])
WINDOW = Window(width=1280, height=720)


def on_screen(pose: Pose, point: tuple[float, float], window: Rectangle, canvas: Window) -> tuple[float, float]:
    """Where a point of the picture is seen in a window of the canvas."""
    scale = canvas.height / (2 * -pose.position[2] * math.tan(pose.fov / 2))
    left, top, right, bottom = window
    return (
        (left + right) / 2 + scale * (point[0] - pose.position[0]),
        (top + bottom) / 2 + scale * (point[1] - pose.position[1]),
    )


def test_depth_shifts_nothing_even_when_zoomed_in():
    """A relief of a fifth of the image's height, at the edge of a window zoomed in 20-fold."""
    whole = divide(WINDOW, pictures=1, width=WIDTH).scale
    pose = poster_pose((0.0, 0.0), 20 * whole, whole=whole, canvas=WINDOW)
    assert pose.fov == POSTER_FOV
    assert 0.2 / -pose.position[2] * WINDOW.width / 2 < 1.0
    assert pose.near < pose.least_distance < pose.distance < pose.most_distance < pose.far


def extent(pose: Pose, box: np.ndarray) -> tuple[float, float, float, float]:
    """Of a box (least and greatest coordinates) in the window: left, top, right, bottom, in -1 ... 1."""
    forward = np.subtract(pose.look_at, pose.position) / pose.distance
    right = np.cross(forward, pose.up) / np.linalg.norm(np.cross(forward, pose.up))
    corners = np.array(np.meshgrid(*box.T)).reshape(3, -1).T - pose.position
    slope = math.tan(pose.fov / 2) * (corners @ forward)
    x = corners @ right / slope * WINDOW.height / WINDOW.width
    y = corners @ np.cross(forward, right) / slope
    return x.min(), y.min(), x.max(), y.max()


def test_bodies_in_space_are_seen():
    left, top, right, bottom = extent(space_pose(BOUNDS, WINDOW), BOUNDS)
    assert -1 < left < right < 1 and top > -1
    assert bottom < 1
    assert bottom - top > 1.2


class Tab:
    """A browser tab: carries out the messages when told to, and lets its user move the camera."""

    def __init__(self) -> None:
        self.camera = SimpleNamespace(
            position=np.array([3.0, 3, 3]),
            look_at=np.zeros(3),
            up_direction=np.array([0.0, -1, 0]),
            fov=1.0,
            image_width=1280,
            image_height=720,
        )
        self.sent: list[_messages.Message] = []
        self.atomic = contextlib.nullcontext
        self._websock_connection = SimpleNamespace(queue_message=self.sent.append)

    def obey(self) -> None:
        """Carries out what was sent, and reports it."""
        for message in self.sent:
            if isinstance(message, _messages.SetCameraFovMessage):
                self.camera.fov = message.fov
            elif isinstance(message, _messages.SetCameraPositionMessage):
                self.camera.position = np.array(message.position)
            elif isinstance(message, _messages.SetCameraLookAtMessage):
                self.camera.look_at = np.array(message.look_at)
        self.sent.clear()

    def move(self, *shift: float) -> None:
        """The user pans and zooms."""
        self.camera.position = self.camera.position + shift
        self.camera.look_at = np.add(self.camera.look_at, (*shift[:2], 0.0))


def show(view: Cameras, pictures: int = 1) -> Division:
    """Draws posters once more; their windows."""
    division = divide(view.window, pictures=pictures, width=WIDTH)
    view.show_posters(division)
    return division


@pytest.fixture
def tab() -> Tab:
    return Tab()


@pytest.fixture
def view(tab: Tab) -> Cameras:
    """With one poster, all settled."""
    view = Cameras(tab)  # type: ignore[arg-type]
    view.follow()
    show(view)
    tab.obey()
    view.follow()
    assert not view.moved
    return view


def test_a_new_window_is_refitted_unless_the_user_has_zoomed(tab: Tab, view: Cameras):
    tab.camera.image_width = 700
    view.follow()
    show(view)
    assert tab.sent
    tab.obey()
    view.touched()
    tab.move(0.1, 0.0, 500.0)
    view.follow()
    show(view)
    assert view.moved
    tab.camera.image_width = 1280
    view.follow()
    show(view)
    assert not tab.sent and view.moved


def test_another_part_is_centred_at_the_same_scale(tab: Tab, view: Cameras):
    view.zoom_to((-0.1, -0.1, 0.1, 0.1))
    zoomed = view.pose
    view.centre(0.3, -0.2)
    assert view.pose.position == (0.3, -0.2, zoomed.position[2]) and view.pose.height == zoomed.height
    assert view.moved and view.pose.look_at[:2] == (0.3, -0.2)


def test_what_the_browser_reports_is_not_taken_for_the_user(tab: Tab, view: Cameras):
    """A busy browser reports where its camera was before the last command."""
    pose = view.pose
    tab.move(0.2, 0.1, 800.0)
    view.follow()
    assert not view.moved and view.pose == pose and not tab.sent


def test_a_reset_takes_the_camera_back(tab: Tab, view: Cameras):
    pose = view.pose
    view.touched()
    tab.move(0.2, 0.1, 800.0)
    assert view.pose != pose
    view.reset()
    assert not view.moved and view.pose == pose and tab.sent


def test_every_scene_remembers_where_its_user_was(tab: Tab, view: Cameras):
    view.touched()
    tab.move(0.2, 0.1, 800.0)
    was = tab.camera.position
    for go in (lambda: view.show_space(BOUNDS), lambda: show(view, 2), lambda: show(view, 1)):
        go()
        tab.obey()
        view.follow()
    np.testing.assert_allclose(tab.camera.position, was)
    show(view)  # the next frame
    assert not tab.sent


def test_a_turned_camera_comes_back_straight(tab: Tab, view: Cameras):
    looked_at = tab.camera.look_at
    view.touched()
    tab.camera.position = np.add(tab.camera.position, (300.0, 0.0, 20.0))
    view.show_space(BOUNDS)
    show(view)
    tab.obey()
    np.testing.assert_allclose(tab.camera.look_at, looked_at)
    np.testing.assert_allclose(tab.camera.position[:2], looked_at[:2])


def test_in_space_a_larger_box_and_another_window_are_refitted_and_a_step_is_not(tab: Tab, view: Cameras):
    view.show_space(BOUNDS)
    tab.obey()
    view.show_space(BOUNDS + 0.05)  # the next frame
    assert not tab.sent
    wide = np.stack([BOUNDS[0] - 1.0, BOUNDS[1] + 1.0])
    view.show_space(wide)
    assert tab.sent and view.pose == space_pose(wide, WINDOW)
    tab.obey()
    tab.camera.image_width, tab.camera.image_height = 600, 700
    view.follow()
    narrow = Window(width=600, height=700)
    assert tab.sent and view.pose == space_pose(wide, narrow)
    tab.obey()
    assert all(-1 < edge < 1 for edge in extent(view.pose, wide)[1::2])


def test_in_space_a_camera_that_was_moved_stays(tab: Tab, view: Cameras):
    view.show_space(BOUNDS)
    tab.obey()
    view.touched()
    view.show_space(3 * BOUNDS)
    tab.camera.image_width -= 300
    view.follow()
    assert not tab.sent


def crossed(origin: np.ndarray, way: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Where a ray crosses triangles, as multiples of its direction (Moeller and Trumbore 1997)."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(way, ac)
    scale = 1 / (ab * normal).sum(1)
    u = scale * ((origin - a) * normal).sum(1)
    other = np.cross(origin - a, ab)
    v, along = scale * (other @ way), scale * (ac * other).sum(1)
    return along[(u >= 0) & (v >= 0) & (u + v <= 1) & (along > 0)]


@pytest.mark.parametrize("view", [(0.0, -0.05, -1.0), (1.0, -0.05, 0.0), (0.0, -1.0, -0.002), (0.0, 0.05, 1.0)])
def test_a_zoom_in_space_puts_the_camera_neither_inside_the_body_nor_behind_it(free_body: BodyModel, view: Vector):
    meshes, params = Meshes(free_body), still_params(1)
    vertices = meshes.vertices(0, params, 0).astype(float)
    triangles = vertices[np.asarray(meshes.faces)]
    bounds = np.stack([vertices.min(0), vertices.max(0)])
    pose = space_pose(bounds, WINDOW)
    x, y, z = pose.look_at + pose.distance * np.array(view)
    pose = replace(pose, position=(x, y, z))
    hidden = 0
    for point in meshes.body_points(params)[0]:
        if not np.isfinite(point).all():
            continue
        near = clear_pose(nearer_pose(pose, np.stack([point, point]), WINDOW), vertices)
        eye = np.array(near.position)
        assert len(crossed(eye, np.array([0.1, 0.2, 1.0]), triangles)) % 2 == 0, "outside"
        hidden += bool((crossed(eye, point - eye, triangles) * near.distance < near.distance - 0.2).any())
    assert not hidden, "nothing is before what is looked at"


def test_a_free_view_is_left_as_it_is():
    pose = space_pose(BOUNDS, WINDOW)
    assert clear_pose(pose, np.zeros((0, 3))) == pose == clear_pose(pose, np.array([pose.look_at]))
