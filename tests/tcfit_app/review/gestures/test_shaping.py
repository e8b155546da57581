"""Hands given a shape with the panel's buttons and keys: what is stored, what is said, and that the fit follows."""

import json
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.handshapes import HANDSHAPES, finger_angles, in_hand
from fitting_core.body.model import POSE_JOINTS, BodyModel
from fitting_core.body.params import full_pose
from fitting_core.errors import InputError
from fitting_core.keypoints import FINGER_JOINTS, HAND_21, INDEX, LEFT_HAND, RIGHT_HAND, Side
from tcfit_app.project.edits.kinds import ShapeHand
from tcfit_app.review.gestures import shaping
from tcfit_app.review.gestures.shaping import keep_handshape
from tcfit_app.review.panels.correct.correct_panel import CorrectPanel
from tcfit_app.review.tab.state import FitSettings
from tests.drivers.lone_page import LonePage
from tests.samples.sessions import QUICK

RIGHT = INDEX["right_wrist"]


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's file, which is not there yet."""
    path = tmp_path / "user" / "handshapes.json"
    monkeypatch.setattr(shaping, "own_handshapes_file", lambda: path)
    return path


@pytest.fixture
def tested(fitted_page: LonePage) -> LonePage:
    fitted_page.only(CorrectPanel)
    fitted_page.page.tab.set(settings=FitSettings(config=QUICK, preset="paper"), selection=(RIGHT,), folds={"shapes"})
    return fitted_page


def fitted_hand(tested: LonePage, body: BodyModel, side: Side) -> np.ndarray:
    return full_pose(body, tested.shown.params)[:, POSE_JOINTS[f"{side}_hand_pose"]].numpy()


def nearest(body: BodyModel, angles: np.ndarray, side: int) -> np.ndarray:
    """The hand of the fit's twelve numbers that is nearest to these angles."""
    rows = body.hand_components[side, :12]
    return ((angles.reshape(45) - body.hand_mean[side]) @ rows.T @ rows + body.hand_mean[side]).reshape(15, 3)


def shape_of(edit: ShapeHand) -> np.ndarray:
    assert edit.shape is not None
    return np.array(edit.shape)


def test_a_fist_is_put_on_and_the_fit_follows(tested: LonePage, tiny_body: BodyModel):
    tab = tested.page.tab
    before = fitted_hand(tested, tiny_body, "right")
    tab.set(frame=4, frames=range(3, 6))
    tested.enter("Blend", 1)
    tested.press("action", "shape_fist")
    edit = tested.last_edit
    fist = finger_angles(HANDSHAPES["fist"], "right")
    assert (edit.frames, edit.joints, edit.blend) == ((2, 3, 4, 5, 6), FINGER_JOINTS["right"], (1, 1))
    np.testing.assert_allclose(shape_of(edit), fist, atol=1e-5)
    for stated, frame in ((edit.before, 1), (edit.after, 7)):
        assert stated is not None
        np.testing.assert_allclose(stated, before[frame], atol=1e-5)
    assert tab.message[0] == "Saved: right hand given the shape fist, frames 3–5, blended over 1 and 1 frames"
    tested.idle()
    after = fitted_hand(tested, tiny_body, "right")
    assert np.degrees(np.abs(after[3:6] - nearest(tiny_body, fist, 1))).max() < 1
    assert np.degrees(np.abs(after[2] - nearest(tiny_body, (before[1] + fist) / 2, 1))).max() < 1
    tested.press("action", "undo")
    assert tab.session.project.clip.keypoints.turn is None
    tested.press("action", "redo")
    assert tab.session.project.corrected.touched[2:7, FINGER_JOINTS["right"]].all(), "marked in the timeline"
    hand = [RIGHT_HAND.start + HAND_21.index(name) for name in ("wrist", "index1", "index3", "index4")]
    for joint, given in zip(hand, (False, True, True, True), strict=True):
        tab.set(selection=(joint,), frames=None)
        assert ("In a given hand shape." in tested.html()) == given, "fingertips too: their detections do not count"


def test_the_other_hand_mirrored_and_a_copied_one(tested: LonePage, tiny_body: BodyModel):
    tab = tested.page.tab
    tab.session.edit_follower.after_edits = False
    left, right = (fitted_hand(tested, tiny_body, side) for side in FINGER_JOINTS)
    tab.set(frame=5)
    tested.press("action", "shape_other")
    np.testing.assert_allclose(shape_of(tested.last_edit), in_hand(left[5], "right"), atol=1e-5)
    assert tested.last_edit.name == "left hand of frame 5"
    assert "Copied" not in tested.html()
    tested.press("action", "copy_shape")
    tab.set(frame=2)
    tested.press("action", "shape_copied")
    np.testing.assert_allclose(shape_of(tested.last_edit), right[5], atol=1e-5)
    tested.press("action", "select_left_hand")
    tested.press("action", "shape_last")
    edit = tested.last_edit
    assert edit.joints == FINGER_JOINTS["left"] and edit.name == "right hand of frame 5"
    np.testing.assert_allclose(shape_of(edit), in_hand(right[5], "right"), atol=1e-5)


