"""Parts of the body, and keypoints in words."""

import pytest

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, JOINTS
from tcfit_app.analysis.body_regions import KEYPOINT_OF_JOINT, LIMB_OF, REGION_OF, REGIONS, spoken, spoken_bone


def test_every_keypoint_is_in_one_region():
    every = [joint for joints in REGIONS.values() for joint in joints]
    assert sorted(every) == list(range(kp.COUNT)) == sorted(REGION_OF) == sorted(LIMB_OF)


@pytest.mark.parametrize(
    ("joint", "words"),
    [
        (kp.INDEX["left_wrist"], "left wrist"),
        (kp.LEFT_HAND.start, "left hand's wrist"),
        (kp.RIGHT_HAND.start + 6, "right index 2"),
        (kp.RIGHT_HAND.start + 4, "right thumb tip"),
        (kp.FACE.start + 3, "contour"),
        (kp.INDEX["face_outer_lip3"], "outer lip"),
        (kp.COUNT - 1, "left pupil"),
        (kp.INDEX["left_big_toe"], "left big toe"),
    ],
)
def test_keypoints_in_words(joint: int, words: str):
    assert spoken(joint) == words


def test_joints_in_words_and_as_keypoints():
    assert [spoken_bone(JOINT[n]) for n in ("left_index2", "spine1")] == ["left index 2", "spine 1"]
    at = {name: KEYPOINT_OF_JOINT[JOINT[name]] for name in JOINTS}
    assert [name for name in JOINTS if at[name] is None] == ["spine1", "spine2"]
    assert at["left_wrist"] == kp.INDEX["left_wrist"] and at["pelvis"] == kp.INDEX["mid_hip"]
    # a hand's first keypoint is its wrist, then thumb 1 to 4, index 1 to 4, ...
    assert at["right_thumb1"] == kp.RIGHT_HAND.start + 1 and at["left_index3"] == kp.LEFT_HAND.start + 7
