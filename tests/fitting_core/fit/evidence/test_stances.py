"""Feet that stand: where they are held, and that a fit then leaves them there."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.camera import Camera, path_of
from fitting_core.fit.evidence.stances import stances
from fitting_core.ground.contacts import FOOT_POINTS, Contacts
from fitting_core.ground.gravity import Gravity
from fitting_core.ground.grounding import Grounding
from fitting_core.ground.plane import Ground

UP = np.array([0.0, -1.0, 0.0])
SOLES = np.tile([0.09, 0.02, 0.01, 0.01], (2, 1))
FRAMES = 12
CAMERA = Camera(focal=(1000.0, 1000.0), center=(500.0, 500.0), size=(1000, 1000))
CAMERA_HEIGHT = 1.5


def foot_at(place: np.ndarray) -> np.ndarray:
    """Ankle, heel and toes of a flat foot whose sole lies at `place`, x right, y down, z away."""
    flat = np.array([[0.0, 0, 0], [0, 0, 0.05], [0.0, 0, -0.15], [0.05, 0, -0.12]])
    return place + flat + SOLES[0][:, None] * UP


def feet(random: np.random.Generator) -> np.ndarray:
    """The left foot stands on the floor 4 m away, its depth off by 0.1 m; the right one walks about."""
    places = np.zeros((FRAMES, 2, 4, 3))
    for frame in range(FRAMES):
        left = np.array([0.2, CAMERA_HEIGHT, 4.0]) * (1 + random.normal(0, 0.1) / 4.0)
        places[frame] = foot_at(left), foot_at(np.array([-0.2, CAMERA_HEIGHT, 4 + 0.1 * frame]))
    return places


def grounding(standing: np.ndarray, *, ground: bool = True, deviation: float = 1.0) -> Grounding:
    floor = Ground(normal=UP, offset=CAMERA_HEIGHT, deviation=0.01) if ground else None
    contacts = Contacts(probability=standing.astype(float), standing=standing)
    return Grounding(gravity=Gravity(up=UP, deviation=deviation), contacts=contacts, ground=floor)


@pytest.fixture
def standing() -> np.ndarray:
    """The left foot from frame 2 to 7."""
    return np.array([[2 <= frame < 8, False] for frame in range(FRAMES)])


def test_a_foot_is_held_in_one_place_while_it_stands(standing: np.ndarray):
    held = stances(grounding(standing), feet(np.random.default_rng(0)), SOLES, CAMERA)
    left, right = FOOT_POINTS
    assert np.isfinite(held.deviation[2:8, left]).all() and not np.isfinite(held.deviation[:, right]).any()
    assert np.isfinite(held.deviation).sum() == 6 * 4
    assert np.ptp(held.position[2:8, left], axis=0).max() == 0


def test_it_is_held_on_the_floor_and_where_the_image_shows_it(standing: np.ndarray):
    """Too near by 0.2 m it hangs above the floor by 0.075 m: it goes back along the line of sight."""
    true = foot_at(np.array([0.2, CAMERA_HEIGHT, 4.0]))
    near = np.repeat(true[None, None] * 0.95, FRAMES, 0).repeat(2, 1)
    left = FOOT_POINTS[0]
    on_floor = stances(grounding(standing), near, SOLES, CAMERA).position[4, left]
    in_air = stances(grounding(standing, ground=False), near, SOLES, CAMERA).position[4, left]
    np.testing.assert_allclose(in_air, near[0, 0])
    assert abs(on_floor - true).max() < 0.06 < abs(in_air - true).max()
    rays = [points[:, :2] / points[:, 2:] for points in (on_floor, near[0, 0])]
    assert abs(rays[0] - rays[1]).max() < 0.01


def test_what_stands_on_something_else_stays_there(standing: np.ndarray):
    """Half a metre above the floor: a chair."""
    high = feet(np.random.default_rng(0)) + 0.5 * UP
    places = [stances(grounding(standing, ground=g), high, SOLES, CAMERA).position for g in (True, False)]
    np.testing.assert_array_equal(*places)


def test_a_floor_that_may_be_tilted_says_less_far_away(standing: np.ndarray):
    both = np.repeat(standing[:, :1], 2, axis=1)
    both[:2] = False
    places = feet(np.random.default_rng(0))
    places[:, 1] = foot_at(np.array([-0.2, CAMERA_HEIGHT - 0.1, 8.0]))
    right = FOOT_POINTS[1]
    moved = [
        np.linalg.norm(
            stances(grounding(both, deviation=d), places, SOLES, CAMERA).position[4, right] - places[4, 1], axis=1
        )
        for d in (0.1, 10.0)
    ]
    assert moved[1].max() < 0.3 * moved[0].min()


def test_whoever_never_stands_is_not_held():
    nobody = stances(grounding(np.zeros((FRAMES, 2), bool)), feet(np.random.default_rng(0)), SOLES, CAMERA)
    assert not np.isfinite(nobody.deviation).any()


def test_before_a_camera_that_moves_it_stays_in_one_place_of_still_space(standing: np.ndarray):
    turns = Rotation.from_rotvec(np.linspace(0, 0.5, FRAMES)[:, None] * [0.2, 1.0, 0.0]).as_matrix()
    path = path_of(turns, np.linspace(0, 1, FRAMES)[:, None] * [0.5, 0.0, 0.1])
    moving, places = replace(CAMERA, path=path), feet(np.random.default_rng(0))
    expected = stances(grounding(standing), places, SOLES, CAMERA).position
    held = stances(grounding(standing), places, SOLES, moving).position
    left = FOOT_POINTS[0]
    back = (held[2:8, left] - np.array(path.translation)[2:8, None]) @ turns[2:8]
    assert np.ptp(back, axis=0).max() < 1e-12 and np.ptp(held[2:8, left], axis=0).max() > 0.1
    assert abs(back - expected[2:8, left]).max() < 0.02  # the line of sight is another one
