"""Cameras and lenses: the pinhole camera against numbers worked out by hand, lenses against OpenCV."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fitting_core.camera import (
    DEFAULT_FOCAL,
    Camera,
    FocalFrom,
    Lens,
    focal_from_35mm,
    focal_from_fov,
    focal_from_words,
    project,
    with_focal_from,
)
from fitting_core.lens import Straightener, filmed, share_straightened, straightened

CAMERA = Camera(focal=(1000.0, 1100.0), center=(320.0, 240.0), size=(640, 480))


def test_projection_by_hand():
    points = torch.tensor([[0.0, 0, 5], [1, -2, 4], [-0.5, 0.25, 0.5]], dtype=torch.float64)
    expected = torch.tensor([[320.0, 240], [570, -310], [-680, 790]], dtype=torch.float64)
    torch.testing.assert_close(project(CAMERA, points), expected, rtol=0, atol=1e-10)


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.2, 50), st.floats(0.1, 10))
def test_scaling_a_scene_changes_no_pixel(x: float, y: float, z: float, scale: float):
    point = torch.tensor([x, y, z], dtype=torch.float64)
    torch.testing.assert_close(project(CAMERA, scale * point), project(CAMERA, point), rtol=1e-9, atol=1e-7)


def test_guesses_and_estimates_are_no_calibration():
    known = {FocalFrom.GIVEN, FocalFrom.FILE, FocalFrom.PHOTOGRAPHS}
    assert {told for told in FocalFrom if replace(CAMERA, focal_from=told).calibrated} == known
    assert replace(CAMERA, focal_from=FocalFrom.GIVEN, source=DEFAULT_FOCAL).calibrated, "words are for readers"


@pytest.mark.parametrize("words, told", [
    (DEFAULT_FOCAL, FocalFrom.DIAGONAL),
    ("estimated from the clip, with 80 % confidence between 700 and 1400 px", FocalFrom.ESTIMATED),
    ("camera file a.toml, camera 1, as given", FocalFrom.FILE),
    ("35 mm equivalent of 28 mm, stated by the images", FocalFrom.PHOTOGRAPHS),
    ("35 mm equivalent focal length of 28 mm, as given", FocalFrom.GIVEN),
    ("focal length of 800 pixels, as given", FocalFrom.GIVEN),
    ("as given when it was imported", FocalFrom.GIVEN),
    ("set in the review", FocalFrom.GIVEN),
    ("the demo's own camera", FocalFrom.GIVEN),
    ("SMPLify-X's default, as its results have none", FocalFrom.PROGRAM),
    ("told by the results", FocalFrom.PROGRAM),
])  # fmt: skip
def test_the_words_of_earlier_versions(words: str, told: FocalFrom):
    """Files that say where the focal length comes from in words alone."""
    assert focal_from_words(words) is told
    stored = {"focal": [500.0, 500.0], "source": words}
    assert with_focal_from(stored) == {**stored, "focal_from": told}
    assert with_focal_from({**stored, "focal_from": "given"})["focal_from"] == "given"


def test_field_of_view_reaches_the_image_border():
    focal = focal_from_fov(60.0, 640)
    assert focal == pytest.approx(320 * math.sqrt(3))
    border = torch.tensor([math.tan(math.radians(30.0)), 0.0, 1.0], dtype=torch.float64)
    camera = Camera(focal=(focal, focal), center=(320.0, 240.0), size=(640, 480))
    assert float(project(camera, border)[0]) == pytest.approx(640)


def test_35mm_equivalent_by_the_diagonal():
    # A full frame of 3600 x 2400 pixels has 100 pixels to the millimetre.
    assert focal_from_35mm(50.0, (3600, 2400)) == pytest.approx(5000)
    assert focal_from_35mm(50.0, (2400, 3600)) == pytest.approx(5000)


# --- lenses ---


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
