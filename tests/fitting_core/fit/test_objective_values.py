"""The objective by term through the public call, against values computed by hand."""

from dataclasses import replace

import pytest
import torch

from fitting_core.body.params import BodyParams
from fitting_core.config.schema import PRESETS
from fitting_core.errors import InputError
from fitting_core.fit.objective_values import evaluate_objective
from fitting_core.fit.phase_figures import evaluated
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


def values_of(params: BodyParams, preset=PLAIN, stage=5, clip=None):
    clip = clip or clip_of(params)
    return evaluate_objective(shipped_body(), params, clip.camera, clip.keypoints, preset, stage=stage)


def test_a_person_at_rest_on_its_keypoints_costs_its_bending_only():
    values = values_of(still())
    zero = torch.zeros(FRAMES, dtype=torch.float64)
    for name, cost in values.frames.items():
        expected = zero + 4 * 3.9**2 if name == "bending" else zero
        torch.testing.assert_close(cost, expected, rtol=1e-12, atol=1e-12)
    assert values.temporal == pytest.approx(0, abs=1e-12)
    assert values.total == pytest.approx(FRAMES * 4 * 3.9**2)
    assert set(values.frames) == {
        "data", "body_pose", "hand_pose", "jaw", "expression", "shape", "bending", "collision",
    }  # fmt: skip


def test_it_is_what_a_fit_reports():
    """All terms but held feet, whose places come from a fit. At 60 frames per second, where the weight of E_T is
    for 25."""
    params = motion(FRAMES)
    clip = replace(clip_of(params, noise=2.0), frame_rate=60.0)
    reported = evaluated(clip, shipped_body(), PRESETS["tcfit"], params).objective
    values = evaluate_objective(shipped_body(), params, clip.camera, clip.keypoints, "tcfit", frame_rate=60.0)
    assert {name: cost / FRAMES for name, cost in values.terms.items()} == pytest.approx(
        {name: cost for name, cost in reported.items() if name not in ("total", "held_position")}
    )


def test_a_frame_rate_is_needed_where_it_counts():
    with pytest.raises(InputError, match=r"No frame rate is given.*for 25 frames per second"):
        values_of(still(), "tcfit")


def test_parameters_must_fit_to_the_keypoints_and_the_hands():
    params, clip = still(), clip_of(still())
    with pytest.raises(InputError, match="2 frames and the keypoints 3"):
        values_of(params[:2], clip=clip)
    wide = replace(params, **{f"{side}_hand_pose": torch.zeros(FRAMES, 45).double() for side in ("left", "right")})
    with pytest.raises(InputError, match=r"45 numbers for each hand.*asks for 12"):
        values_of(wide, clip=clip)
