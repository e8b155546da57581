"""What a program does to a fit: corrections of keypoints, and frames that are fitted again with them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fitting_core.body.model import JOINT, BodyModel
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, SolverSettings
from fitting_core.errors import InputError
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.refitting import refit
from fitting_core.io.motion_files import motion_of, write_motion
from fitting_core.keypoints import INDEX
from fitting_core.measure.comparison import evaluate_fit
from fitting_core.results.error_bars import DIRECTIONS
from fitting_core.results.fit_result import FitResult
from tests.samples.posed_clips import clip_of, motion, shipped_body

QUICK = replace(PRESETS["tcfit"], relay_rounds=0, limb_flips=False, settings=SolverSettings(iterations=3))
WRIST, KNEE = INDEX["right_wrist"], INDEX["left_knee"]


@pytest.fixture(scope="module")
def clip() -> Clip:
    return clip_of(motion(6))


@pytest.fixture(scope="module")
def body() -> BodyModel:
    return shipped_body()


@pytest.fixture(scope="module")
def fit(clip: Clip, body: BodyModel) -> FitResult:
    return fit_clip(clip, body, QUICK)


def test_error_bars_of_frames_that_are_fitted_again_are_new_and_all_others_stay(
    clip: Clip, body: BodyModel, fit: FitResult
):
    points = {name: None for name in ("right_wrist", "right_elbow")}
    unseen = clip.corrected(3, points)
    before, after = fit.last.error_bars, refit(unseen, body, fit, range(3, 4)).last.error_bars
    assert before is not None and after is not None
    np.testing.assert_array_equal(np.delete(after.joints, 3, 0), np.delete(before.joints, 3, 0))
    across = JOINT["right_wrist"], DIRECTIONS.index("across")
    assert after.joints[3][across] > 1.2 * before.joints[3][across], "what nobody sees any more is less sure"


def test_a_correction_is_a_new_clip(clip: Clip):
    new = clip.corrected(2, {"right_wrist": (300.0, 310.0), "left_knee": None})
    assert new.keypoints.xy[2, WRIST].tolist() == [300, 310] and new.keypoints.confidence[2, WRIST] == 1
    assert new.keypoints.placed[2, WRIST] and new.keypoints.confidence[2, KNEE] == 0
    others = np.ones(clip.keypoints.confidence.shape, bool)
    others[2, [WRIST, KNEE]] = False
    assert np.array_equal(new.keypoints.xy[others], clip.keypoints.xy[others])
    assert np.array_equal(new.keypoints.confidence[others], clip.keypoints.confidence[others])
    assert clip.keypoints.by_hand is None and not new.keypoints.placed[others].any()


@pytest.mark.parametrize(
    ("frame", "points", "said"),
    [
        (6, {}, "no frame 6 to correct: the clip has frames 0 to 5"),
        (-1, {}, "no frame -1"),
        (0, {"right_wirst": None}, "no keypoint 'right_wirst'.*right_wrist"),
        (0, {"nose": (1.0, float("nan"))}, "nose is put at .*expected x and y in pixels"),
    ],
)
def test_what_cannot_be_corrected_is_refused(clip: Clip, frame: int, points: dict, said: str):
    with pytest.raises(InputError, match=said):
        clip.corrected(frame, points)


def test_only_the_frames_that_are_asked_for_change(clip: Clip, body: BodyModel, fit: FitResult):
    moved = clip.keypoints.xy[3, WRIST] + (0.0, -60.0)
    corrected = clip.corrected(3, {"right_wrist": (float(moved[0]), float(moved[1]))})
    again = refit(corrected, body, fit, range(2, 5))
    same = [0, 1, 5]
    assert torch.equal(again.last.params.body_pose[same], fit.last.params.body_pose[same].to(torch.float64))
    wrists = [motion_of(result, clip, body).joints()[3, 21] for result in (fit, again)]
    assert wrists[1][1] < wrists[0][1] - 0.02  # metres: up, where the correction is
    assert [phase.phase for phase in again.phases] == [1, 2, 3] and again.config == fit.config


def test_phases_and_endings_that_there_are_not(clip: Clip, body: BodyModel, fit: FitResult, tmp_path: Path):
    with pytest.raises(InputError, match="no phase 4"):
        motion_of(fit, clip, body, phase=4)
    with pytest.raises(InputError, match="no phase 0"):
        evaluate_fit(fit, clip, body, phase=0)
    with pytest.raises(InputError, match=r"\.fbx"):
        write_motion(tmp_path / "walk.fbx", motion_of(fit, clip, body))
    assert evaluate_fit(fit, clip, body, phase=1).figures["jitter"] != evaluate_fit(fit, clip, body).figures["jitter"]


def test_what_cannot_be_fitted_again_is_refused(clip: Clip, body: BodyModel, fit: FitResult):
    with pytest.raises(InputError, match="No frames to fit again"):
        refit(clip, body, fit)
    with pytest.raises(InputError, match="6 frames and the clip 3"):
        refit(replace(clip, keypoints=clip.keypoints[:3]), body, fit, range(1, 2))
    for frames in (range(5, 9), range(-1, 3), range(4, 4), range(5, 3)):
        with pytest.raises(InputError, match=r"cannot be fitted again|No frames to fit again"):
            refit(clip, body, fit, frames)
    with pytest.raises(InputError, match="ended after phase 1, in which each frame has a shape of its own"):
        refit(clip, body, replace(fit, phases=fit.phases[:1]), range(1, 2))
