"""Figures of a phase: as computed by hand, and the same however many frames are evaluated together."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.config.schema import PRESETS
from fitting_core.fit import phase_figures
from fitting_core.fit.phase_figures import evaluate_objective, phase_result
from fitting_core.fit.terms.temporal import REACH
from tests.samples.posed_clips import clip_of, motion, shipped_body
from tests.samples.scenes import arms_in_motion, keypoints_of, noisy, stages_of

FRAMES, STILL = 3 * (2 * REACH + 1) + 1, 3


@pytest.mark.parametrize("phase", [1, 2, 3])
def test_a_long_clip_is_evaluated_in_parts(free_body: BodyModel, phase: int, monkeypatch: pytest.MonkeyPatch):
    """With a joint that is locked in one of the parts alone, and a hand that only the last one shows."""
    moving = arms_in_motion(FRAMES)
    keypoints = noisy(keypoints_of(free_body, moving), 3.0)
    keypoints.confidence[:-1, kp.HANDS] = 0
    turn = np.full((*keypoints.confidence.shape, 3), np.nan)
    turn[1, kp.INDEX["left_elbow"]] = 0.1
    stages = stages_of(free_body, replace(keypoints, turn=turn), PRESETS["tcfit"])
    state, some = stages.parametrisation.from_params(moving), torch.tensor([1, 2, FRAMES - 1])
    sample = (state[some], some) if phase == 2 else None
    whole = phase_result(stages, phase, state, seconds=1.0, sample=sample)
    assert whole.objective["locks"] > 0 and len(set(whole.frame_cost.tolist())) == FRAMES
    assert ("temporal" in whole.objective) == (phase == 3)
    for together in (2 * REACH + 1, 1):
        monkeypatch.setattr(phase_figures, "_TOGETHER", together)
        found = phase_result(stages, phase, state, seconds=1.0, sample=sample)
        assert found.objective == pytest.approx(whole.objective, rel=1e-9, abs=1e-12)
        np.testing.assert_allclose(found.frame_cost, whole.frame_cost, rtol=1e-9)


def still() -> BodyParams:
    """A person at rest who looks into the camera."""
    params = motion(STILL, amplitude=0.0)
    return replace(
        params,
        camera_translation=params.camera_translation[:1].expand(STILL, 3),
        betas=0 * params.betas,
        left_hand_pose=0 * params.left_hand_pose,
        right_hand_pose=0 * params.right_hand_pose,
    )


PLAIN = replace(PRESETS["paper"], pose_prior="axis_angle")
"""The paper with an L2 prior of which one knows by hand what it costs."""


def test_a_person_at_rest_on_its_keypoints_costs_its_bending_only():
    params = still()
    found = evaluate_objective(clip_of(params), shipped_body(), PLAIN, params)
    bending = 4 * 3.9**2
    expected = dict.fromkeys(("body_pose", "hand_pose", "jaw", "expression", "shape", "collision", "temporal"), 0.0)
    expected |= {"data": 0.0, "bending": bending, "total": bending}
    assert found.objective == pytest.approx(expected, rel=1e-12, abs=1e-12)
    assert found.frame_cost.tolist() == pytest.approx([bending] * STILL)
