"""Vertices for the views."""

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from tcfit_app.analysis.meshes import Meshes
from tests.samples.scenes import random_params


@pytest.fixture
def meshes(tiny_body: BodyModel) -> Meshes:
    return Meshes(tiny_body)


def test_one_frame_is_that_of_the_batch(meshes: Meshes):
    params = random_params(35)
    together = meshes.batch(params)
    assert len(together) == len(params)
    for frame in (0, 15, 16, len(params) - 1):
        np.testing.assert_allclose(meshes.vertices("a", params, frame), together[frame], rtol=0, atol=1e-6)


def test_a_version_is_evaluated_once_and_cannot_be_written(meshes: Meshes):
    first, second = random_params(2, seed=1), random_params(2, seed=2)
    vertices = meshes.vertices("run 1", first, 1)
    assert meshes.vertices("run 1", second, 1) is vertices, "the same version stands for the same parameters"
    assert abs(meshes.vertices("run 2", second, 1) - vertices).max() > 0.01
    with pytest.raises(ValueError, match="read-only"):
        vertices[0] = 0


def test_memory_is_limited(tiny_body: BodyModel):
    size = 12 * len(tiny_body.template)
    meshes, params = Meshes(tiny_body, limit=3 * size), random_params(5)
    found = [meshes.vertices("a", params, frame) for frame in range(5)]
    assert [meshes.vertices("a", params, frame) is found[frame] for frame in (4, 3, 2)] == [True] * 3
    assert meshes.vertices("a", params, 0) is not found[0]
    assert all(vertices.base is None or vertices.base.nbytes == size for vertices in found)
