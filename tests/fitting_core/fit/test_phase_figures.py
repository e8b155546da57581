"""Figures of a phase: the same however many frames are evaluated together."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.config.schema import PRESETS
from fitting_core.fit import phase_figures
from fitting_core.fit.phase_figures import phase_result
from fitting_core.fit.terms.temporal import REACH
from tests.samples.scenes import arms_in_motion, keypoints_of, noisy, stages_of

FRAMES = 3 * (2 * REACH + 1) + 1


@pytest.mark.parametrize("phase", [1, 2, 3])
def test_a_long_clip_is_evaluated_in_parts(free_body: BodyModel, phase: int, monkeypatch: pytest.MonkeyPatch):
    """With a joint that is locked in one of the parts alone, and a hand that only the last one shows."""
    motion = arms_in_motion(FRAMES)
    keypoints = noisy(keypoints_of(free_body, motion), 3.0)
    keypoints.confidence[:-1, kp.HANDS] = 0
    turn = np.full((*keypoints.confidence.shape, 3), np.nan)
    turn[1, kp.INDEX["left_elbow"]] = 0.1
    stages = stages_of(free_body, replace(keypoints, turn=turn), PRESETS["tcfit"])
    state, some = stages.parametrisation.from_params(motion), torch.tensor([1, 2, FRAMES - 1])
    sample = (state[some], some) if phase == 2 else None
    whole = phase_result(stages, phase, state, seconds=1.0, sample=sample)
    assert whole.objective["locks"] > 0 and len(set(whole.frame_cost.tolist())) == FRAMES
    assert ("temporal" in whole.objective) == (phase == 3)
    for together in (2 * REACH + 1, 1):
        monkeypatch.setattr(phase_figures, "_TOGETHER", together)
        found = phase_result(stages, phase, state, seconds=1.0, sample=sample)
        assert found.objective == pytest.approx(whole.objective, rel=1e-9, abs=1e-12)
        np.testing.assert_allclose(found.frame_cost, whole.frame_cost, rtol=1e-9)
