"""Keypoints weigh by their detector's noise in what the terms see, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.evidence.observations import Observations
from fitting_core.fit.fitting import fit_clip
from fitting_core.keypoint_noise import keypoint_weights
from fitting_core.keypoints import Keypoints
from tests.samples.posed_clips import clip_of, motion, shipped_body
from tests.samples.scenes import CAMERA
from tests.samples.standing import by_hand, standing

TCFIT = PRESETS["tcfit"]
WEIGHED = replace(TCFIT, keypoint_noise="auto")


def observed(detector: str, config: FitConfig = WEIGHED, keypoints: Keypoints | None = None) -> Observations:
    return Observations.of(
        keypoints or standing(), CAMERA, config, detector=detector, dtype=torch.float64, device=torch.device("cpu")
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
