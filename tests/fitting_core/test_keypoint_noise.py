"""The table of detectors' noise, and the weights that follow from it."""

import numpy as np
import pytest

from fitting_core.keypoint_noise import DETECTOR_TITLES, NOISE, keypoint_weights, noise_deviations, part
from fitting_core.keypoints import COUNT


def test_every_keypoint_of_every_detector_has_its_noise():
    assert list(NOISE) == list(DETECTOR_TITLES)
    parts = {part(keypoint) for keypoint in range(COUNT)}
    for detector, table in NOISE.items():
        assert set(table) == parts, detector
        assert ((noise_deviations(detector) > 1) & (noise_deviations(detector) < 100)).all()


@pytest.mark.parametrize(
    "noise, detector",
    [("equal", "mediapipe"), ("openpose", "mediapipe"), ("auto", "openpose"), ("auto", ""), ("auto", "alphapose")],
)
def test_openposes_and_what_counts_as_such_weigh_exactly_the_same(noise: str, detector: str):
    assert (keypoint_weights(noise, detector) == 1.0).all()


def test_the_clip_says_whose_noise_it_is_unless_the_setting_does():
    mediapipe = keypoint_weights("auto", "mediapipe")
    np.testing.assert_array_equal(mediapipe, keypoint_weights("mediapipe", "openpose"))
    assert (mediapipe != 1.0).any() and (mediapipe > 0).all()


def test_what_is_noisier_than_openposes_weighs_less_beside_the_rest():
    """Of two keypoints the one whose noise has grown more against OpenPose's has the smaller weight."""
    for detector in DETECTOR_TITLES:
        grown, weights = noise_deviations(detector) / noise_deviations("openpose"), keypoint_weights(detector, "")
        order = np.argsort(grown, kind="stable")
        assert (np.diff(weights[order]) <= 1e-12).all()
