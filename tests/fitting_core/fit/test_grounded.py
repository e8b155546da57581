"""A fit's grounding under its own feet, and feet that are held where they stand, never against what the image shows."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core import metrics
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.grounded import grounding_of_params, holding_feet
from fitting_core.fit.phase_figures import patched
from fitting_core.fit.stages import Stages
from fitting_core.ground.grounding import Grounding
from fitting_core.keypoints import Keypoints
from tests.samples.carried import CARRIED, RATE, Carried, carried_clip, gesturing, pixel_errors

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


# --- held feet ---


LONG = 50
ANKLES = [7, 8]


def without_held_feet(config: FitConfig) -> FitConfig:
    return replace(config, weights=replace(config.weights, held_position=(0.0,) * 5))


@pytest.mark.thorough
@pytest.mark.parametrize("motion", [name for name in CARRIED if name != "standing"])
def test_feet_that_go_on_in_the_image_are_let_go(free_body: BodyModel, motion: str):
    clip = carried_clip(free_body, gesturing(CARRIED[motion], frames=LONG))
    fits = [fit_clip(clip, free_body, config) for config in (PRESETS["tcfit"], without_held_feet(PRESETS["tcfit"]))]
    held, free = (np.percentile(pixel_errors(free_body, fit.last.params, clip), 95) for fit in fits)
    assert held <= 1.2 * free
    grounding = fits[0].grounding
    assert grounding is not None and grounding.contacts.let_go.mean() > 0.9 and "goes on in the image" in grounding.text
    assert any("are not held: left 0-49, right 0-49" in warning for warning in fits[0].warnings)


@pytest.mark.thorough
def test_feet_that_stand_are_held(free_body: BodyModel):
    truth = gesturing(Carried(), frames=LONG)
    clip = carried_clip(free_body, truth)
    fits = [fit_clip(clip, free_body, config) for config in (PRESETS["tcfit"], without_held_feet(PRESETS["tcfit"]))]
    held, free = (joints_in_space(free_body, fit.last.params)[:, :22] for fit in fits)
    speeds = [np.linalg.norm(np.diff(joints[:, ANKLES], axis=0), axis=-1).mean() * RATE for joints in (held, free)]
    assert speeds[0] < 0.02 and speeds[0] < 0.3 * speeds[1]
    true = joints_in_space(free_body, truth)[:, :22]
    assert metrics.pa_mpjpe(held, true).mean() < metrics.pa_mpjpe(free, true).mean() + 0.5
    assert fits[0].grounding is not None
    assert not fits[0].grounding.contacts.let_go.any() and not any("not held" in w for w in fits[0].warnings)


@pytest.mark.thorough
def test_costs_of_frames_that_are_fitted_again_have_held_feet_in_them(free_body: BodyModel):
    """In the middle of a stand, of which they show a part alone: also where nothing has changed."""
    params, window = gesturing(Carried(), frames=LONG), range(20, 24)
    clip, config = carried_clip(free_body, params), PRESETS["tcfit"]
    fit = fit_clip(clip, free_body, config)
    inside = slice(window.start, window.stop)

    def costs(config: FitConfig, params: BodyParams) -> np.ndarray:
        stages = Stages.of_clip(clip, free_body, config)
        held = holding_feet(stages, params, fit.grounding) or stages
        return patched(fit.last, held, params, [window], note="").frame_cost[inside]

    np.testing.assert_allclose(costs(config, fit.last.params), fit.last.frame_cost[inside], rtol=0.02)
    pose = fit.last.params.body_pose.clone()
    pose[inside, 3] -= 0.1  # bends a knee: the foot leaves its place
    moved = replace(fit.last.params, body_pose=pose)

    def rise(config: FitConfig) -> np.ndarray:
        return costs(config, moved) - costs(config, fit.last.params)

    assert (rise(config) > rise(without_held_feet(config)) + 1).all()
