"""A camera that moves, in 3D and in the side view: the room stands still around it. No browser."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.camera import Camera, path_of
from fitting_core.ground.level import Level
from tcfit_app.review.scene.layers import BodyLayer
from tcfit_app.review.scene.room import Room, room_around
from tcfit_app.review.scene.side_view import side_view
from tcfit_app.review.scene.space import Space

TURNS = Rotation.from_rotvec(np.linspace(0, 0.9, 5)[:, None] * [0.3, 1.0, -0.1]).as_matrix()
MOVES = np.linspace(0, 1.0, 5)[:, None] * np.array([[0.4, -0.1, 0.3]])
CAMERA = Camera(focal=(1000.0, 1000.0), center=(270.0, 360.0), size=(540, 720), path=path_of(TURNS, MOVES))
TILT = Rotation.from_euler("x", 20, degrees=True).as_matrix()
MAN = np.array([[0.0, 1.4, 4.0], [0.0, -0.4, 4.0], [0.2, 0.4, 3.6]])
"""In level space: sole, crown, hand."""


def seen(frame: int) -> np.ndarray:
    """The man in the camera space of a frame."""
    return (MAN @ TILT) @ TURNS[frame].T + MOVES[frame]


@pytest.fixture
def room() -> Room:
    still = CAMERA.to_still(np.stack([seen(frame) for frame in range(5)]))
    return room_around(still, Level(turn=TILT, height=1.4, text=""))


@pytest.mark.parametrize("frame", [0, 2, 4])
def test_the_room_stands_still(room: Room, frame: int):
    here = room.before(CAMERA, frame)
    np.testing.assert_allclose(seen(frame) @ here.turn.T + here.place, MAN, atol=1e-12)
    np.testing.assert_allclose(room.extent, [MAN.min(0), MAN.max(0)], atol=1e-12)
    body = BodyLayer(vertices=seen(frame), faces=np.zeros((1, 3), int), color=(1, 2, 3), camera=CAMERA)
    space = Space(camera=CAMERA, bodies=(body,), turn=here.turn, place=here.place)
    bounds = space.bounds()
    assert bounds is not None
    np.testing.assert_allclose(bounds, [MAN.min(0), MAN.max(0)], atol=1e-12)
    assert room.before(replace(CAMERA, path=None), frame) is room


@pytest.mark.parametrize("direction", ["right", "top"])
def test_the_side_view_stands_still(room: Room, direction):
    view = side_view(room, CAMERA, direction, 0.9)
    plates = [view.before(CAMERA, frame) for frame in range(5)]
    flat = [plate.flat(seen(frame)) for frame, plate in enumerate(plates)]
    np.testing.assert_allclose(flat, np.broadcast_to(flat[0], (5, 3, 2)), atol=1e-9)
    for frame, plate in enumerate(plates):
        np.testing.assert_allclose(plate.heights(seen(frame)), 1.4 - MAN[:, 1], atol=1e-9)
        if plate.floor is not None:
            assert (plate.floor - plate.middle[1]) * plate.scale == pytest.approx(flat[0][0, 1])
