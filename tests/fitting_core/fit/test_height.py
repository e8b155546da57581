"""Height and age: what is said of a person's size decides how far away the fit is."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from evaluation.synthetic.motion_suite.depth_figures import LIMB_JOINTS
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, SolverSettings
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.plausibility import other_height, small_adult
from fitting_core.fit.refitting import refit
from fitting_core.fit.size import height_of
from fitting_core.measure.limbs import limb_pa_mpjpe
from fitting_core.results.fit_result import FitResult
from fitting_core.results.given_start import KnownShape
from fitting_core.shipped import FREE_FOLDER
from tests.samples.posed_clips import clip_of as posed_clip
from tests.samples.posed_clips import motion
from tests.samples.scenes import CAMERA, QUICK, keypoints_of, likeliest_shape, random_params

CONFIG = replace(QUICK, settings=SolverSettings(iterations=30), last_phase=2)
LIFTED = replace(PRESETS["tcfit"], relay_rounds=0, limb_flips=False)


@pytest.fixture(scope="module")
def child() -> BodyModel:
    return load_body(find_body(gender="child", search=FREE_FOLDER))


def heads(body: BodyModel, metres: float) -> float:
    """How many heads, from the chin to the crown, a body of this height has."""
    up = body.with_shape(likeliest_shape(body, metres)).template[:, 1]
    chin = up[body.contour_vertices[0, 8]] @ body.contour_weights[0, 8]
    return metres / float(up.max() - chin)


def distance_share(shown: BodyModel, fitted: BodyModel, metres: float, height: float | None) -> float:
    """Distance of a fit to the true one, of somebody of a height in metres who stands before the camera."""
    params = random_params(2, size=0.1)
    tall = torch.as_tensor(likeliest_shape(shown, metres)).expand(2, 10)
    place = torch.tensor([0.0, 0.2 - 0.25 * metres, 2.3 * metres], dtype=torch.float64).expand(2, 3)
    params = replace(params, betas=tall, camera_translation=place)
    clip = Clip(keypoints=keypoints_of(shown, params), camera=CAMERA, frame_rate=25.0, name="one")
    fit = fit_clip(clip, fitted, replace(CONFIG, height=height))
    return float((fit.last.params.camera_translation[:, 2] / params.camera_translation[:, 2]).mean())


@pytest.mark.thorough
def test_without_a_height_people_of_unusual_height_are_at_a_wrong_distance(free_body: BodyModel, child: BodyModel):
    assert distance_share(free_body, free_body, 1.95, 195.0) == pytest.approx(1, abs=0.03)
    assert distance_share(free_body, free_body, 1.95, None) < 0.95
    assert distance_share(child, free_body, 1.30, None) > 1.1


def test_a_child_is_at_the_right_distance(child: BodyModel):
    assert distance_share(child, child, 1.30, 130.0) == pytest.approx(1, abs=0.03)


@pytest.mark.parametrize("metres, expected", [(0.95, 5.0), (1.15, 5.75), (1.3, 6.3)])
def test_children_have_large_heads_and_likely_shapes(
    free_body: BodyModel, child: BodyModel, metres: float, expected: float
):
    """As children of 3, 6 and 8 years."""
    assert heads(child, metres) == pytest.approx(expected, abs=0.2)
    assert np.linalg.norm(likeliest_shape(child, metres)) < 1.5 < np.linalg.norm(likeliest_shape(free_body, metres))


@pytest.fixture(scope="module")
def of_any_height(free_body: BodyModel) -> FitResult:
    return fit_clip(posed_clip(motion(6)), free_body, LIFTED)


@pytest.mark.parametrize("height", [160.0, 190.0])
def test_a_height_scales_body_and_distance_and_leaves_picture_and_pose(
    free_body: BodyModel, of_any_height: FitResult, height: float
):
    clip = posed_clip(motion(6))
    sized = fit_clip(clip, free_body, replace(LIFTED, height=height))
    for phase in (2, 3):
        before, after = (fit.chosen(phase).params for fit in (of_any_height, sized))
        ratio = float(height / 100 / height_of(free_body, before.betas[0].numpy()))
        assert height_of(free_body, after.betas.numpy()) == pytest.approx(height / 100)
        joints, scaled = (joints_in_space(free_body, each)[:, :22] for each in (before, after))
        away, farther = (np.linalg.norm(each[:, 0], axis=1) for each in (joints, scaled))
        assert farther == pytest.approx(ratio * away, rel=0.005)
        assert np.linalg.norm(scaled / ratio - joints, axis=-1).mean() < 0.012
        assert np.nanmean(limb_pa_mpjpe(scaled[:, LIMB_JOINTS], joints[:, LIMB_JOINTS])) < 4
    # What is fitted again has the same evidence as before, so nothing moves that was not corrected.
    again = refit(clip, free_body, sized, range(2, 4)).last.params
    moved = joints_in_space(free_body, again) - joints_in_space(free_body, sized.last.params)
    assert np.linalg.norm(moved, axis=-1).max() < 0.002


def test_a_height_holds_after_phase_1_alone(free_body: BodyModel):
    fit = fit_clip(posed_clip(motion(2)), free_body, replace(LIFTED, height=185.0, last_phase=1))
    assert height_of(free_body, fit.last.params.betas.numpy()) == pytest.approx(1.85)


def test_an_adult_of_a_childs_height_is_told(free_body: BodyModel, child: BodyModel):
    (told,) = small_adult(free_body, 130.0)
    assert "gender child" in told
    assert small_adult(child, 130.0) == small_adult(free_body, 170.0) == small_adult(free_body, None) == ()


def test_a_shape_of_another_height_is_told(free_body: BodyModel):
    shape = KnownShape(betas=likeliest_shape(free_body, 1.65), source="a.json")
    assert other_height(free_body, shape, 172.0) == (
        "the shape of a.json is 165 cm tall, not 172 as stated: the shape is used",
    )
    assert other_height(free_body, shape, 166.0) == other_height(free_body, shape, None) == ()
