"""Limbs of one fit taken into the other: what is stored, what is said, and that the fit follows."""

import numpy as np
import pytest

from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import full_pose
from fitting_core.errors import InputError
from fitting_core.keypoints import FINGER_JOINTS, INDEX, LOCKABLE
from tcfit_app.project.edits.kinds import TakeRotations
from tcfit_app.project.edits.packed_points import unpacked
from tcfit_app.review.panels.compare_panel import ComparePanel
from tcfit_app.review.tab.state import FitSettings
from tests.drivers.lone_page import LonePage
from tests.samples.sessions import QUICK

ARM = [INDEX[f"right_{name}"] for name in ("shoulder", "elbow", "wrist")]


@pytest.fixture
def tested(fitted_page: LonePage) -> LonePage:
    """With a fit, whose phase 1 is A."""
    fitted_page.only(ComparePanel)
    fitted_page.page.tab.set(settings=FitSettings(config=QUICK, preset="paper"))
    return fitted_page


def rotations(tested: LonePage, body: BodyModel, slot: str) -> np.ndarray:
    shown = tested.page.tab.look().fit("a" if slot == "a" else "b")
    assert shown is not None
    return full_pose(body, shown.params).numpy()


def taken(tested: LonePage) -> tuple[TakeRotations, np.ndarray]:
    edit = tested.page.tab.session.project.log[-1].action
    assert isinstance(edit, TakeRotations)
    return edit, unpacked(edit.packed, len(edit.frames), len(edit.joints), 3)


def test_an_arm_is_taken_with_its_hand_and_the_fit_follows(tested: LonePage, tiny_body: BodyModel):
    tab = tested.page.tab
    a, b = (rotations(tested, tiny_body, slot) for slot in "ab")
    wrist, elbow = JOINT["right_wrist"], JOINT["right_elbow"]
    assert np.degrees(np.abs(a[1:7, [elbow]] - b[1:7, [elbow]])).max() > 0.5, "the phases differ"
    tab.set(frame=4, frames=range(1, 7), selection=(INDEX["right_wrist"],))
    tested.press("action", "take_from_a")
    edit, turns = taken(tested)
    assert edit.frames == (1, 2, 3, 4, 5, 6) and set(edit.joints) == {*ARM, *FINGER_JOINTS["right"]}
    at = edit.joints.index(INDEX["right_elbow"])
    np.testing.assert_allclose(turns[2:4, at], a[3:5, elbow], atol=1e-5)
    low, high = np.minimum(a, b)[1, elbow] - 1e-3, np.maximum(a, b)[1, elbow] + 1e-3
    assert ((turns[0, at] >= low) & (turns[0, at] <= high)).all(), "between both at the ends"
    assert tab.message[0].startswith("Saved: right arm, right hand taken from ") and "frames 1–6" in tab.message[0]
    tested.until(lambda: not tab.session.jobs and not tab.session.edit_follower.busy)
    after = rotations(tested, tiny_body, "b")
    for joint in (wrist, elbow):
        assert np.degrees(np.abs(after[3:5, joint] - a[3:5, joint])).max() < 1
    tested.press("action", "undo")
    assert tab.session.project.clip.keypoints.turn is None


def test_without_selected_keypoints_all_limbs_are_taken_in_one_frame(tested: LonePage, tiny_body: BodyModel):
    tab = tested.page.tab
    tab.session.edit_follower.after_edits = False
    tab.set(frame=4, selection=())
    tested.press("action", "take_from_a")
    edit, turns = taken(tested)
    assert edit.frames == (4,)
    assert set(edit.joints) == {*LOCKABLE, *FINGER_JOINTS["left"], *FINGER_JOINTS["right"]}
    at = edit.joints.index(INDEX["nose"])
    np.testing.assert_allclose(turns[0, at], rotations(tested, tiny_body, "a")[4, JOINT["head"]], atol=1e-5)
    tab.set(selection=(FINGER_JOINTS["left"][3],))
    tested.press("action", "take_from_a")
    assert set(taken(tested)[0].joints) == {*FINGER_JOINTS["left"]}


def test_what_cannot_be_taken_is_said_and_changes_nothing(tested: LonePage):
    tab, log = tested.page.tab, len(tested.page.tab.session.project.log)
    tab.set(selection=(INDEX["mid_hip"],))
    with pytest.raises(InputError, match="select a keypoint of one, or none"):
        tested.press("action", "take_from_a")
    tab.set(selection=(), a=tab.state.b)
    with pytest.raises(InputError, match="choose two fits"):
        tested.press("action", "take_from_a")
    assert 'value="take_from_a"' not in tested.html() and len(tab.session.project.log) == log
