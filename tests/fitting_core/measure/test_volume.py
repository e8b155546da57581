"""The volume of meshes."""

import numpy as np
import pytest
import torch
import trimesh

from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.measure.mesh.errors import Enclosed
from tests.samples.scenes import random_params


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
