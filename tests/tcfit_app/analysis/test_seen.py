"""What keypoints show of the body: one rule for meshes, keypoints in space and curves."""

import numpy as np

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, JOINTS, BodyModel
from fitting_core.keypoints import SIDES
from tcfit_app.analysis.seen import FAINT, evident, opacities, seen_joints, unseen_keypoints


def present(*hidden: str) -> np.ndarray:
    """All keypoints but these."""
    found = np.ones(kp.COUNT, bool)
    found[[kp.INDEX[name] for name in hidden]] = False
    return found


def unseen(shown: np.ndarray) -> set[str]:
    return {JOINTS[i] for i in np.flatnonzero(~seen_joints(shown))}


def test_a_limb_s_part_is_seen_if_its_end_is():
    assert unseen(present()) == set()
    assert unseen(present("left_wrist")) == {"left_elbow"}
    assert unseen(present("left_wrist", "left_elbow")) == {"left_elbow", "left_shoulder"}
    assert unseen(present("right_knee")) == {"right_hip"}
    assert unseen(present("right_big_toe", "right_small_toe")) == set(), "the heel shows the foot"
    faceless = present("nose", *(name for name in kp.NAMES if name.startswith("face_")))
    assert unseen(faceless) == set(), "ears and eyes are left"


def test_a_hand_is_not_seen_without_its_own_keypoints():
    shown = present()
    shown[kp.LEFT_HAND] = False
    assert unseen(shown) == {"left_wrist", *(name for name in JOINTS[25:] if name.startswith("left"))}


def test_a_hand_that_was_given_a_shape_counts_as_seen():
    confidence = np.ones((2, kp.COUNT))
    confidence[:, kp.LEFT_HAND] = 0
    turn = np.full((2, kp.COUNT, 3), np.nan)
    turn[1, kp.FINGER_JOINTS["left"]] = 0.1
    found = evident(kp.Keypoints(xy=np.zeros((2, kp.COUNT, 2)), confidence=confidence, turn=turn))
    assert "left_wrist" in unseen(found[0]) and unseen(found[1]) == set()


def test_nothing_is_seen_without_keypoints_and_each_keypoint_shows_something():
    assert not seen_joints(np.zeros((4, kp.COUNT), bool)).any() and seen_joints(np.ones((4, kp.COUNT), bool)).all()
    shows = seen_joints(np.eye(kp.COUNT, dtype=bool)).any(1)
    assert {kp.NAMES[i] for i in np.flatnonzero(~shows)} == {"neck", "mid_hip"}


def test_neck_and_mid_hip_go_with_the_trunk():
    assert unseen_keypoints(present("neck", "mid_hip")) == ()
    hidden = ["neck", "mid_hip", *(f"{side}_{end}" for side in SIDES for end in ("shoulder", "hip"))]
    assert unseen_keypoints(present(*hidden)) == tuple(sorted(kp.INDEX[name] for name in hidden))


def test_vertices_fade_with_their_joints(tiny_body: BodyModel):
    seen = np.ones(len(JOINTS), bool)
    seen[JOINT["left_elbow"]] = False
    found = opacities(tiny_body.skinning_weights, seen) / 255
    share = tiny_body.skinning_weights[:, JOINT["left_elbow"]]
    np.testing.assert_allclose(found, 1 - (1 - FAINT) * share, atol=1 / 255)
    assert found.min() < 0.8
