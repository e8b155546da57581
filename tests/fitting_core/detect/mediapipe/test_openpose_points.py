"""MediaPipe's points as the 137: which is which, what is made up, how sure each is."""

from dataclasses import replace

import numpy as np
import pytest

from fitting_core.detect.mediapipe import body as blaze
from fitting_core.detect.mediapipe.face import Face
from fitting_core.detect.mediapipe.openpose_points import LEAST, points_of
from fitting_core.keypoints import BODY_25, FACE, INDEX, LEFT_HAND, RIGHT_HAND
from tests.fitting_core.detect.mediapipe.seen import body_at, hand_at

SIZE = (640, 480)
NO_HANDS = {"left": None, "right": None}
BODY = body_at(320, 240, 400)


def test_every_point_of_the_body_is_the_one_of_its_name():
    points = points_of(BODY, NO_HANDS, None, SIZE)
    for name in BODY_25:
        if name in ("neck", "mid_hip") or "small_toe" in name:
            continue
        theirs = getattr(blaze, name.upper().replace("BIG_TOE", "TOE"))
        assert points[INDEX[name], :2] == pytest.approx(BODY.xy[theirs]) and points[INDEX[name], 2] > 0.9
    for middle, part in (("neck", "shoulder"), ("mid_hip", "hip")):
        ends = points[[INDEX[f"left_{part}"], INDEX[f"right_{part}"]]]
        assert points[INDEX[middle], :2] == pytest.approx(ends[:, :2].mean(0))
    assert not points[25:].any()


def test_knees_and_elbows_that_the_heat_map_does_not_show_are_not_detected():
    heat = BODY.heat.copy()
    heat[[blaze.LEFT_KNEE, blaze.LEFT_ELBOW]] = 0.04
    points = points_of(replace(BODY, heat=heat), NO_HANDS, None, SIZE)
    assert not points[[INDEX["left_knee"], INDEX["left_elbow"]]].any()
    assert points[INDEX["left_hip"], 2] == pytest.approx(0.3) and points[INDEX["right_hip"], 2] > 0.9
    assert points[INDEX["mid_hip"], 2] == pytest.approx(0.3)


def test_points_beyond_the_picture_are_put_onto_its_border_without_being_sure():
    low = body_at(320, 350, 600)
    points = points_of(low, NO_HANDS, None, SIZE)
    knee, ankle = points[INDEX["left_knee"]], points[INDEX["left_ankle"]]
    assert low.xy[blaze.LEFT_KNEE, 1] < SIZE[1] < low.xy[blaze.LEFT_ANKLE, 1]
    assert knee[2] > 0.9 and not ankle.any()  # more than 0.15 sides away
    near = body_at(320, 300, 480)
    ankle = points_of(near, NO_HANDS, None, SIZE)[INDEX["left_ankle"]]
    assert ankle[1] == SIZE[1] - 1 and ankle[2] == pytest.approx(0.25)


def test_hands_and_face():
    face = Face(xy=np.tile([[300.0, 60.0]], (468, 1)) + np.arange(468)[:, None] / 100, score=0.8)
    hands = {"left": hand_at(400, 240, right=0.0), "right": hand_at(200, 240, score=0.4, right=1.0)}
    points = points_of(BODY, hands, face, SIZE)
    assert points[LEFT_HAND, :2] == pytest.approx(hands["left"].xy) and (points[LEFT_HAND, 2] == 0.9).all()
    assert (points[RIGHT_HAND, 2] == 0.2).all()
    assert (points[FACE, 2][:68] == 0.8).all() and (points[FACE, 2][68:] == 0.4).all()
    assert points[FACE.start + 30, :2] == pytest.approx(face.xy[4])  # the nose's tip
    turned = {**hands, "left": hand_at(400, 240, right=1.0)}
    assert points_of(BODY, turned, None, SIZE)[LEFT_HAND, 2] == pytest.approx(
        0.225
    )  # like a right one: half, and unsure
    far = {**hands, "left": hand_at(700, 240)}
    assert not points_of(BODY, far, None, SIZE)[LEFT_HAND].any()


def test_without_a_body_only_the_rest_is_there():
    points = points_of(None, {"left": hand_at(400, 240), "right": None}, None, SIZE)
    assert not points[:25].any() and points[LEFT_HAND, 2].all()


def test_nothing_weak_and_nothing_that_is_no_number_is_reported():
    xy = BODY.xy.copy()
    xy[blaze.NOSE] = np.nan
    points = points_of(replace(BODY, xy=xy, visible=np.zeros(blaze.COUNT)), NO_HANDS, None, SIZE)
    assert np.isfinite(points).all() and not points[INDEX["nose"]].any()
    assert not ((points[:, 2] > 0) & (points[:, 2] < LEAST)).any()
