"""Lenses against OpenCV's own projection and pictures, and what they fold."""

import cv2
import numpy as np
import pytest

from fitting_core.camera import Lens
from fitting_core.lens import Straightener, filmed, share_straightened, straightened

K = np.array([[900.0, 0, 640], [0, 950, 350], [0, 0, 1]])
SIZE = (1280, 720)
COEFFICIENTS = (
    (-0.3, 0.1, 0.001, -0.002),
    (0.2, -0.1, 0.003, 0.001, 0.05),
    (0.1, -0.05, 0.001, 0.002, 0.01, 0.05, 0.02, 0.01),
    (0.1, -0.05, 0.001, 0.002, 0.01, 0.05, 0.02, 0.01, 0.002, 0.001, -0.001, 0.003),
)


def lens(distortion: tuple[float, ...]) -> Lens:
    return Lens(focal=(K[0, 0], K[1, 1]), center=(K[0, 2], K[1, 2]), distortion=distortion)


@pytest.mark.parametrize("distortion", COEFFICIENTS)
def test_points_go_where_opencv_projects_them_and_come_back(distortion: tuple[float, ...]):
    rays = np.random.default_rng(0).uniform((-0.7, -0.4), (0.7, 0.4), (200, 2))
    points = np.concatenate([rays, np.ones((200, 1))], 1)
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(distortion))[0][:, 0]
    pinhole = rays * (900, 950) + (640, 350)
    np.testing.assert_allclose(filmed(lens(distortion), pinhole), expected, atol=1e-9)
    back, found = straightened(lens(distortion), expected)
    assert found.all()
    np.testing.assert_allclose(back, pinhole, atol=1e-6)


def test_pictures_are_straightened_as_points_are():
    distortion = COEFFICIENTS[0]
    picture = np.zeros((720, 1280, 3), np.uint8)
    spots = np.array([[300.0, 200], [1000, 600], [640, 360]])
    for x, y in np.round(spots).astype(int):
        cv2.circle(picture, (int(x), int(y)), 6, (255, 255, 255), -1)
    straight = Straightener(lens(distortion), SIZE)(picture)
    assert straight.shape == picture.shape
    _, _, _, centers = cv2.connectedComponentsWithStats((straight[..., 0] > 127).astype(np.uint8))
    # The middle of pixel i is at i + 0.5.
    expected, _ = straightened(lens(distortion), spots + 0.5)
    got = centers[1:] + 0.5
    for point in expected:
        assert np.linalg.norm(got - point, axis=1).min() < 0.3


def test_what_a_lens_folds_is_nowhere():
    folding = lens((-0.9, 0.0, 0.0, 0.0))
    assert share_straightened(lens(COEFFICIENTS[0]), SIZE) == 1.0
    share = share_straightened(folding, SIZE)
    assert 0.2 < share < 0.9
    corner = np.array([[3.0, 4.0], [641.0, 351.0]])
    places, found = straightened(folding, corner)
    assert found.tolist() == [False, True] and (places[0] == corner[0]).all()
    # No ghost of the middle far out: what is nowhere is black.
    white = np.full((720, 1280, 3), 255, np.uint8)
    straight = Straightener(folding, SIZE)(white)
    assert straight[360, 640].min() == 255 and straight[0, 0].max() == 0
