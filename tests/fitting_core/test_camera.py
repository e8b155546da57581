"""The pinhole camera against numbers worked out by hand."""

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fitting_core.camera import (
    DEFAULT_FOCAL,
    Camera,
    FocalFrom,
    focal_from_35mm,
    focal_from_fov,
    focal_from_words,
    project,
    with_focal_from,
)

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
