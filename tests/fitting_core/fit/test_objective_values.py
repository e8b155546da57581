"""The objective by term through the public call, against values computed by hand."""

from dataclasses import replace

import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT
from fitting_core.body.params import BodyParams
from fitting_core.config.schema import PRESETS, Temporal
from fitting_core.errors import InputError
from fitting_core.fit.objective_values import evaluate_objective
from fitting_core.fit.phase_figures import evaluated
from tests.samples.posed_clips import CAMERA, clip_of, motion, shipped_body

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


def with_column(params: BodyParams, name: str, frame: int, column: int, value: float) -> BodyParams:
    changed = getattr(params, name).clone()
    changed[frame, column] = value
    return replace(params, **{name: changed})


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


@pytest.mark.parametrize(
    ("name", "column", "value", "term", "weights"),
    [
        ("body_pose", 3 * (JOINT["spine2"] - 1), 0.3, "body_pose", (404.0, 404.0, 57.4, 4.78, 4.78)),
        ("left_hand_pose", 2, 0.7, "hand_pose", (404.0, 404.0, 57.4, 4.78, 4.78)),
        ("right_hand_pose", 11, -0.7, "hand_pose", (404.0, 404.0, 57.4, 4.78, 4.78)),
        ("betas", 4, 1.5, "shape", (100.0, 50.0, 10.0, 5.0, 5.0)),
        ("expression", 9, -2.0, "expression", (100.0, 50.0, 10.0, 5.0, 5.0)),
        ("jaw_pose", 0, 0.2, "jaw", (63.6, 63.6, 24.0, 6.9, 6.9)),
        ("jaw_pose", 2, 0.2, "jaw", (201.0, 201.0, 75.7, 21.9, 21.9)),
    ],
)
def test_priors_are_squares_of_weight_times_value(name, column, value, term, weights):
    params = with_column(still(), name, 1, column, value)
    clip = clip_of(still())
    for stage, weight in enumerate(weights, 1):
        cost = values_of(params, stage=stage, clip=clip).frames[term]
        expected = torch.tensor([0.0, (weight * value) ** 2, 0.0], dtype=torch.float64)
        torch.testing.assert_close(cost, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("point", "stage", "weight"),
    [("left_knee", 1, 1.0), ("neck", 5, 0.0), ("left_hip", 5, 0.0), ("left_index4", 4, 0.1), ("left_index4", 5, 2.0)],
)
def test_data_is_the_robust_distance_in_thousandths_of_the_height(point, stage, weight):
    """One keypoint 30 px to the right and 400 px up, seen with confidence 0.5."""
    params, i = still(), kp.INDEX[point]
    seen = clip_of(params, groups=(kp.BODY, kp.HANDS)).keypoints
    xy, confidence = seen.xy.copy(), seen.confidence.copy()
    xy[0, i] += (30, -400)
    confidence[0, i] = 0.5
    moved = kp.Keypoints(xy=xy, confidence=confidence)
    camera = replace(CAMERA, size=(1000, 2000))
    values = evaluate_objective(shipped_body(), params, camera, moved, PLAIN, stage=stage)
    rho = 100.0
    robust = sum(rho**2 * r**2 / (r**2 + rho**2) for r in (30.0, 400.0))
    expected = (0.5 * weight * 1000 / 2000) ** 2 * robust
    torch.testing.assert_close(
        values.frames["data"], torch.tensor([expected, 0.0, 0.0], dtype=torch.float64), rtol=1e-9, atol=1e-9
    )


def test_temporal_term_is_the_squared_distance_from_the_mean_of_three_frames():
    """The middle frame 3 cm nearer: (2 J_i - J_{i-1} - J_{i+1}) / 3 is 2 cm on each of 55 joints."""
    params = with_column(still(), "camera_translation", 1, 2, still().camera_translation[0, 2] - 0.03)
    expected = 100.0**2 * 55 * 0.02**2
    in_camera = replace(PLAIN, temporal=Temporal(space="camera"))
    values = values_of(params, in_camera, clip=clip_of(still()))
    assert values.temporal == pytest.approx(expected)
    assert values.total == pytest.approx(sum(float(cost.sum()) for cost in values.frames.values()) + expected)
    assert values.terms["temporal"] == values.temporal
    assert values_of(params).temporal == pytest.approx(0, abs=1e-12)


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
