"""A fit's grounding: under its own feet, from keypoints that the image does not cut off."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.fit.grounded import grounding_of_params
from fitting_core.fit.stages import Stages
from fitting_core.ground.grounding import Grounding
from fitting_core.keypoints import Keypoints

FRAMES = 30
CAMERA = Camera(focal=(900.0, 900.0), center=(320.0, 240.0), size=(640, 480), source="given")


@pytest.fixture(scope="module")
def standing(free_body: BodyModel) -> BodyParams:
    """Somebody who stands before a level camera and sways a little."""
    neutral = BodyParams.neutral(FRAMES)
    facing = Rotation.from_euler("x", 180, degrees=True) * Rotation.from_euler("y", 30, degrees=True)
    pose = neutral.body_pose.clone()
    pose[:, 15 * 3 + 2], pose[:, 16 * 3 + 2] = -1.1, 1.1  # arms down
    pose[:, 2 * 3] = 0.03 * torch.sin(torch.arange(FRAMES) / 5)
    orient = torch.as_tensor(facing.as_rotvec()).expand(FRAMES, 3).clone()
    place = torch.tensor([0.0, 0.0, 5.0], dtype=torch.float64).expand(FRAMES, 3)
    return replace(neutral, body_pose=pose, global_orient=orient, camera_translation=place)


def clip_of(body: BodyModel, params: BodyParams, camera: Camera = CAMERA) -> Clip:
    points, exists = keypoints_in_space(body, params)
    points[:, ~exists, 2] = 1
    xy = project(camera, torch.as_tensor(points)).numpy()
    confidence = np.tile(np.where(exists, 0.9, 0.0), (FRAMES, 1))
    return Clip(keypoints=Keypoints(xy=xy, confidence=confidence), camera=camera, frame_rate=30.0, name="stands")


def grounding(clip: Clip, body: BodyModel, params: BodyParams) -> Grounding | None:
    return grounding_of_params(Stages.of_clip(clip, body, FitConfig()), params)


def test_the_floor_is_under_the_soles(free_body: BodyModel, standing: BodyParams):
    clip = clip_of(free_body, standing)
    lower = replace(standing, camera_translation=standing.camera_translation + torch.tensor([0.0, 0.3, 0.0]))
    offsets = []
    for last in (standing, lower):
        found = grounding(clip, free_body, last)
        assert found is not None and found.ground is not None and found.contacts.share == 1
        assert found.gravity.up[1] < -0.9
        lowest = found.ground.height(Mesh(free_body)(last).double().numpy()).min()
        assert abs(lowest) < 0.04
        offsets.append(found.ground.offset)
    assert offsets[1] - offsets[0] == pytest.approx(0.3, abs=0.03)


def test_feet_that_the_image_cuts_off_carry_nothing(free_body: BodyModel, standing: BodyParams):
    """Detectors put them onto the border, with some confidence."""
    clip = clip_of(free_body, standing)
    feet = clip.keypoints.xy[:, :25, 1] > np.median(clip.keypoints.xy[:, [11, 14], 1]) - 5
    height = int(np.median(clip.keypoints.xy[:, [11, 14], 1]) - 10)
    xy = clip.keypoints.xy.copy()
    xy[:, :25, 1] = np.where(feet, height - 1, xy[:, :25, 1])
    cut = replace(clip, keypoints=replace(clip.keypoints, xy=xy), camera=replace(CAMERA, size=(640, height)))
    found = grounding(cut, free_body, standing)
    assert found is not None and found.ground is None and not found.contacts.seen.any()
    assert found.missing == "the feet are not in the image"


def test_a_body_without_points_of_its_feet_has_no_grounding(free_body: BodyModel, standing: BodyParams):
    rest = {name: vertex for name, vertex in free_body.surface_keypoints.items() if "toe" not in name}
    footless = replace(free_body, surface_keypoints=rest)
    assert grounding(clip_of(free_body, standing), footless, standing) is None
