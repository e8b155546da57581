"""The pinhole camera against numbers worked out by hand."""

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fitting_core.camera import (
    DEFAULT_FOCAL,
    ESTIMATED,
    Camera,
    default_focal,
    focal_from_35mm,
    focal_from_fov,
    project,
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
    assert CAMERA.calibrated
    assert not any(replace(CAMERA, source=s).calibrated for s in (DEFAULT_FOCAL, f"{ESTIMATED}, between 1 and 2"))


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


def test_default_is_the_diagonal():
    assert default_focal((640, 480)) == pytest.approx(800)
    assert default_focal((640, 480)) == pytest.approx(focal_from_35mm(math.hypot(36, 24), (640, 480)))
