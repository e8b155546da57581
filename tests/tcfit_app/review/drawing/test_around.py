"""Close-ups: what they follow, and the states that the page receives. No browser."""

from typing import Any

import numpy as np
import pytest

from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.keypoints import GROUPS, INDEX
from tcfit_app.review.browser.page_events import Key
from tcfit_app.review.browser.page_states import Focus
from tcfit_app.review.drawing.overlays import followed, in_image
from tcfit_app.review.gestures.zooming import show_close_up, usual_size
from tcfit_app.review.tab.state import CLOSE_UPS, HELD_BY, Part
from tests.drivers.lone_page import LonePage, told

WRIST = INDEX["right_wrist"]


def heard(tested: LonePage) -> dict[str, Any]:
    """What the page is told by drawing once more."""
    with told(tested.page.tab) as found:
        tested.page.tab.look()
        tested.page.picture.draw()
    return dict(found)


def test_a_close_up_is_held_still_and_bridges_frames_without_detections():
    rng = np.random.default_rng(0)
    steady = np.array([100.0, 50.0])
    xy = steady + rng.normal(0, 3.0, (17, 21, 2)) + rng.normal(0, 6.0, (17, 1, 2))
    there = np.ones((17, 21), bool)
    there[7:10] = False
    found = followed(xy, there, 8)
    assert found is not None and np.linalg.norm(found - steady) < 6.0, "one frame is up to twice as far off"
    xy[~there] = 0.0
    assert followed(xy, there, 8) == pytest.approx(found), "what is undetected lies in the corner and does not count"
    assert followed(xy, np.zeros_like(there), 8) is None


def test_the_usual_size_is_that_of_the_box_around_what_was_detected():
    xy = np.zeros((4, 3, 2))
    xy[:, 1], xy[:, 2] = (30.0, 10.0), (900.0, 900.0)
    there = np.array([[True, True, False]] * 3 + [[False] * 3])
    assert usual_size(xy, there) == 30.0
    assert usual_size(xy, np.zeros_like(there)) is None


def test_points_are_seen_where_the_camera_has_them():
    camera = Camera(focal=(500.0, 600.0), center=(320.0, 240.0), size=(640, 480))
    pixels = in_image(np.array([[0.2, -0.1, 2.0], [0.0, 0.0, -1.0]]), camera)
    assert pixels[0] == pytest.approx((370.0, 210.0)) and np.isnan(pixels[1]).all()


def test_a_close_up_follows_its_part_until_the_whole_picture_is_asked_for(tested: LonePage):
    tab = tested.page.tab
    heard(tested)
    whole = tab.scene.cameras.pose
    corrected = tab.session.project.corrected
    detected = [part for part in CLOSE_UPS if corrected.confidence[:, GROUPS[part]].any()]
    followed_too = [part for part in CLOSE_UPS if corrected.confidence[:, HELD_BY[part]].any()]
    parts: list[Part] = [part for part in CLOSE_UPS if part in (*detected, *followed_too)]
    assert len(parts) > len(detected), "one is followed by its wrist or the nose"
    for part in parts:
        tested.page.receive(Key(action="close_up", repeat=False))
        assert tab.state.close_up == part
        if part != "face":
            beside = corrected.xy[:, HELD_BY[part], 0] - corrected.xy[:, INDEX["neck"], 0]
            assert tab.state.side_from == ("left" if np.median(beside) < 0 else "right"), "the body would hide the hand"
        focus = heard(tested)["focus"]
        assert isinstance(focus, Focus) and tab.scene.cameras.pose.distance < whole.distance
        if part not in detected:
            there = corrected.xy[:, HELD_BY[part]]
            assert (there.min(0) <= (focus.x, focus.y)).all() and ((focus.x, focus.y) <= there.max(0)).all()
    tested.page.receive(Key(action="close_up", repeat=False))
    heard(tested)
    assert tab.state.close_up is None and tab.scene.cameras.pose == whole
    show_close_up(tab, parts[0])
    tested.page.receive(Key(action="fit_view", repeat=False))
    assert tab.state.close_up is None
    tab.set(mode="space")
    with pytest.raises(InputError, match="Edit and Compare"):
        show_close_up(tab, parts[0])


def test_a_close_up_has_the_video_alone_beside_the_fit_and_the_side_view(tested: LonePage):
    tab = tested.page.tab
    heard(tested)
    show_close_up(tab, "right_hand")
    found = heard(tested)
    posters = found["layout"].posters
    assert [poster.kind for poster in posters] == ["video", "picture", "side"] and posters[0].label == "Video"
    widths = [right - left for left, _, right, _ in (poster.window for poster in posters)]
    assert widths == pytest.approx([widths[0]] * 3, rel=0.05), "three windows of one size"
    pose = tab.scene.cameras.pose
    tab.set(mode="ab")
    assert [poster.kind for poster in heard(tested)["layout"].posters] == ["picture", "picture", "side"]
    tab.set(mode="edit", bodies=False)
    assert [poster.kind for poster in heard(tested)["layout"].posters] == ["picture", "side"]
    tab.set(bodies=True)
    heard(tested)
    assert tab.scene.cameras.pose == pose, "what was zoomed to fills its window again"
    tab.scene.cameras.touched()
    tab.set(mode="ab")
    heard(tested)
    assert tab.scene.cameras.moved
