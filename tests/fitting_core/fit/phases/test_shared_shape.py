"""Phase 2: which frames are sampled, and what their shape minimises."""

from dataclasses import replace

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.config.schema import FitConfig, ShapeSample, SolverSettings, Weights
from fitting_core.fit.phases.shared_shape import STRATEGIES, Sight, fit_shape, sample_frames
from fitting_core.fit.solvers import make_solver
from tests.samples.scenes import finished, hidden, keypoints_of, random_params, random_state, stages_of


@given(
    frames=st.integers(1, 60),
    size=st.integers(1, 20),
    seed=st.integers(0, 1000),
    strategy=st.sampled_from(sorted(STRATEGIES)),
)
def test_samples_are_frames_of_the_clip_each_once(frames: int, size: int, seed: int, strategy: str):
    confidence = np.random.default_rng(seed).random((frames, 25))
    sample = ShapeSample(size=size, strategy=strategy, seed=seed)  # pyright: ignore
    chosen = sample_frames(confidence, sample)
    assert len(chosen) == min(size, frames)
    assert len(set(chosen.tolist())) == len(chosen) and list(chosen) == sorted(chosen)
    assert chosen.min() >= 0 and chosen.max() < frames
    assert np.array_equal(chosen, sample_frames(confidence, sample))


def test_coverage_shows_every_part_though_few_frames_do():
    """Legs are seen in frame 13 alone, and at low confidence."""
    confidence = np.zeros((40, 25))
    confidence[:, :8] = 0.9
    confidence[13, 9:15] = 0.4
    chosen = sample_frames(confidence, ShapeSample(size=4, strategy="coverage"))
    assert 13 in chosen
    assert np.diff(chosen).min() > 40 // (2 * 4)


CONFIG = FitConfig(
    weights=replace(Weights(), shape=(0.01,) * 5, collision=(0.0,) * 5, body_pose=(1.0,) * 5, bending=(0.1,) * 5),
    hip_weight=1.0,
    shape_sample=ShapeSample(size=4, stages=(5,)),
    settings=SolverSettings(iterations=80, final_tolerance=1e-10),
)


def test_one_shape_for_all_sampled_frames(tiny_body: BodyModel):
    truth = random_params(6, 2, size=0.15)
    truth = replace(truth, betas=truth.betas[:1].expand(6, 10))
    stages = stages_of(tiny_body, hidden(keypoints_of(tiny_body, truth), kp.HANDS, kp.FACE), CONFIG)
    betas = stages.parametrisation.columns.betas
    spread = random_state(stages.parametrisation, 6, 9).vector[:, betas]
    start = stages.parametrisation.from_params(truth).with_columns(betas, spread)
    sight = Sight(stages=stages, state=start, usable=torch.arange(6))
    sampled = finished(fit_shape(sight, make_solver("lm", CONFIG.settings), CONFIG.shape_sample))
    found = sampled.state.vector[:, betas]
    assert len(sampled.frames) == 4 and torch.equal(found, found[:1].expand(4, 10))
    assert not torch.allclose(found[0], spread[sampled.frames].mean(0), atol=0.05)
