"""Feet are held where they stand, and never against what the image shows."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core import metrics
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.result import FitResult
from fitting_core.keypoints import Keypoints

FRAMES, RATE = 50, 25.0
CAMERA = Camera(focal=(1000.0, 1000.0), center=(640.0, 360.0), size=(1280, 720), source="given")
SECONDS = (np.arange(FRAMES) - FRAMES / 2) / RATE
ANKLES = [7, 8]
MOTIONS = {
    **{f"glides by {speed} m/s": (np.outer(SECONDS * speed, [0.8, 0, 0.6]), 0.0, 0.0) for speed in (0.1, 0.2, 0.3)},
    **{f"camera pans by {speed} degrees/s": (np.zeros(3), speed, 0.0) for speed in (1.0, 2.0, 4.0)},
    "on a turntable": (np.zeros(3), 0.0, 125.0),
}


def gesturing(way: np.ndarray, pan: float, turn: float) -> BodyParams:
    """Somebody who stands and moves the arms, 4.5 m away, and is carried along a way, or turned, degrees/s."""
    neutral = BodyParams.neutral(FRAMES)
    pose, t = neutral.body_pose.clone(), torch.as_tensor(SECONDS)
    pose[:, 15 * 3 + 2], pose[:, 16 * 3 + 2] = -1.0 + 0.25 * torch.sin(2 * t), 1.0 + 0.3 * torch.sin(1.3 * t)
    pose[:, 17 * 3 + 1], pose[:, 18 * 3 + 1] = -0.5 - 0.4 * torch.sin(1.7 * t), 0.6 + 0.4 * torch.sin(2.3 * t)
    camera = Rotation.from_rotvec(np.radians(pan) * SECONDS[:, None] * [0, 1, 0])
    yaw = Rotation.from_rotvec(np.radians(30 + turn * SECONDS)[:, None] * [0, 1, 0])
    return replace(
        neutral,
        body_pose=pose,
        global_orient=torch.as_tensor((camera * Rotation.from_euler("x", 180, degrees=True) * yaw).as_rotvec()),
        camera_translation=torch.as_tensor(camera.apply(way + np.tile([0, 0.1, 4.5], (FRAMES, 1)))),
    )


def clip_of(body: BodyModel, params: BodyParams) -> Clip:
    """BODY_25 alone, found to a pixel."""
    points, exists = keypoints_in_space(body, params)
    points[:, ~exists, 2] = 1
    xy = project(CAMERA, torch.as_tensor(points)).numpy()
    xy += np.random.default_rng(3).normal(0, 1, xy.shape)
    confidence = np.tile(np.where(exists & (np.arange(len(exists)) < 25), 0.9, 0.0), (FRAMES, 1))
    return Clip(keypoints=Keypoints(xy=xy, confidence=confidence), camera=CAMERA, frame_rate=RATE, name="carried")


def without_held_feet(config: FitConfig) -> FitConfig:
    return replace(config, weights=replace(config.weights, held_position=(0.0,) * 5))


def off_in_image(body: BodyModel, clip: Clip, fit: FitResult) -> float:
    """95th percentile over all keypoints that were found, pixels."""
    points, _ = keypoints_in_space(body, fit.last.params)
    seen = clip.keypoints.confidence[:, :25] > 0
    off = project(CAMERA, torch.as_tensor(points[:, :25])).numpy() - clip.keypoints.xy[:, :25]
    return float(np.percentile(np.linalg.norm(off, axis=-1)[seen], 95))


@pytest.mark.parametrize("motion", MOTIONS)
def test_feet_that_go_on_in_the_image_are_let_go(free_body: BodyModel, motion: str):
    clip = clip_of(free_body, gesturing(*MOTIONS[motion]))
    fits = [fit_clip(clip, free_body, config) for config in (PRESETS["tcfit"], without_held_feet(PRESETS["tcfit"]))]
    held, free = (off_in_image(free_body, clip, fit) for fit in fits)
    assert held <= 1.2 * free
    grounding = fits[0].grounding
    assert grounding is not None and grounding.contacts.let_go.mean() > 0.9 and "goes on in the image" in grounding.text
    assert any("are not held: left 0-49, right 0-49" in warning for warning in fits[0].warnings)


def test_feet_that_stand_are_held(free_body: BodyModel):
    truth = gesturing(np.zeros(3), 0.0, 0.0)
    clip = clip_of(free_body, truth)
    fits = [fit_clip(clip, free_body, config) for config in (PRESETS["tcfit"], without_held_feet(PRESETS["tcfit"]))]
    held, free = (joints_in_space(free_body, fit.last.params)[:, :22] for fit in fits)
    speeds = [np.linalg.norm(np.diff(joints[:, ANKLES], axis=0), axis=-1).mean() * RATE for joints in (held, free)]
    assert speeds[0] < 0.02 and speeds[0] < 0.3 * speeds[1]
    true = joints_in_space(free_body, truth)[:, :22]
    assert metrics.pa_mpjpe(held, true).mean() < metrics.pa_mpjpe(free, true).mean() + 0.5
    assert not fits[0].grounding.contacts.let_go.any() and not any("not held" in w for w in fits[0].warnings)
