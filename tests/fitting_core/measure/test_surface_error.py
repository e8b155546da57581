"""The vertex-to-surface error on shapes whose error is known."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.measure.mesh.closest_point import SurfaceTree
from fitting_core.measure.mesh.errors import closest_rigid, vertex_to_surface
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
