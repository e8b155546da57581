"""The objective by term against values computed by hand."""

from dataclasses import replace

import pytest

from fitting_core.body.params import BodyParams
from fitting_core.config.schema import PRESETS
from fitting_core.fit.phase_figures import evaluate_objective
from tests.samples.posed_clips import clip_of, motion, shipped_body

FRAMES = 3


def still() -> BodyParams:
    """A person at rest who looks into the camera."""
    params = motion(FRAMES, amplitude=0.0)
    return replace(
        params,
        camera_translation=params.camera_translation[:1].expand(FRAMES, 3),
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
    assert found.frame_cost.tolist() == pytest.approx([bending] * FRAMES)
