"""Motions of the tiny and of the free body for tests of what is written of them."""

from dataclasses import replace

import numpy as np
import torch

from fitting_core.body.model import BodyModel
from fitting_core.camera import Camera
from fitting_core.motion import Motion
from tests.samples import posed_clips

CAMERA = Camera(focal=(900.0, 910.0), center=(310.0, 250.0), size=(640, 480), source="as given")


def swinging(body: BodyModel, frames: int = 7, *, amplitude: float = 0.4) -> Motion:
    """A person who moves all joints, the root's more than half a turn, with a face that moves."""
    params = posed_clips.motion(frames, amplitude=amplitude)
    draw = torch.Generator().manual_seed(3)
    turning = torch.linspace(0.4, 4.0, frames, dtype=torch.float64)[:, None] * torch.tensor([[0.2, 0.96, -0.2]])
    params = replace(
        params,
        global_orient=turning.double(),
        jaw_pose=torch.linspace(0, 0.3, frames, dtype=torch.float64)[:, None] * torch.tensor([[1.0, 0.1, 0.0]]),
        expression=torch.randn(frames, 10, generator=draw, dtype=torch.float64),
    )
    return Motion(body=body, params=params, camera=CAMERA, frame_rate=29.97, name="swing", first_frame=12)


def meshes(motion: Motion) -> np.ndarray:
    """All vertices of all frames, (T, V, 3)."""
    return np.stack(list(motion.vertices()))
