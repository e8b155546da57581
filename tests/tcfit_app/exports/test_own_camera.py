"""A run with a focal length of its own lies on the video as its own camera sees it."""

import numpy as np
import torch

from fitting_core.camera import Camera, project
from tcfit_app.review.scene.poster import relief
from tests.samples.posters import pixels_of_world

CLIP = Camera(focal=(900.0, 940.0), center=(410.0, 395.0), size=(800, 780))
OWN = Camera(focal=(1300.0, 1250.0), center=(400.0, 401.0), size=(800, 780))
BODY = np.random.default_rng(0).uniform((-0.8, -0.9, 2.0), (0.8, 0.9, 4.0), (50, 3))


def _pixels(camera: Camera, vertices: np.ndarray) -> np.ndarray:
    return project(camera, torch.as_tensor(vertices)).numpy()


def test_posters_use_the_camera_of_each_body():
    one, other = relief([BODY, BODY], CLIP, [OWN, None])
    assert np.allclose(pixels_of_world(one[:, :2], CLIP.size), _pixels(OWN, BODY), atol=1e-3)
    assert np.allclose(pixels_of_world(other[:, :2], CLIP.size), _pixels(CLIP, BODY), atol=1e-3)
