"""Clips made from a known motion of the shipped body: keypoints projected, with noise and gaps if wanted."""

from dataclasses import replace
from functools import cache

import numpy as np
import torch

from fitting_core import keypoints as kp
from fitting_core.body.files.reading import load_body
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.fit.stages import Stages
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.shipped import FREE_FOLDER

CAMERA = Camera(focal=(1000.0, 1000.0), center=(500.0, 500.0), size=(1000, 1000))


@cache
def shipped_body() -> BodyModel:
    """The free neutral body, read once."""
    return load_body(FREE_FOLDER / "SMPLX_NEUTRAL.npz")


def motion(frames: int, *, seed: int = 0, amplitude: float = 0.2) -> BodyParams:
    """A person in front of the camera whose joints swing smoothly by about `amplitude` radians."""
    draw = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=draw, dtype=torch.float64)

    phase = torch.linspace(0, 1, frames, dtype=torch.float64)[:, None]
    still = BodyParams.neutral(frames)
    orient = torch.tensor([np.pi, 0.0, 0.0], dtype=torch.float64).expand(frames, 3)
    return replace(
        still,
        betas=(0.5 * random(1, 10)).expand(frames, 10),
        global_orient=orient,
        body_pose=amplitude * (random(1, 63) + phase * random(1, 63)),
        left_hand_pose=0.2 * random(1, 12).expand(frames, 12),
        right_hand_pose=0.2 * random(1, 12).expand(frames, 12),
        camera_translation=torch.tensor([0.05, 0.2, 3.5], dtype=torch.float64) + 0.1 * phase * random(1, 3),
    )


def clip_of(params: BodyParams, *, noise: float = 0.0, groups: tuple[slice, ...] = (kp.BODY,), seed: int = 0) -> Clip:
    """What a detector with this noise (pixels, normal) would see of the motion; only these groups of keypoints."""
    blank = kp.Keypoints(xy=np.zeros((len(params), kp.COUNT, 2)), confidence=np.ones((len(params), kp.COUNT)))
    stages = Stages.of(blank, CAMERA, shipped_body(), FitConfig(pose_prior="axis_angle"))  # which holds every pose
    state = stages.parametrisation.from_params(params)
    known = torch.tensor([i for i, p in enumerate(stages.fitted.keypoint_points) if p is not None])
    view = stages.view(known, state)
    xy, confidence = blank.xy.copy(), np.zeros_like(blank.confidence)
    xy[:, known] = Estimate(view, state, stages.all_frames).pixels.numpy()
    xy += noise * np.random.default_rng(seed).standard_normal(xy.shape)
    for group in groups:
        confidence[:, group] = 1
    confidence[:, [i for i in range(kp.COUNT) if i not in known]] = 0
    return Clip(
        keypoints=kp.Keypoints(xy=xy, confidence=confidence), camera=CAMERA, frame_rate=30.0, name="posed motion"
    )
