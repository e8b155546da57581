"""The software rasterizer against exact intersections of rays."""

import numpy as np
import trimesh

from evaluation.synthetic.studio.rasterize import Fragments, rasterize
from fitting_core.camera import Camera

CAMERA = Camera(focal=(310.0, 290.0), center=(95.5, 40.25), size=(160, 120))
SPHERE = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
FACES = np.asarray(SPHERE.faces)
CENTER = np.array([-0.12, 0.21, 2.0])


def buffer() -> np.ndarray:
    return np.full(CAMERA.size[::-1], np.inf)


def draw(vertices: np.ndarray, faces: np.ndarray) -> tuple[Fragments, np.ndarray]:
    depth = buffer()
    return rasterize(vertices, faces, CAMERA, depth), depth


def pixel_rays() -> np.ndarray:
    x, y = np.meshgrid(np.arange(160) + 0.5, np.arange(120) + 0.5)
    flat = (np.stack([x, y], -1) - CAMERA.center) / CAMERA.focal
    return np.concatenate([flat, np.ones((120, 160, 1))], -1)


def sphere() -> np.ndarray:
    return np.asarray(SPHERE.vertices) + CENTER


def convex_depth(vertices: np.ndarray) -> np.ndarray:
    """Entry depth of each pixel's ray into the convex polyhedron, by its planes; infinite where it misses."""
    a, b, c = (vertices[FACES[:, k]] for k in range(3))
    outward = np.cross(b - a, c - a)
    slope = pixel_rays() @ outward.T
    at = (outward * a).sum(1) / slope
    enter = np.where(slope < 0, at, -np.inf).max(-1)
    leave = np.where(slope > 0, at, np.inf).min(-1)
    return np.where(enter < leave, enter, np.inf)


def test_depth_of_a_polyhedron_is_exact_in_every_pixel() -> None:
    expected = convex_depth(sphere())
    _, depth = draw(sphere(), FACES)
    assert np.isfinite(expected).sum() > 5000
    np.testing.assert_allclose(depth, expected, rtol=1e-5)


def test_weights_rebuild_the_point_in_space() -> None:
    fragments, _ = draw(sphere(), FACES)
    points = fragments.interpolate(FACES, sphere())
    rays = pixel_rays().reshape(-1, 3)[fragments.pixel]
    np.testing.assert_allclose(points, rays * fragments.depth[:, None], atol=1e-4)
    np.testing.assert_allclose(fragments.weights.sum(1), 1.0, atol=1e-6)


def test_a_second_mesh_shows_only_where_it_is_nearer() -> None:
    near, depth = sphere(), buffer()
    rasterize(near, FACES, CAMERA, depth)
    before = depth.copy()
    wall = np.array([[-9.0, -9.0, 2.0], [9.0, -9.0, 2.0], [0.0, 20.0, 2.0]])
    fragments = rasterize(wall, np.array([[0, 2, 1]]), CAMERA, depth)
    shown = np.zeros(depth.size, bool)
    shown[fragments.pixel] = True
    np.testing.assert_array_equal(shown.reshape(depth.shape), before > 2.0)
    np.testing.assert_allclose(depth, np.minimum(before, 2.0), rtol=1e-6)
