"""Closest points of a mesh, against brute force and against trimesh."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.measure.mesh.closest_point import SurfaceTree
from tests.samples.scenes import random_params


def brute_force(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Distance of each point from all triangles, one at a time, by trimesh's routine for pairs."""
    found = [
        np.linalg.norm(trimesh.triangles.closest_point(vertices[faces], np.tile(p, (len(faces), 1))) - p, axis=1).min()
        for p in points
    ]
    return np.array(found)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 200), spread=st.sampled_from([0.01, 0.3, 2.0]))
def test_triangles_in_disorder(seed: int, count: int, spread: float):
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(3 * count, 3)) * spread + rng.normal(size=3)
    faces = rng.integers(0, 3 * count, (count, 3))
    faces = faces[(np.diff(np.sort(faces, 1), axis=1) > 0).all(1)]
    if not len(faces):
        return
    points = rng.normal(size=(30, 3))
    found = SurfaceTree.of(vertices, faces).closest(points)
    np.testing.assert_allclose(found.distance, brute_force(points, vertices, faces), atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(points - found.point, axis=1), found.distance, atol=1e-12)


def test_a_posed_body_in_another_pose_than_its_tree(free_body: BodyModel):
    vertices = Mesh(free_body)(random_params(2)).numpy().astype(np.float64)
    tree = SurfaceTree.of(free_body.template, free_body.faces).moved(vertices[0])
    points = vertices[1][::3000]
    np.testing.assert_allclose(
        tree.closest(points).distance, brute_force(points, vertices[0], free_body.faces), atol=1e-7
    )


@pytest.mark.parametrize("point", [(0.0, 0, 2), (5, 0, 0), (-1, 0.5, 0), (0.5, 0, 0)])
def test_triangles_without_area(point: tuple[float, float, float]):
    """A triangle that is a line from 0 to 1 along x: the distance from that line."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0, 0]])
    found = SurfaceTree.of(vertices, np.array([[0, 1, 2]])).closest(np.array([point]))
    x, y, z = point
    expected = np.linalg.norm([x - np.clip(x, 0, 1), y, z])
    np.testing.assert_allclose(found.distance, expected, atol=1e-9)
