"""The curves and levels of the timeline."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.ground.contacts import Contacts
from fitting_core.ground.plane import Ground
from fitting_core.measure.angles.joint_angles import joint_angles
from fitting_core.results.error_bars import ANGLES
from tcfit_app.analysis.curves import CURVES, curve
from tcfit_app.analysis.levels import LEVELS, level_spans
from tcfit_app.analysis.posed_fit import PosedFit
from tests.samples import scenes
from tests.samples.posed import displaced, fit_of, keypoints_of, still_params, with_keypoints
from tests.samples.project_samples import sample_error_bars, sample_grounding
from tests.samples.scenes import random_params


def moved(params: BodyParams, frame: int, by: tuple[float, float, float]) -> BodyParams:
    """One frame elsewhere, by metres."""
    translation = params.camera_translation.clone()
    translation[frame] += torch.tensor(by)
    return replace(params, camera_translation=translation)


def values(name: str, fit: PosedFit) -> np.ndarray:
    return curve(name, fit).values


def test_exact_keypoints_have_no_error_and_a_still_body_no_jitter(tiny_body: BodyModel):
    params = still_params(5)
    fit = fit_of(tiny_body, params, scenes.keypoints_of(tiny_body, params))
    np.testing.assert_allclose(values("reprojection", fit), 0, atol=1e-9)
    for name in ("jitter", "temporal"):
        assert np.isnan(values(name, fit)[[0, 4]]).all()
        np.testing.assert_allclose(values(name, fit)[1:4], 0, atol=1e-9)
    assert np.ptp(values("depth", fit)) == 0


def test_flexion_has_the_error_bars_of_its_angle_and_other_curves_none(tiny_body: BodyModel):
    fit = replace(fit_of(tiny_body, still_params(3)), error_bars=sample_error_bars(1, 3))
    assert fit.error_bars is not None
    bars = curve("right_knee_flexion", fit).error_bars
    np.testing.assert_array_equal(bars, fit.error_bars.angles[:, ANGLES.index("right_knee_flexion")])
    assert curve("jitter", fit).error_bars is None
    assert curve("right_knee_flexion", replace(fit, error_bars=None)).error_bars is None


def test_a_curve_tells_in_which_frames_what_it_measures_is_not_seen(tiny_body: BodyModel):
    params = still_params(5)
    keypoints = keypoints_of(tiny_body, params)
    confidence = np.ones_like(keypoints.confidence)
    confidence[1, kp.INDEX["right_wrist"]] = confidence[2, kp.INDEX["right_knee"]] = confidence[3] = 0
    fit = fit_of(tiny_body, params, replace(keypoints, confidence=confidence))

    def unseen(name: str) -> list[int]:
        found = curve(name, fit).unseen
        assert found is not None
        return np.flatnonzero(found).tolist()

    assert unseen("right_elbow_flexion") == unseen("right_wrist") == unseen("right_wrist_height") == [1, 3]
    assert unseen("right_knee_flexion") == unseen("right_hip_flexion") == [2, 3]
    assert all(CURVES[name].unseen(fit)[3] for name in CURVES)
    assert unseen("left_elbow_flexion") == unseen("lumbar_extension") == unseen("depth") == [3]
    blind = fit_of(tiny_body, params, replace(keypoints, confidence=np.zeros_like(confidence)))
    assert curve("depth", blind).unseen is None, "fits of a project without keypoints do not depend on them"


def test_flexion_is_that_of_the_joint_angles(tiny_body: BodyModel):
    fit = fit_of(tiny_body, random_params(4, size=0.3))
    angles = joint_angles(fit.motion)
    for name in ANGLES:
        np.testing.assert_allclose((values(name, fit) - angles[name] + 180) % 360, 180, atol=1e-6)


def test_one_keypoint_off_counts_by_its_confidence_in_its_region(tiny_body: BodyModel):
    """Over all keypoints it would be 0.1 px."""
    fit = displaced(fit_of(tiny_body, still_params(3)), 1, "left_wrist", (24.0, -7.0))
    confidence = fit.clip.keypoints.confidence.copy()
    confidence[:, kp.INDEX["left_wrist"]] = 0.5
    fit = with_keypoints(fit, confidence=confidence)
    arm = [kp.INDEX[f"left_{name}"] for name in ("shoulder", "elbow", "wrist")]
    expected = 0.5 * 25 / confidence[1, arm].sum()
    np.testing.assert_allclose(values("reprojection", fit), [0, expected, 0], atol=1e-9)


@pytest.mark.parametrize("joint", ["neck", "mid_hip"])
def test_the_middle_of_other_keypoints_says_nothing(tiny_body: BodyModel, joint: str):
    fit = displaced(fit_of(tiny_body, still_params(2)), slice(None), joint, (50.0, 0.0))
    np.testing.assert_allclose(values("reprojection", fit), 0, atol=1e-9)


def test_no_keypoints_is_no_error_at_all(tiny_body: BodyModel):
    fit = fit_of(tiny_body, still_params(3))
    confidence = fit.clip.keypoints.confidence.copy()
    confidence[1] = 0
    confidence[:, kp.HANDS] = 0
    fit = with_keypoints(fit, confidence=confidence)
    assert np.isnan(values("reprojection", fit)).tolist() == [False, True, False]
    assert np.isnan(values("reprojection_left_hand", fit)).all()
    assert values("confidence", fit)[1] == 0 and (values("confidence", fit)[[0, 2]] == 1).all()


def test_a_body_behind_the_camera_has_no_error(tiny_body: BodyModel):
    params = still_params(3)
    fit = fit_of(tiny_body, moved(params, 1, (0, 0, -6)), keypoints_of(tiny_body, params))
    assert np.isnan(values("reprojection", fit)).tolist() == [False, True, False]
    assert values("depth", fit)[1] < 0


def test_one_frame_aside_is_jitter_of_three(tiny_body: BodyModel):
    fit = fit_of(tiny_body, moved(still_params(7), 3, (0.003, 0, 0.004)))
    np.testing.assert_allclose(values("jitter", fit)[1:-1], [0, 5, 10, 5, 0], atol=1e-9)
    np.testing.assert_allclose(values("temporal", fit)[1:-1], [0, 5 / 3, 10 / 3, 5 / 3, 0], atol=1e-9)
    np.testing.assert_allclose(values("temporal", replace(fit, space="body"))[1:-1], 0, atol=1e-9)
    np.testing.assert_allclose(np.diff(values("depth", fit)), [0, 0, 0.004, -0.004, 0, 0], atol=1e-9)


def test_heights_are_above_the_floor(tiny_body: BodyModel):
    fit = fit_of(tiny_body, moved(still_params(3), 1, (0, -0.25, 0)))
    floor = Ground(normal=np.array([0.0, -1.0, 0.0]), offset=1.5, deviation=0.01)
    grounded = replace(fit, grounding=replace(sample_grounding(1, 3), ground=floor))
    heights = values("left_wrist_height", grounded)
    np.testing.assert_allclose(heights, 1.5 - fit.joints[:, JOINT["left_wrist"], 1])
    np.testing.assert_allclose(np.diff(heights), [0.25, -0.25])
    assert np.isnan(values("left_wrist_height", fit)).all(), "no floor is known"


@pytest.mark.parametrize("frames", [1, 2])
@pytest.mark.parametrize("name", CURVES)
def test_the_shortest_clips_have_curves(tiny_body: BodyModel, name: str, frames: int):
    found = curve(name, fit_of(tiny_body, still_params(frames)))
    assert found.values.shape == (frames,) and found.title and found.name == name


# --- levels ---


def test_hands_that_stay_have_no_movement(tiny_body: BodyModel):
    by_hand = level_spans("hand_phases", fit_of(tiny_body, still_params(3)))
    assert len(by_hand) == 2
    for spans in by_hand:
        assert not spans[LEVELS["hand_phases"].words.index("movement")] and ((0, 2),) in spans


def test_a_hand_has_no_phase_where_its_wrist_is_not_seen(tiny_body: BodyModel):
    fit = fit_of(tiny_body, still_params(3))
    confidence = np.ones(fit.clip.keypoints.confidence.shape)
    confidence[1, kp.INDEX["left_wrist"]] = 0.0
    left, right = level_spans("hand_phases", with_keypoints(fit, confidence=confidence))
    assert ((0, 0), (2, 2)) in left and ((0, 2),) in right


def test_feet_stand_seem_to_stand_or_are_in_the_air_where_they_are_seen(tiny_body: BodyModel):
    grounding = sample_grounding(1, 3)
    contacts = Contacts(
        probability=np.array([[0.9, 0.1], [0.9, 0.0], [0.2, 0.9]]),
        standing=np.array([[True, False], [False, False], [False, True]]),
        let_go=np.array([[False, False], [True, False], [False, False]]),
    )
    fit = replace(fit_of(tiny_body, still_params(3)), grounding=replace(grounding, contacts=contacts))
    assert LEVELS["contacts"].parts == ("left foot", "right foot")
    left, right = level_spans("contacts", fit)
    assert left == (((2, 2),), ((1, 1),), ((0, 0),)) and right == (((0, 0),), (), ((2, 2),)), "unseen in frame 1"
    assert level_spans("contacts", replace(fit, grounding=None)) == (((), (), ()),) * 2
