"""The side view's arithmetic, for bodies whose place is known, and the room around a camera that moves. No browser."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.camera import Camera, path_of
from fitting_core.ground.level import Level, upright
from tcfit_app.review.scene.layers import BodyLayer
from tcfit_app.review.scene.poses import Window
from tcfit_app.review.scene.poster import Poster, Posters, SidePoster
from tcfit_app.review.scene.room import Room, room_around
from tcfit_app.review.scene.side_view import Direction, SideView, side_view, usual_width
from tcfit_app.review.scene.space import Space

CAMERA = Camera(focal=(1000.0, 1000.0), center=(270.0, 360.0), size=(540, 720))
HIGH = 1.4
"""Metres of the camera above the floor."""


def man(x: float = 0.0, z: float = 4.0) -> np.ndarray:
    """Points of an upright man of 1.8 m in level space, on the floor: sole, crown, one hand ahead and one aside."""
    y = HIGH - np.array([0.0, 1.8, 1.0, 1.2])
    return np.stack([x + np.array([0.0, 0.0, 0.0, 0.6]), y, z + np.array([0.0, 0.0, -0.4, 0.0])], 1)


def pitched(degrees: float) -> np.ndarray:
    """From camera space to level space, for a camera that looks down by so much, and is rolled a little."""
    a, roll = np.radians(degrees), np.radians(5.0)
    down = np.array([[1, 0, 0], [0, np.cos(a), np.sin(a)], [0, -np.sin(a), np.cos(a)]])
    return down @ np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])


def level(turn: np.ndarray) -> Level:
    return Level(turn=turn, height=HIGH, text="")


def seen(direction: Direction, turn: np.ndarray | None = None, *, width: float = 0.9, frames: int = 3) -> SideView:
    turn = np.eye(3) if turn is None else turn
    vertices = np.stack([man() for _ in range(frames)]) @ turn
    return side_view(room_around(vertices, level(turn)), CAMERA, direction, width)


def on_plate(view: SideView, points: np.ndarray, turn: np.ndarray | None = None) -> np.ndarray:
    """Where points of level space lie on the plate, in metres: x right, y down."""
    return view.flat(points @ (np.eye(3) if turn is None else turn)) / view.scale


@pytest.mark.parametrize("degrees", [0.0, 25.0, -40.0])
def test_an_upright_man_stands_upright_however_the_camera_is_held(degrees: float):
    turn = pitched(degrees)
    np.testing.assert_allclose(upright(turn.T @ [0, -1, 0])[1], turn[1], atol=1e-12)
    view = seen("right", turn)
    sole, crown, *_ = on_plate(view, man(), turn)
    assert crown[0] == pytest.approx(sole[0], abs=1e-9) and sole[1] - crown[1] == pytest.approx(1.8)
    assert view.floor == HIGH
    assert (view.floor - view.middle[1]) == pytest.approx(sole[1])
    np.testing.assert_allclose(view.heights(man() @ turn), [0.0, 1.8, 1.0, 1.2], atol=1e-9)


@pytest.mark.parametrize(
    ("direction", "ahead", "aside"),
    [
        # The hand towards the camera, and the one at the picture's right: where they lie beside the man.
        ("right", (-0.4, 0.0), (0.0, 0.0)),
        ("left", (0.4, 0.0), (0.0, 0.0)),
        ("top", (0.0, 0.4), (0.6, 0.0)),
    ],
)
def test_directions(direction: Direction, ahead: tuple[float, float], aside: tuple[float, float]):
    sole, _, forward, sideways = on_plate(seen(direction), man())
    if direction == "top":
        np.testing.assert_allclose([forward - sole, sideways - sole], [ahead, aside], atol=1e-9)
    else:
        np.testing.assert_allclose([(forward - sole)[0], (sideways - sole)[0]], [ahead[0], aside[0]], atol=1e-9)


def test_what_is_nearer_to_the_viewer_hides_the_rest():
    (relief,) = seen("right").relief([man()], np.zeros((1, 2)))
    assert relief[3, 2] < relief[0, 2] == 0.0


def test_a_man_is_as_tall_as_in_the_picture_and_as_high_up():
    far = replace(CAMERA, focal=(700.0, 700.0))
    view = side_view(room_around(man()[None], level(np.eye(3))), far, "right", 0.9)
    low, high = man().min(0), man().max(0)
    depth = (low + high)[2] / 2
    assert view.scale == pytest.approx(700 / depth / 720)
    middle = (low + high)[1] / 2
    assert view.flat(np.array([[0.0, middle, depth]]))[0, 1] == pytest.approx(700 * middle / depth / 720)


def test_a_man_who_would_not_fit_is_smaller():
    tall = replace(CAMERA, focal=(1474.0, 1474.0), center=(270.0, 166.0))  # from edge to edge of the picture
    view = side_view(room_around(man()[None], level(np.eye(3))), tall, "right", 0.9)
    flat = view.flat(man())
    assert view.scale < 1474 / 3.8 / 720
    assert abs(flat[:, 1]).max() <= 0.5 and np.ptp(flat[:, 1]) == pytest.approx(0.9)


def test_legs_that_the_picture_cuts_off_are_cut_off_too():
    near = replace(CAMERA, focal=(2600.0, 2600.0), center=(270.0, 700.0))
    view = side_view(room_around(man()[None], level(np.eye(3))), near, "right", 1.2)
    (relief,) = view.relief([man()], np.zeros((1, 2)))
    assert view.scale == pytest.approx(2600 / 3.8 / 720)
    assert view.flat(man())[0, 1] > 0.5 and relief[0, 1] == 0.5


def test_steps_towards_the_camera_are_seen_until_the_plate_ends():
    walk = np.stack([man(z=z) for z in np.linspace(3.0, 9.0, 25)])
    view = side_view(room_around(walk, level(np.eye(3))), CAMERA, "right", 0.6)
    there = [view.flat(body) + view.shifts([body])[0] for body in walk]
    assert all(abs(flat[:, 0]).max() <= 0.3 + 1e-9 for flat in there)
    middle = walk[12]
    moved = middle + np.array([0.0, 0.0, 0.1])
    assert (view.shifts([middle]) == 0).all() and (view.shifts([moved]) == 0).all()
    assert (view.flat(moved) - view.flat(middle))[0, 0] == pytest.approx(0.1 * view.scale)
    assert abs(view.shifts([walk[0]])[0, 0]) > 0.1 and (view.shifts(list(walk))[:, 1] == 0).all()


def test_two_bodies_keep_their_distance_where_there_is_room():
    view = seen("right", width=1.5)
    first, second = view.shifts([man(), man(z=4.4)])
    assert (first == second).all()
    first, second = view.shifts([man(), man(z=8.0)])
    assert first[0] != second[0]
    assert abs(view.flat(man(z=8.0)) + second)[:, 0].max() <= 0.75 + 1e-9


def test_a_pixel_s_line_of_sight_goes_through_what_is_seen_there():
    turn = pitched(20.0)
    view = seen("left", turn)
    point = man()[2] @ turn
    pixel = point[:2] / point[2] * CAMERA.focal + CAMERA.center
    camera = view.pixels(np.zeros(3), np.zeros(2), 720)
    way = view.sight(CAMERA, 720) @ [*pixel, 1.0]
    np.testing.assert_allclose(camera + point[2] * way, view.pixels(point, np.zeros(2), 720), atol=1e-9)


def test_without_gravity_the_room_is_held_as_the_camera_is():
    room = room_around(np.stack([man()] * 4), None)
    assert (room.turn == np.eye(3)).all() and not room.level and room.floor == pytest.approx(HIGH)


def test_frames_that_are_no_numbers_are_left_out_of_the_room():
    vertices = np.stack([man()] * 5)
    vertices[2] = np.nan
    assert len(room_around(vertices, None).boxes) == 4
    nothing: Room = room_around(vertices[2:3], None)
    assert np.isfinite(nothing.extent).all()


def test_the_plate_stands_at_the_right_of_the_pictures():
    posters = Posters(camera=CAMERA, posters=(Poster(), Poster()), side=SidePoster(view=seen("right", width=0.5)))
    division = posters.divide(Window(width=1000, height=400))
    left, _, right, _ = division.windows[2]
    assert right == 1000 and right - left == pytest.approx(0.5 * division.scale)
    assert [window[0] < left for window in division.windows] == [True, True, False]


def test_plates_are_narrow_beside_wide_pictures():
    assert usual_width(16 / 9) == 0.5 and usual_width(9 / 16) == 0.9 and usual_width(1.0) == 0.75


# --- a camera that moves ---


TURNS = Rotation.from_rotvec(np.linspace(0, 0.9, 5)[:, None] * [0.3, 1.0, -0.1]).as_matrix()
MOVES = np.linspace(0, 1.0, 5)[:, None] * np.array([[0.4, -0.1, 0.3]])
MOVING = Camera(focal=(1000.0, 1000.0), center=(270.0, 360.0), size=(540, 720), path=path_of(TURNS, MOVES))
TILT = Rotation.from_euler("x", 20, degrees=True).as_matrix()
MAN = np.array([[0.0, 1.4, 4.0], [0.0, -0.4, 4.0], [0.2, 0.4, 3.6]])
"""In level space: sole, crown, hand."""


def filmed(frame: int) -> np.ndarray:
    """The man in the camera space of a frame."""
    return (MAN @ TILT) @ TURNS[frame].T + MOVES[frame]


@pytest.fixture
def room() -> Room:
    still = MOVING.to_still(np.stack([filmed(frame) for frame in range(5)]))
    return room_around(still, Level(turn=TILT, height=1.4, text=""))


@pytest.mark.parametrize("frame", [0, 2, 4])
def test_the_room_stands_still(room: Room, frame: int):
    here = room.before(MOVING, frame)
    np.testing.assert_allclose(filmed(frame) @ here.turn.T + here.place, MAN, atol=1e-12)
    np.testing.assert_allclose(room.extent, [MAN.min(0), MAN.max(0)], atol=1e-12)
    body = BodyLayer(vertices=filmed(frame), faces=np.zeros((1, 3), int), color=(1, 2, 3), camera=MOVING)
    space = Space(camera=MOVING, bodies=(body,), turn=here.turn, place=here.place)
    bounds = space.bounds()
    assert bounds is not None
    np.testing.assert_allclose(bounds, [MAN.min(0), MAN.max(0)], atol=1e-12)
    assert room.before(replace(MOVING, path=None), frame) is room


@pytest.mark.parametrize("direction", ["right", "top"])
def test_the_side_view_stands_still(room: Room, direction):
    view = side_view(room, MOVING, direction, 0.9)
    plates = [view.before(MOVING, frame) for frame in range(5)]
    flat = [plate.flat(filmed(frame)) for frame, plate in enumerate(plates)]
    np.testing.assert_allclose(flat, np.broadcast_to(flat[0], (5, 3, 2)), atol=1e-9)
    for frame, plate in enumerate(plates):
        np.testing.assert_allclose(plate.heights(filmed(frame)), 1.4 - MAN[:, 1], atol=1e-9)
        if plate.floor is not None:
            assert (plate.floor - plate.middle[1]) * plate.scale == pytest.approx(flat[0][0, 1])
