"""Posters: where pixels lie, reliefs, and what cannot be drawn. No browser."""

from dataclasses import replace

import numpy as np
import pytest

from fitting_core.camera import Camera
from tcfit_app.review.scene.layers import BodyLayer, color_index, color_table
from tcfit_app.review.scene.poster import relief, world_of_pixels
from tcfit_app.review.scene.room import extent
from tcfit_app.review.scene.space import Space, frustum
from tests.samples.posters import pixels_of_world

CAMERA = Camera(focal=(900.0, 950.0), center=(300.0, 410.0), size=(1280, 720))
FACES = np.array([[0, 1, 2]])


def layer(vertices: np.ndarray) -> BodyLayer:
    return BodyLayer(vertices=vertices, faces=FACES)


def points(count: int = 200) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform([-1.5, -1, 1.0], [1.5, 1, 5.0], (count, 3)).astype(np.float32)


def test_pixels_count_from_the_corner():
    corners = np.array([(0.0, 0.0), (1280.0, 720.0), (640.0, 360.0)])
    expected = [(-640 / 720, -0.5), (640 / 720, 0.5), (0, 0)]
    np.testing.assert_allclose(world_of_pixels(corners, CAMERA.size), expected)


def test_a_relief_lies_on_its_pixels():
    vertices = points()
    (drawn,) = relief([vertices], CAMERA)
    pixels = vertices[:, :2] / vertices[:, 2:] * CAMERA.focal + CAMERA.center
    np.testing.assert_allclose(pixels_of_world(drawn[:, :2].astype(float), CAMERA.size), pixels, atol=1e-3)


def test_a_relief_keeps_the_order_of_depth_even_between_bodies():
    a, b = points()[:100], points()[100:]
    drawn = np.concatenate(relief([a, b], CAMERA))[:, 2]
    assert (np.argsort(drawn) == np.argsort(np.concatenate([a, b])[:, 2])).all()
    assert drawn.max() == 0.0


@pytest.mark.parametrize("depth", [0.8, 3.0, 12.0])
def test_a_relief_is_as_deep_as_it_is_wide(depth: float):
    camera = replace(CAMERA, focal=(900.0, 900.0), center=(640.0, 360.0))
    small = 1e-3 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]) + [0, 0, depth]
    (drawn,) = relief([small], camera)
    edges = np.linalg.norm(drawn[1:].astype(float) - drawn[0], axis=1)
    np.testing.assert_allclose(edges, edges[0], rtol=2e-2)


def test_vertices_behind_the_camera_stay_within_reach():
    vertices = points()
    vertices[:5, 2] = [-3.0, 0.0, 1e-9, -1e-9, 0.01]
    (drawn,) = relief([vertices], CAMERA)
    assert np.isfinite(drawn).all() and abs(drawn[:, :2]).max() <= 8.0


def test_bodies_that_cannot_be_drawn_have_a_reason():
    good, broken = points(), points()
    broken[3, 1] = np.nan
    assert layer(good).problem is None
    assert "behind the camera" in (layer(-good).problem or "") and "not finite" in (layer(broken).problem or "")


def test_colours_run_from_zero_to_the_limit():
    assert color_index(np.array([0.0, 0.05, 0.1, 3.0, -1.0, np.nan])).tolist() == [0, 127, 255, 255, 0, 0]
    brightness = color_table().astype(float) @ [0.299, 0.587, 0.114]
    assert len(color_table()) == 256 and (np.diff(brightness) > -2.5).all() and brightness[-1] > 3 * brightness[0]


def test_the_frustum_is_the_image_seen_from_the_origin():
    corners = frustum(CAMERA)
    pixels = corners[:, :2] / corners[:, 2:] * CAMERA.focal + CAMERA.center
    np.testing.assert_allclose(pixels, [(0, 0), (1280, 0), (1280, 720), (0, 720)], atol=1e-9)


def test_the_camera_in_space_is_for_the_whole_clip_without_frames_that_are_thrown_away():
    standing = np.tile(points(), (100, 1, 1))
    standing[:30, :, 1] -= 0.4
    thrown = standing.copy()
    thrown[50] += 40.0
    thrown[51] = np.nan
    whole = extent(thrown)
    np.testing.assert_allclose(whole, extent(standing), atol=1e-6)
    np.testing.assert_allclose(whole[0], standing.min((0, 1)), atol=1e-6)
    space = Space(camera=CAMERA, bodies=(layer(standing[60]),) * 2, extents=(whole, None))
    bounds = space.bounds()
    assert bounds is not None
    both = [np.minimum(whole[0], standing[60].min(0)), np.maximum(whole[1], standing[60].max(0))]
    np.testing.assert_allclose(bounds, both, atol=1e-6)
    assert Space(camera=CAMERA).bounds() is None
