"""Surfaces: closest points against brute force and trimesh, the vertex-to-surface error, and volumes."""

import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.measure.mesh.closest_point import SurfaceTree
from fitting_core.measure.mesh.errors import Enclosed, closest_rigid, vertex_to_surface
from fitting_core.metrics import Similarity, similarity
from tests.samples.scenes import random_params

STILL = Similarity(rotation=np.eye(3)[None], translation=np.zeros((1, 3)), scale=np.ones(1))


def test_a_larger_ball():
    small, large = (trimesh.creation.icosphere(subdivisions=4, radius=r) for r in (1.0, 1.1))
    tree = SurfaceTree.of(small.vertices, small.faces)
    moved = large.vertices + np.array([0.05, -0.02, 0.03])
    assert vertex_to_surface(moved, tree, STILL).mean() == pytest.approx(0.1, abs=2e-3)


def test_a_body_that_was_moved_rigidly_has_no_error(free_body: BodyModel):
    vertices = Mesh(free_body)(random_params(1))[0].numpy().astype(np.float64)
    turn = Rotation.from_rotvec([0.2, -0.1, 0.15]).as_matrix()
    tree = SurfaceTree.of(vertices, free_body.faces)
    assert vertex_to_surface(vertices @ turn.T + [0.05, 0.02, -0.04], tree, STILL).mean() < 1e-4


def test_it_ends_no_higher_than_plain_icp(free_body: BodyModel):
    """Against 60 rounds of matching and aligning, from the same start and on the same points."""
    one, other = Mesh(free_body)(random_params(2, size=0.15)).numpy().astype(np.float64)
    start = similarity(one[None, ::40], other[None, ::40], scaled=False)
    points, tree = one[::40], SurfaceTree.of(other, free_body.faces)
    rotation, translation = closest_rigid(points, tree, start)
    ours = np.square(tree.closest(points @ rotation.T + translation).distance).mean()
    moved = start(points[None])[0]
    for _ in range(60):
        matched = tree.closest(moved).point
        moved = similarity(moved[None], matched[None], scaled=False)(moved[None])[0]
    plain = np.square(tree.closest(moved).distance).mean()
    before = np.square(tree.closest(start(points[None])[0]).distance).mean()
    assert plain < 0.98 * before and ours < 1.02 * plain


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


def test_a_box():
    box = trimesh.creation.box((0.2, 0.3, 0.5))
    places = np.array([[0, 0, 0], [3.0, -2.0, 9.0]])
    frames = np.stack([box.vertices + place for place in places]).astype(np.float32)
    np.testing.assert_allclose(Enclosed.of(box.faces)(frames), [30, 30], rtol=1e-5)


def test_the_free_body_is_closed_and_measured_as_trimesh_does(free_body: BodyModel):
    enclosed = Enclosed.of(free_body.faces)
    assert not len(enclosed.edges)
    vertices = Mesh(free_body, dtype=torch.float64)(random_params(3)).numpy()
    expected = [1e3 * trimesh.Trimesh(frame, free_body.faces, process=False).volume for frame in vertices]
    np.testing.assert_allclose(enclosed(vertices), expected, rtol=1e-9)
    assert 40 < expected[0] < 120


@pytest.mark.parametrize("lost", [1, 4])
def test_a_body_with_a_hole_has_nearly_the_same_volume(free_body: BodyModel, lost: int):
    vertices = free_body.template[None]
    some = Enclosed.of(free_body.faces[lost:])
    assert len(some.edges)
    np.testing.assert_allclose(some(vertices), Enclosed.of(free_body.faces)(vertices), rtol=1e-3)
