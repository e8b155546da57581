"""The one order of keypoints: names, groups, bones, what detections may hold; and what noise each detector has."""

import numpy as np
import pytest

from fitting_core import keypoints as kp
from fitting_core.keypoint_noise import DETECTOR_TITLES, NOISE, keypoint_weights, noise_deviations, part
from fitting_core.keypoints import COUNT, Keypoints


def test_groups_cover_all_137_in_order():
    places = [i for group in kp.GROUPS.values() for i in range(kp.COUNT)[group]]
    assert places == list(range(137)) == list(range(len(kp.NAMES)))
    assert [len(range(kp.COUNT)[g]) for g in kp.GROUPS.values()] == [25, 21, 21, 70]
    assert range(137)[kp.HANDS] == range(25, 67)


def test_openpose_order_of_the_documentation():
    expected = {0: "nose", 1: "neck", 4: "right_wrist", 7: "left_wrist", 8: "mid_hip", 9: "right_hip", 12: "left_hip"}
    expected |= {16: "left_eye", 19: "left_big_toe", 22: "right_big_toe", 24: "right_heel"}
    expected |= {25: "left_wrist", 29: "left_thumb4", 33: "left_index4", 46: "right_wrist", 66: "right_pinky4"}
    expected |= {67: "face_contour0", 84: "face_right_brow0", 97: "face_nose_bridge3", 135: "face_right_pupil"}
    assert {i: kp.NAMES[i] for i in expected} == expected


def test_bones_stay_in_their_group_and_connect_it():
    for name in ("body", "left_hand", "right_hand"):
        members = set(range(137)[kp.GROUPS[name]])
        bones = [b for b in kp.BONES if members & set(b)]
        assert all(set(b) <= members for b in bones)
        assert len(bones) == len(members) - 1  # with the next line: a tree
        reached = {min(members)}
        for _ in bones:
            reached |= {i for b in bones if reached & set(b) for i in b}
        assert reached == members
    assert all(min(b) >= 67 for b in kp.BONES if max(b) >= 67)


@pytest.mark.parametrize("broken", ["xy", "confidence"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_not_finite_is_refused(broken: str, value: float):
    arrays = {"xy": np.zeros((2, 137, 2)), "confidence": np.zeros((2, 137))}
    arrays[broken].reshape(-1)[3] = value
    with pytest.raises(AssertionError):
        Keypoints(**arrays)


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
