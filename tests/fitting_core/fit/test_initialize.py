"""Where fits start: depth from similar triangles, gaps, anchored translation, and which frames are side views."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.config.schema import FitConfig
from fitting_core.fit.phases.initialize import (
    guess_depth,
    seen_from_side,
    starting_state,
)
from fitting_core.fit.stages import Stages
from fitting_core.keypoints import Keypoints
from tests.samples.scenes import FACING, hidden, keypoints_of, stages_of

CAMERA = Camera(focal=(1000.0, 1000.0), center=(400.0, 400.0), size=(800, 800))
DEPTHS = torch.tensor([2.5, 4.0, 8.0], dtype=torch.float64)
HIPS = [kp.INDEX["left_hip"], kp.INDEX["right_hip"], kp.INDEX["mid_hip"]]


def standing(yaw: float = 0.0) -> BodyParams:
    """The mean body upright at three depths, off the image's centre."""
    turn = rotations.exp(FACING) @ rotations.yaw(yaw, FACING)
    place = torch.stack([torch.tensor([0.3, -0.1, float(z)]) for z in DEPTHS]).double()
    return replace(BodyParams.neutral(3), global_orient=rotations.log(turn).expand(3, 3), camera_translation=place)


def stages_for(body: BodyModel, keypoints: Keypoints) -> Stages:
    return stages_of(body, keypoints, FitConfig(), camera=CAMERA)


def test_depth_from_the_torso(tiny_body: BodyModel):
    """Shoulders and hips of a person who faces the camera lie nearly in one plane: the guess is good to 2 %."""
    stages = stages_for(tiny_body, keypoints_of(tiny_body, standing(), CAMERA))
    guess = guess_depth(stages)
    torch.testing.assert_close(guess.depth, DEPTHS, rtol=0.02, atol=0)
    assert guess.from_torso.all() and not guess.from_limbs.any()
    assert guess.note() == "depth was first guessed from the torso in 3 frames"


def test_without_hips_the_limbs_tell(tiny_body: BodyModel):
    keypoints = hidden(keypoints_of(tiny_body, standing(), CAMERA), *HIPS, frames=slice(1, 2))
    guess = guess_depth(stages_for(tiny_body, keypoints))
    torch.testing.assert_close(guess.depth, DEPTHS, rtol=0.05, atol=0)
    assert guess.from_torso.tolist() == [True, False, True] and guess.from_limbs.tolist() == [False, True, False]
    assert "shoulders and limbs in 1 (hips not seen)" in guess.note()


def test_foreshortened_limbs_do_not_push_the_body_away(tiny_body: BodyModel):
    """Of several limbs the one least foreshortened counts: turned by 60 degrees shoulders look half as wide."""
    keypoints = hidden(keypoints_of(tiny_body, standing(60.0), CAMERA), *HIPS)
    torch.testing.assert_close(guess_depth(stages_for(tiny_body, keypoints)).depth, DEPTHS, rtol=0.15, atol=0)


def test_frames_without_edges_take_their_neighbours_depth(tiny_body: BodyModel):
    keypoints = hidden(keypoints_of(tiny_body, standing(), CAMERA), slice(None), frames=slice(1, 2))
    guess = guess_depth(stages_for(tiny_body, keypoints))
    assert float(guess.depth[1]) == pytest.approx(float(guess.depth[0] + guess.depth[2]) / 2)
    assert "neighbouring frames in 1" in guess.note()


@pytest.mark.parametrize("yaw", [0.0, 90.0, 180.0, 270.0])
def test_start_is_upright_turned_and_on_its_keypoints(tiny_body: BodyModel, yaw: float):
    keypoints = keypoints_of(tiny_body, standing(yaw), CAMERA)
    stages = stages_for(tiny_body, keypoints)
    state = starting_state(stages, DEPTHS, yaw)
    up, forward = state.orient[:, :, 1], state.orient[:, :, 2]
    torch.testing.assert_close(up, torch.tensor([0.0, -1, 0]).double().expand(3, 3), rtol=0, atol=1e-12)
    angle = np.radians(yaw)  # facing the camera is -z; turned by 90 degrees about its own up axis it looks to +x
    expected = torch.tensor([np.sin(angle), 0, -np.cos(angle)]).expand(3, 3)
    torch.testing.assert_close(forward, expected, rtol=0, atol=1e-12)
    start = stages.parametrisation.to_params(state)
    torch.testing.assert_close(start.camera_translation[:, 2], DEPTHS)
    joints = Mesh(tiny_body, dtype=torch.float64).joints(start)[:, JOINT["spine3"]]
    truth = Mesh(tiny_body, dtype=torch.float64).joints(standing(yaw))[:, JOINT["spine3"]]
    assert float((joints - truth)[:, :2].norm(dim=1).max()) < 0.06


@pytest.mark.parametrize(
    ("yaw", "expected"), [(0.0, False), (40.0, False), (85.0, True), (-90.0, True), (180.0, False)]
)
def test_side_views_at_any_size(tiny_body: BodyModel, yaw: int, expected: bool):
    """Near or far: it is the shoulders' width against the torso that counts, not pixels."""
    stages = stages_for(tiny_body, keypoints_of(tiny_body, standing(float(yaw)), CAMERA))
    assert seen_from_side(stages).tolist() == [expected] * 3
