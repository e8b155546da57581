"""A shape from silhouettes: who is stout, and how thick the clothes are."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from jaxtyping import Float

from evaluation.synthetic.studio.rasterize import rasterize
from fitting_core.body.geometry import vertex_normals
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.config.schema import FitConfig
from fitting_core.fit.phases.outlines import OutlinedShape, outlined_shape
from fitting_core.fit.stages import Stages
from fitting_core.measure.mesh.errors import Enclosed
from fitting_core.silhouettes import Silhouettes, silhouette_size
from tests.samples.scenes import CAMERA, keypoints_of, likeliest_shape, random_params

FRAMES = 4
STOUT = np.array([0.2, 0.0, 0.0, 1.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
"""Of the neutral free body, whose fourth column is fatness."""


def standing() -> BodyParams:
    params = random_params(FRAMES, size=0.1)
    place = params.camera_translation * 0 + torch.tensor([0.0, -0.25, 3.4])
    return replace(params, betas=torch.as_tensor(STOUT).expand(FRAMES, 10), camera_translation=place)


def silhouettes_of(body: BodyModel, params: BodyParams, clothes: float | Float[np.ndarray, "V 1"]) -> Silhouettes:
    """Of the mesh, moved outward by the thickness of clothes (metres), which may be of each vertex."""
    size = silhouette_size(CAMERA.size)
    scale = size[0] / CAMERA.size[0]
    small = replace(
        CAMERA, size=size, focal=tuple(scale * f for f in CAMERA.focal), center=tuple(scale * c for c in CAMERA.center)
    )
    packed = []
    for vertices in shared_mesh(body)(params).double().numpy():
        depth = np.full(size[::-1], np.inf)
        rasterize(vertices + clothes * vertex_normals(vertices, body.faces), body.faces, small, depth)
        packed.append(np.packbits(np.isfinite(depth)))
    return Silhouettes.of(packed, size)


def found(body: BodyModel, truth: BodyParams, silhouettes: Silhouettes) -> OutlinedShape | None:
    """From exact keypoints and poses, and a shape as tall as the true one that is not stout at all."""
    lean = likeliest_shape(body, body.height[0] + float(body.height[1] @ STOUT))
    config = FitConfig(pose_prior="axis_angle", silhouettes=True)
    stages = Stages.of(keypoints_of(body, truth), CAMERA, body, config, silhouettes=silhouettes)
    start = stages.parametrisation.from_params(replace(truth, betas=torch.as_tensor(lean).expand(FRAMES, 10)))
    return outlined_shape(stages, stages.all_frames, start)


@pytest.mark.parametrize("clothes", [pytest.param(0.0, marks=pytest.mark.thorough), 0.015])
def test_the_volume_and_the_clothes_are_found(free_body: BodyModel, clothes: float):
    truth = standing()
    shape = found(free_body, truth, silhouettes_of(free_body, truth, clothes))
    assert shape is not None and shape.frames == FRAMES and shape.clothes == pytest.approx(clothes, abs=0.005)
    betas = shape.state.vector[0, -10:].numpy()
    volume = Enclosed.of(free_body.faces)
    true, before, after = (volume(free_body.with_shape(b).template[None])[0] for b in (STOUT, np.zeros(10), betas))
    assert true - before > 20 and abs(after - true) < 0.25 * (true - before)
    # Neither the height nor, with it, the distance follows.
    assert free_body.height[1] @ (betas - STOUT) == pytest.approx(0, abs=0.015)
    assert shape.state.vector[:, -13:-10].numpy() == pytest.approx(truth.camera_translation.numpy(), abs=0.05)


def test_silhouettes_of_somebody_else_do_not_count(free_body: BodyModel):
    truth = standing()
    aside = replace(truth, camera_translation=truth.camera_translation + torch.tensor([0.6, 0.0, 0.0]))
    assert found(free_body, truth, silhouettes_of(free_body, aside, 0.0)) is None
    few = silhouettes_of(free_body, truth, 0.0)
    assert found(free_body, truth, replace(few, known=np.array([True, True, False, False]))) is None
