"""Feet that stand: where they are held, and that a fit then leaves them there."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.camera import Camera, path_of
from fitting_core.fit.evidence.observations import stances
from fitting_core.ground.contacts import Contacts

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


def contacts_where(standing: np.ndarray) -> Contacts:
    return Contacts(probability=standing.astype(float), standing=standing, let_go=np.zeros_like(standing))


@pytest.fixture
def standing() -> np.ndarray:
    """The left foot from frame 2 to 7."""
    return np.array([[2 <= frame < 8, False] for frame in range(FRAMES)])


def test_a_foot_is_held_in_one_place_while_it_stands(standing: np.ndarray):
    held = stances(contacts_where(standing), feet(np.random.default_rng(0)), CAMERA)
    assert np.isfinite(held.deviation[2:8, 0]).all() and np.isfinite(held.deviation).sum() == 6 * 4
    assert np.ptp(held.position[2:8, 0], axis=0).max() == 0


def test_before_a_camera_that_moves_it_stays_in_one_place_of_still_space(standing: np.ndarray):
    turns = Rotation.from_rotvec(np.linspace(0, 0.5, FRAMES)[:, None] * [0.2, 1.0, 0.0]).as_matrix()
    path = path_of(turns, np.linspace(0, 1, FRAMES)[:, None] * [0.5, 0.0, 0.1])
    moving, places = replace(CAMERA, path=path), feet(np.random.default_rng(0))
    expected = stances(contacts_where(standing), places, CAMERA).position
    held = stances(contacts_where(standing), places, moving).position
    back = (held[2:8, 0] - np.array(path.translation)[2:8, None]) @ turns[2:8]
    assert np.ptp(back, axis=0).max() < 1e-12 and np.ptp(held[2:8, 0], axis=0).max() > 0.1
    np.testing.assert_allclose(back, expected[2:8, 0], atol=1e-12)
