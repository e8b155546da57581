"""Keypoints sharper than a detector's: when the data term is raised, by how much, and what it brings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig, SolverSettings
from fitting_core.fit.fitting import fit_clip, rerun_events
from fitting_core.fit.phases.search import sharp_frames, sharpening
from fitting_core.fit.phases.search.sharpening import (
    LEVELS,
    NOISE,
    astray,
    misfits,
    residuals,
    sharpness,
    tells_noise,
    warrants,
)
from fitting_core.fit.stages import N_STAGES
from fitting_core.keypoints import Keypoints
from fitting_core.priors.files.network_file import write_network
from fitting_core.priors.loosened import Loosened
from tests.fitting_core.priors.networks import random_network
from tests.samples.scenes import CAMERA, arms_in_motion, finished, hidden, keypoints_of, stages_of

FRAMES = 3
CONFIG = FitConfig(
    weights=replace(PRESETS["tcfit"].weights, limits=(0.0,) * 5),
    pose_prior="relaxed",
    hip_weight=1.0,
    yaws="four",
    sharper_keypoints=True,
    settings=SolverSettings(iterations=30),
)


def noisy(keypoints: Keypoints, pixels: float) -> Keypoints:
    return replace(keypoints, xy=keypoints.xy + np.random.default_rng(0).normal(0, pixels, keypoints.xy.shape))


@pytest.fixture(scope="module")
def exact(free_body: BodyModel) -> Keypoints:
    return keypoints_of(free_body, arms_in_motion(FRAMES, depth=3.5))


def clip_of(keypoints: Keypoints) -> Clip:
    return Clip(keypoints=keypoints, camera=CAMERA, frame_rate=25.0, name="arms")


@pytest.mark.parametrize("level", LEVELS)
def test_a_level_is_warranted_by_noise_of_its_own_weight(level: float):
    """Weight = 1 / noise^2."""
    limit = NOISE / level**0.5
    assert warrants(torch.tensor([0.9 * limit, 0.5 * limit, 99.0]), level)
    assert not warrants(torch.tensor([1.1 * limit, 0.0, 99.0, torch.nan]), level)


def test_frames_are_astray_beside_others():
    residual = torch.tensor([0.1, 0.1, 0.12, 0.4, torch.nan])
    assert astray(residual, LEVELS[0]).tolist() == [False, False, False, True, False]
    assert astray(torch.full((3,), 2 * NOISE), 1.0).all()


def test_residual_is_that_of_an_image_1000_high(free_body: BodyModel, exact: Keypoints):
    stages = stages_of(free_body, replace(exact, xy=exact.xy + np.array([3.0, 4.0])), CONFIG)
    state = stages.parametrisation.from_params(arms_in_motion(FRAMES, depth=3.5))
    expected = torch.full((FRAMES,), 5.0 * 1000 / CAMERA.size[1], dtype=torch.float64)
    torch.testing.assert_close(residuals(stages, state), expected)
    assert sharpness(stages, state) == 1


def test_one_hand_that_is_off_shows_in_the_misfit(free_body: BodyModel, exact: Keypoints):
    """A typical keypoint of both hands does not tell: half of one hand is a quarter of them."""
    xy = exact.xy.copy()
    xy[1, kp.LEFT_HAND.start : kp.LEFT_HAND.start + 10] += 8.0
    stages = stages_of(free_body, replace(exact, xy=xy), CONFIG)
    state = stages.parametrisation.from_params(arms_in_motion(FRAMES, depth=3.5))
    assert float(residuals(stages, state).max()) < 1e-6
    root = (10 / 21 * 2 * 8.0**2) ** 0.5 * 1000 / CAMERA.size[1]
    torch.testing.assert_close(misfits(stages, state), torch.tensor([0.0, root, 0.0]).double(), rtol=1e-6, atol=1e-6)
    assert astray(misfits(stages, state), LEVELS[1]).tolist() == [False, True, False]


def test_a_head_in_the_wrong_contour_table_finds_its_own(
    free_body: BodyModel, exact: Keypoints, monkeypatch: pytest.MonkeyPatch
):
    """The fit of the table beside the right one turns the head, until the table is its own."""
    stages, frame = stages_of(free_body, exact, CONFIG).sharpened(1000.0), torch.tensor([1])
    truth = stages.parametrisation.from_params(arms_in_motion(FRAMES, depth=3.5))
    objective = stages.objective(N_STAGES, truth, stages.free(N_STAGES, betas=True))
    right, beside = (o.costs(truth[frame], frame)["data"] for o in (objective, objective.with_contour(1)))
    assert float(right) < 1e-9 < 10 < float(beside)
    monkeypatch.setattr(sharp_frames, "astray", lambda misfit, level: torch.ones_like(misfit, dtype=torch.bool))
    at = sharp_frames.Sharpened(stages)
    stuck, before = finished(at.descend(truth, frame, contour=1))
    _, cost = finished(at.other_contours(stuck, before, frame))
    assert float(cost[1]) < 0.99 * float(before[1])
    assert float(cost[1]) <= 1.001 * float(finished(at.descend(truth, frame))[1][1])


def test_sharpened_stages_weigh_the_data_alone_more(free_body: BodyModel, exact: Keypoints):
    stages = stages_of(free_body, exact, CONFIG)
    state = stages.parametrisation.neutral(FRAMES).with_columns(
        stages.parametrisation.columns.translation, torch.tensor([0.0, 0.0, 3.0], dtype=torch.float64)
    )
    free = stages.free(N_STAGES, betas=True)
    before, after = (s.objective(N_STAGES, state, free).costs(state, stages.all_frames)
                     for s in (stages, stages.sharpened(7.0)))  # fmt: skip
    for name, cost in before.items():
        torch.testing.assert_close(after[name], (7.0 if name == "data" else 1.0) * cost)


def test_a_latent_prior_is_loosened(free_body: BodyModel, exact: Keypoints, tmp_path: Path):
    write_network(tmp_path / "prior.npz", random_network(size=9, hidden=16))
    stages = stages_of(free_body, exact, replace(CONFIG, pose_prior=str(tmp_path / "prior.npz")))
    sharp = stages.sharpened(10.0)
    assert isinstance(sharp.parametrisation.prior, Loosened)
    state = stages.parametrisation.from_params(arms_in_motion(FRAMES, depth=3.5))
    kept = sharp.parametrisation.received(state)
    for before, after in zip(
        vars(stages.parametrisation.to_params(state)).values(),
        vars(sharp.parametrisation.to_params(kept)).values(),
        strict=True,
    ):
        torch.testing.assert_close(before, after)


@pytest.fixture(scope="module")
def found(free_body: BodyModel, exact: Keypoints) -> BodyParams:
    """From exact keypoints, up to the first two levels: the others take a minute."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sharp_frames, "LEVELS", LEVELS[:2])
        return fit_clip(clip_of(exact), free_body, CONFIG).last.params


