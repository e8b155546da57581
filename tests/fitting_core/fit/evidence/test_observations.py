"""Which detections are taken at their word, where the image cuts off parts; and what their detector's noise weighs."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.camera import Camera, Lens
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.evidence.observations import Observations
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.variables.state import Free
from fitting_core.image_border import cut_off
from fitting_core.keypoint_noise import keypoint_weights
from fitting_core.keypoints import Keypoints
from fitting_core.lens import straightened
from tests.samples.posed_clips import clip_of, motion, shipped_body
from tests.samples.scenes import CAMERA as SCENE
from tests.samples.scenes import keypoints_of, let_lift, random_params, stages_of
from tests.samples.standing import by_hand, standing

CAMERA = Camera(focal=(800.0, 800.0), center=(320.0, 240.0), size=(640, 480))


def test_frames_that_were_swapped_back_are_those_of_the_part():
    crossed = standing()
    for side, other in (("left", "right"), ("right", "left")):
        for part in ("elbow", "wrist"):
            crossed.xy[8:12, kp.INDEX[f"{side}_{part}"]] = standing().xy[8:12, kp.INDEX[f"{other}_{part}"]]
    clip = Observations.of(crossed, CAMERA, PRESETS["tcfit"], dtype=torch.float64, device=torch.device("cpu"))
    assert {name: frames.tolist() for name, frames in clip.swaps.items()} == {"arms": [8, 9, 10, 11]}
    assert {name: frames.tolist() for name, frames in clip[10:20].swaps.items()} == {"arms": [0, 1]}
    assert not clip[12:20].swaps


def changed(keypoints: Keypoints, name: str, *, xy=None, confidence=None) -> Keypoints:
    new_xy, new_confidence = keypoints.xy.copy(), keypoints.confidence.copy()
    if xy is not None:
        new_xy[:, kp.INDEX[name]] = xy
    if confidence is not None:
        new_confidence[:, kp.INDEX[name]] = confidence
    return Keypoints(xy=new_xy, confidence=new_confidence)


@pytest.mark.parametrize(
    ("at", "side"),
    [((300, 477), (0, 1)), ((638, 200), (1, 0)), ((2, 200), (-1, 0)), ((300, 1), (0, -1)), ((300, 470), (0, 0))],
)
def test_points_on_the_border_lie_there_or_beyond(at, side):
    found = cut_off(changed(standing(), "left_wrist", xy=at), CAMERA)
    assert (found[:, kp.INDEX["left_wrist"]] == side).all()
    assert not np.delete(found, kp.INDEX["left_wrist"], axis=1).any()


def test_hips_without_knees_lie_there_or_lower():
    clip = changed(changed(standing(), "left_knee", confidence=0.0), "left_hip", confidence=0.3)
    found = cut_off(clip, CAMERA)
    assert (found[:, kp.INDEX["left_hip"]] == (0, 1)).all()
    assert not found[:, kp.INDEX["right_hip"]].any()
    assert not found[:, kp.INDEX["mid_hip"]].any(), "the other leg is seen"
    none = changed(changed(clip, "right_knee", confidence=0.0), "right_hip", confidence=0.3)
    assert (cut_off(none, CAMERA)[:, kp.INDEX["mid_hip"]] == (0, 1)).all()
    sure = changed(changed(standing(), "left_knee", confidence=0.0), "left_hip", confidence=0.6)
    assert not cut_off(sure, CAMERA)[:, kp.INDEX["left_hip"]].any()


def test_the_border_is_that_of_the_picture_as_it_was_filmed():
    lens = Lens(focal=CAMERA.focal, center=CAMERA.center, distortion=(-0.3, 0.1, 0.0, 0.0))
    camera = replace(CAMERA, lens=lens)
    # Barrel distortion: the straightened point lies outside the image that it was filmed in, 5 pixels from the border.
    filmed_near, _ = straightened(lens, np.array([[638.0, 100.0], [600.0, 100.0]]))
    assert (filmed_near[:, 0] > 600).all() and filmed_near[0, 0] > 645
    near = changed(standing(), "left_wrist", xy=filmed_near[0])
    inside = changed(standing(), "left_wrist", xy=filmed_near[1])
    assert (cut_off(near, camera)[:, kp.INDEX["left_wrist"]] == (1, 0)).all()
    assert not cut_off(inside, camera).any()


def test_what_a_person_placed_on_the_border_lies_there():
    clip = changed(standing(), "left_wrist", xy=(638, 200))
    assert cut_off(clip, CAMERA).any() and not cut_off(by_hand(clip, ("left_wrist",), list(range(20))), CAMERA).any()


@pytest.mark.parametrize("weight", [0.0, 2.0])
def test_the_lifter_is_asked_where_it_counts(tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch, weight: float):
    """Of body keypoints in the image alone, where it is sure; of detected ones the depth is taken."""
    unsure = np.where(np.arange(25) == kp.INDEX["left_ankle"], 0.5, 0.1)
    asked = let_lift(monkeypatch, np.tile([0.0, 0.0, 0.3], (25, 1)), unsure)
    detections = keypoints_of(tiny_body, random_params(3))
    detections.xy[:, kp.INDEX["right_wrist"]] = (798.0, 500.0)
    detections.confidence[:, kp.INDEX["nose"]] = 0.0
    config = FitConfig(one_sided_cut_off=True)
    config = replace(config, weights=replace(config.weights, relative_position=(0.0, 0.0, 0.0, weight, weight)))
    stages = stages_of(tiny_body, detections, config)
    known = stages.observations.relative_position_deviation.isfinite()
    assert len(asked) == (weight > 0)
    if not weight:
        assert not bool(known.any())
        return
    wrist, elbow, ankle, nose = (kp.INDEX[n] for n in ("right_wrist", "right_elbow", "left_ankle", "nose"))
    assert (asked[0][:, wrist] == 0).all() and (asked[0][:, elbow] > 0).all()
    assert known[:, kp.BODY, 2].float().mean(0).tolist() == [float(i != ankle) for i in range(25)]
    assert known[:, kp.BODY, :2].float().mean((0, 2)).tolist() == [float(i == nose) for i in range(25)]
    assert not bool(known[:, 25:].any()) and bool((stages.observations.relative_position[:, kp.BODY, 2] == 0.3).all())
    objectives = [stages.objective(k, stages.parametrisation.neutral(3), Free()) for k in (3, 4)]
    assert [any(t.name == "relative_position" for t in o.terms) for o in objectives] == [False, True]


# --- a detector's noise ---


TCFIT = PRESETS["tcfit"]
WEIGHED = replace(TCFIT, keypoint_noise="auto")


def observed(detector: str, config: FitConfig = WEIGHED, keypoints: Keypoints | None = None) -> Observations:
    return Observations.of(
        keypoints or standing(), SCENE, config, detector=detector, dtype=torch.float64, device=torch.device("cpu")
    )


def test_mediapipes_count_by_their_weights():
    found = observed("mediapipe")
    expected = standing().confidence * keypoint_weights("mediapipe", "")
    np.testing.assert_allclose(found.confidence.numpy(), expected, rtol=1e-15)
    assert not np.array_equal(found.confidence.numpy(), standing().confidence)


@pytest.mark.parametrize("confidence", [0.02, 0.11, 0.24, 0.3, 0.8])
def test_what_is_seen_does_not_depend_on_it(confidence: float):
    """Nor what is swapped back or cut off, nor how many keypoints a frame needs."""
    keypoints = replace(standing(), confidence=np.where(standing().confidence > 0, confidence, 0.0))
    one, other = observed("openpose", keypoints=keypoints), observed("mediapipe", keypoints=keypoints)
    for name in ("seen", "hips_seen", "leg_seen", "side", "shown", "usable"):
        assert torch.equal(getattr(one, name), getattr(other, name)), name
    assert np.array_equal(one.swapped, other.swapped)
    assert np.array_equal(one.keypoints.confidence, other.keypoints.confidence)


def test_what_a_person_has_placed_has_no_detectors_noise():
    weights = keypoint_weights("mediapipe", "")
    name = next(n for n in kp.BODY_25 if weights[kp.INDEX[n]] != 1)
    placed = by_hand(standing(), (name,), [3])
    found = observed("mediapipe", keypoints=placed).confidence[:, kp.INDEX[name]].numpy()
    assert found[3] == placed.confidence[3, kp.INDEX[name]] and (np.delete(found, 3) != found[3]).all()


def test_fits_from_openposes_keypoints_are_the_same_to_the_last_bit():
    clip = clip_of(motion(2, amplitude=0.2))
    quick = replace(WEIGHED, relay_rounds=0, limb_flips=False, yaws="side_view", pose_prior="axis_angle", last_phase=1)
    before = fit_clip(clip, shipped_body(), replace(quick, keypoint_noise="equal"))
    after = fit_clip(replace(clip, detector="openpose"), shipped_body(), quick)
    for name, value in vars(before.last.params).items():
        assert torch.equal(value, getattr(after.last.params, name)), name
    mediapipe = fit_clip(replace(clip, detector="mediapipe"), shipped_body(), quick)
    assert not torch.equal(before.last.params.body_pose, mediapipe.last.params.body_pose)