def test_it_ends_at_the_ends_of_the_clip(tested: LonePage):
    tab = tested.page.tab
    tab.session.edit_follower.after_edits = False
    assert tab.length == 8
    for frames, covered, blend in (
        (range(0, 2), range(0, 6), (0, 4)),
        (range(1, 2), range(1, 6), (0, 4)),
        (range(3, 4), range(1, 7), (2, 3)),
        (range(7, 8), range(3, 8), (4, 0)),
    ):
        tab.set(frame=frames[0], frames=frames)
        tested.press("action", "shape_fist")
        assert tested.last_edit.frames == tuple(covered) and tested.last_edit.blend == blend


def test_it_is_taken_off(tested: LonePage):
    tab = tested.page.tab
    tab.session.edit_follower.after_edits = False
    tab.set(frame=4)
    with pytest.raises(InputError, match="No hand shape is set in frame 4"):
        tested.press("action", "free_hand")
    tested.press("action", "shape_claw")
    tested.press("action", "free_hand")
    assert tested.last_edit.shape is None and tab.message[0] == "Saved: right hand's shape removed, frame 4"
    assert np.isfinite(tab.session.project.corrected.turn[..., 0]).any(0).sum() == 15, "the blends stay"


@pytest.mark.parametrize("selection", [(), (0, 3), (RIGHT, LEFT_HAND.start)])
def test_a_hand_must_be_selected(tested: LonePage, selection: tuple[int, ...]):
    tested.page.tab.set(selection=selection)
    with pytest.raises(InputError, match="Select a hand first"):
        tested.press("action", "shape_fist")
    assert "Hand shape" not in tested.html()


def test_shapes_of_ones_own(tested: LonePage, tiny_body: BodyModel, own: Path):
    tab = tested.page.tab
    tab.session.edit_follower.after_edits = False
    left = fitted_hand(tested, tiny_body, "left")[3]
    tab.set(frame=3, selection=(LEFT_HAND.start,))
    tested.enter("Own shape", " bent B ")
    tested.press("shapes.save")
    np.testing.assert_allclose(json.loads(own.read_text())["shapes"]["bent B"], left, atol=1e-5)
    tab.set(frame=5, selection=(RIGHT,))
    tested.press("shapes.own", "bent B")
    edit = tested.last_edit
    assert edit.name == "bent B" and edit.joints == FINGER_JOINTS["right"]
    np.testing.assert_allclose(shape_of(edit), in_hand(left, "right"), atol=2e-5)
    tested.press("shapes.delete")
    assert json.loads(own.read_text())["shapes"] == {}
    with pytest.raises(InputError, match="no longer there"):
        tested.page.gestures.shaping.give_own("bent B")
    for name, message in (("fist", "one of tcfit's shapes"), ("", "1 to 30 characters"), ("x" * 31, "1 to 30")):
        tested.enter("Own shape", name)
        with pytest.raises(InputError, match=message):
            tested.press("shapes.save")


@pytest.mark.parametrize("content", [
    b"{",
    b"[]",
    b'{"format": "tcfit handshapes 2", "shapes": {}}',
    b'{"format": "tcfit handshapes 1", "shapes": {"B": [[0, 0, 0]]}}',
    b'{"format": "tcfit handshapes 1", "shapes": {" ": []}}',
    json.dumps({"format": "tcfit handshapes 1", "shapes": {"B": [[9, 0, 0]] * 15}}).encode(),
    b'{"format": "tcfit handshapes 1", "shapes": {}, "more": 1}',
    b" " * (2**20 + 1),
], ids=range(8))  # fmt: skip
def test_a_broken_file_is_told_and_kept(tested: LonePage, own: Path, content: bytes):
    own.parent.mkdir()
    own.write_bytes(content)
    assert "your handshapes cannot be read" in tested.html() and tested.button("Save shape").disabled
    with pytest.raises(InputError, match="your handshapes cannot be read"):
        keep_handshape("B", np.zeros((15, 3)))
    assert own.read_bytes() == content
    assert not tested.button("Fist").disabled


def test_numbers_that_are_none_are_not_kept(own: Path):
    with pytest.raises(InputError):
        keep_handshape("B", np.full((15, 3), np.nan))
    assert not own.exists()