def missed(body: BodyModel, keypoints: Keypoints, params: BodyParams) -> float:
    stages = stages_of(body, keypoints, CONFIG)
    return float(residuals(stages, stages.parametrisation.from_params(params)).median())


def test_exact_keypoints_are_reproduced_more_exactly(free_body: BodyModel, exact: Keypoints, found: BodyParams):
    blunt = fit_clip(clip_of(exact), free_body, replace(CONFIG, sharper_keypoints=False)).last.params
    assert missed(free_body, exact, found) < 0.3 * missed(free_body, exact, blunt)


def test_keypoints_of_the_body_alone_tell_no_noise(free_body: BodyModel, exact: Keypoints):
    assert tells_noise(stages_of(free_body, exact, CONFIG))
    assert not tells_noise(stages_of(free_body, hidden(exact, kp.HANDS, kp.FACE), CONFIG))


def test_noisy_keypoints_change_nothing(free_body: BodyModel, exact: Keypoints):
    rough = clip_of(noisy(exact, 4.0))
    plain = replace(CONFIG, sharper_keypoints=False)
    poses = (fit_clip(rough, free_body, replace(c, last_phase=1)).last.params.body_pose for c in (CONFIG, plain))
    torch.testing.assert_close(*poses, rtol=0, atol=0)


def test_a_rerun_is_as_sharp(free_body: BodyModel, exact: Keypoints, found: BodyParams):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sharpening, "LEVELS", LEVELS[:2])
        again = finished(rerun_events(clip_of(exact), free_body, CONFIG, found, range(FRAMES)))
    assert missed(free_body, exact, again) < 1.1 * missed(free_body, exact, found)
