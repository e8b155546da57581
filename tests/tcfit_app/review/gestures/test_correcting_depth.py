"""Correcting depth with the panels' buttons and keys: what is stored, what is said, and that the fit follows."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX
from tcfit_app.project.edits.kinds import ClearDepth, Lock, MarkBad, Pin, SetDepth, Unlock
from tcfit_app.project.project import Project
from tcfit_app.review.browser.page_events import DragDepth
from tcfit_app.review.gestures.edit_words import describe
from tcfit_app.review.panels.correct.correct_panel import CorrectPanel
from tcfit_app.review.tab.state import FitSettings, Mode
from tcfit_app.review.tab.tab import Tab
from tests.drivers.lone_page import LonePage
from tests.samples.sessions import QUICK

ROOT, ELBOW, WRIST = (INDEX[f"right_{n}"] for n in ("shoulder", "elbow", "wrist"))

PERSPECTIVE = 0.1
"""Metres by which a limb that looks alike is off the mirror image in depth, 2.5 m from the camera."""


@pytest.fixture
def tested(fitted_page: LonePage) -> LonePage:
    fitted_page.only(CorrectPanel)
    fitted_page.page.tab.set(settings=FitSettings(config=QUICK, preset="paper"))
    return fitted_page


def depths(tested: LonePage, body: BodyModel) -> np.ndarray:
    """Of the fit on show, behind the pelvis, metres."""
    params = tested.shown.params
    return keypoints_in_space(body, params)[0][..., 2] - joints_in_space(body, params)[:, :1, 2]


def test_a_limb_is_mirrored_and_the_fit_follows(tested: LonePage, tiny_body: BodyModel):
    tab = tested.page.tab
    before = depths(tested, tiny_body)
    target = 2 * before[:, [ROOT]] - before[:, [ELBOW, WRIST]]
    tab.seek(4)
    tab.set(selection=(WRIST,))
    tested.press("action", "mirror_depth")
    edit = tested.last_edit
    assert isinstance(edit, SetDepth) and (edit.frames, edit.joints) == ((4,), (ELBOW, WRIST))
    np.testing.assert_allclose(edit.depth, target[[4]], atol=PERSPECTIVE)
    assert tab.message[0].startswith("Saved: right elbow, right wrist put ") and "the pelvis" in tab.message[0]
    assert "the pelvis." in tested.html(), "beside the keypoint that is selected"
    tested.idle()
    way, left = (abs(fit[4, [ELBOW, WRIST]] - edit.depth[0]).max() for fit in (before, depths(tested, tiny_body)))
    assert left < max(0.03, 0.3 * way)
    tested.press("action", "undo")
    assert np.isnan(tab.session.project.corrected.depth).all() and tab.message[0].startswith("Undone: right elbow")
    tested.idle()


@pytest.mark.parametrize(("name", "sign"), [("in_front", -1), ("behind", 1)])
def test_a_range_goes_to_one_side(tested: LonePage, tiny_body: BodyModel, name: str, sign: int):
    tab, before = tested.page.tab, depths(tested, tiny_body)
    tab.session.edit_follower.after_edits = False
    tab.set(frame=2, frames=range(2, 6), selection=(ELBOW, INDEX["left_ankle"]))
    tested.press("action", name)
    edit = tested.last_edit
    assert isinstance(edit, SetDepth) and edit.frames == (2, 3, 4, 5)
    assert edit.joints == (INDEX["left_knee"], INDEX["left_ankle"], ELBOW, WRIST)
    hip, shoulder = (before[2:6, [INDEX[n]]] for n in ("left_hip", "right_shoulder"))
    off = np.array(edit.depth) - np.hstack([hip, hip, shoulder, shoulder])
    assert (sign * off >= -1e-4).all()
    stored = tab.session.project.clip.keypoints.told_depth
    assert np.isfinite(stored).sum() == 4 * 4
    with Project.open(tab.session.project.folder, read_only=True) as copy:
        np.testing.assert_array_equal(copy.clip.keypoints.told_depth, stored)


def test_depths_are_cleared(tested: LonePage):
    tab, project = tested.page.tab, tested.page.tab.session.project
    tab.session.edit_follower.after_edits = False
    project.append(SetDepth(frames=(1, 5), joints=(ELBOW, WRIST), depth=((0.1, 0.2), (0.3, -0.2))))
    tab.set(selection=(WRIST,), frame=3, frames=range(1, 6))
    tested.press("action", "clear_depth")
    assert tested.last_edit == ClearDepth(frames=(1, 2, 3, 4, 5), joints=(ELBOW, WRIST))
    assert project.clip.keypoints.depth is None
    with pytest.raises(InputError, match="No depth is set"):
        tested.press("action", "clear_depth")


def test_a_joint_is_pinned_where_it_is_now(tested: LonePage, tiny_body: BodyModel):
    tab = tested.page.tab
    tab.seek(4)
    tab.set(selection=(WRIST,))
    with pytest.raises(InputError, match="First select the frames"):
        tested.press("action", "pin")
    where = keypoints_in_space(tiny_body, tested.shown.params)[0][4, WRIST]
    tab.set(frames=range(2, 7))
    tested.press("action", "pin")
    edit = tested.last_edit
    assert isinstance(edit, Pin) and (edit.frames, edit.joints) == ((2, 3, 4, 5, 6), (WRIST,))
    assert tab.message[0] == "Saved: right wrist pinned in space, frames 2–6"
    tested.idle()
    after = keypoints_in_space(tiny_body, tested.shown.params)[0][2:7, WRIST]
    assert np.linalg.norm(after - where, axis=1).max() < 0.05
    tab.set(selection=(WRIST, 30))
    with pytest.raises(InputError, match="1 of the selected keypoints are not body keypoints"):
        tested.press("action", "pin")


def test_a_joint_is_locked_as_it_is_turned(tested: LonePage):
    tab = tested.page.tab
    tab.seek(4)
    tab.set(selection=(WRIST, 30), frames=range(2, 7))
    wrist = slice(3 * (JOINT["right_wrist"] - 1), 3 * JOINT["right_wrist"])
    turn = tested.shown.params.body_pose[4, wrist]
    tested.press("action", "lock")
    edit = tested.last_edit
    assert isinstance(edit, Lock) and (edit.frames, edit.joints) == ((2, 3, 4, 5, 6), (WRIST,))
    np.testing.assert_allclose(edit.turn, [turn.tolist()], atol=1e-5)
    assert tab.message[0] == "Saved: right wrist rotation locked, frames 2–6"
    tested.idle()
    assert abs(tested.shown.params.body_pose[2:7, wrist] - turn).max() < 0.05
    tested.press("action", "unlock")
    assert tested.last_edit == Unlock(frames=(2, 3, 4, 5, 6), joints=(WRIST,))
    with pytest.raises(InputError, match="None of the selected joints is locked in frames 2–6"):
        tested.press("action", "unlock")
    tab.set(selection=(30,))
    with pytest.raises(InputError, match="can be locked: select one of them"):
        tested.press("action", "lock")


def test_what_cannot_be_said_of_depth(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    tab = tested.page.tab
    with pytest.raises(InputError, match="Select keypoints first"):
        tested.press("action", "mirror_depth")
    tab.set(selection=(0,))
    with pytest.raises(InputError, match="select an elbow"):
        tested.press("action", "mirror_depth")
    tab.set(selection=(WRIST,))
    tab.session.project.append(MarkBad(frames=(0,), joints=(ELBOW, WRIST)))
    with pytest.raises(InputError, match="marked bad"):
        tested.press("action", "behind")
    monkeypatch.setattr(tab, "look", lambda: replace(tab.shown, b=None))
    with pytest.raises(InputError, match="fit first"):
        tested.press("action", "behind")
    assert len(tab.session.project.log) == 1


def swap_arms(tab: Tab, monkeypatch: pytest.MonkeyPatch, *, unswapping: bool) -> None:
    """Let the detector have swapped the arms in frame 4, and the fit have unswapped them or not."""
    shown = tab.look().b
    assert shown is not None
    run = replace(shown.run, config=replace(shown.run.config, unswap_sides=unswapping))
    monkeypatch.setattr(tab, "look", lambda: replace(tab.shown, b=replace(shown, run=run)))
    monkeypatch.setattr("tcfit_app.review.gestures.correcting.unswapped", lambda k: (k, {"arms": np.array([4])}))


@pytest.mark.parametrize("unswapping", [False, True])
def test_a_keypoint_that_the_fit_swaps_back_takes_the_other_arms_depth(
    tested: LonePage, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch, unswapping: bool
):
    tab, before = tested.page.tab, depths(tested, tiny_body)
    tab.session.edit_follower.after_edits = False
    swap_arms(tab, monkeypatch, unswapping=unswapping)
    tab.set(frame=3, frames=range(3, 5), selection=(WRIST,))
    tested.page.gestures.depth.send("mirror")
    edit = tested.last_edit
    assert isinstance(edit, SetDepth)
    for row, frame, side in ((0, 3, "right"), (1, 4, "left" if unswapping else "right")):
        root, wrist = INDEX[f"{side}_shoulder"], INDEX[f"{side}_wrist"]
        np.testing.assert_allclose(edit.depth[row][1], 2 * before[frame, root] - before[frame, wrist], atol=PERSPECTIVE)


@pytest.mark.parametrize(("mode", "locked", "side"), [("edit", "left", "right"), ("space", "right", "left")])
def test_the_joint_is_locked_and_the_depth_set_that_is_seen_at_a_swapped_keypoint(
    tested: LonePage, monkeypatch: pytest.MonkeyPatch, mode: Mode, locked: str, side: str
):
    tab = tested.page.tab
    tab.session.edit_follower.after_edits = False
    swap_arms(tab, monkeypatch, unswapping=True)
    tab.set(frame=4, selection=(WRIST,), mode=mode)
    tested.press("action", "lock")
    edit, wrist = tested.last_edit, INDEX[f"{locked}_wrist"]
    assert isinstance(edit, Lock) and edit.joints == (wrist,)
    tested.press("action", "unlock")
    assert tested.last_edit == Unlock(frames=(4,), joints=(wrist,))
    tested.page.gestures.depth.send("mirror")
    edit, of_side = tested.last_edit, tuple(INDEX[f"{side}_{name}"] for name in ("elbow", "wrist"))
    assert isinstance(edit, SetDepth) and edit.joints == of_side
    tested.page.gestures.depth.clear_depth()
    assert tested.last_edit == ClearDepth(frames=(4,), joints=of_side)


def test_the_limb_that_is_dragged_in_depth_is_the_one_on_show(
    tested: LonePage, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    tab, before = tested.page.tab, depths(tested, tiny_body)
    tab.session.edit_follower.after_edits = False
    swap_arms(tab, monkeypatch, unswapping=True)
    tab.set(frame=4)
    moves: tuple[tuple[Literal["start", "move", "end"], float], ...] = ("start", 0.0), ("move", 0.1), ("end", 0.1)
    for phase, metres in moves:
        tested.page.receive(DragDepth(phase, WRIST, metres, 4))
    edit = tested.last_edit
    assert isinstance(edit, SetDepth) and edit.joints == (INDEX["left_wrist"],)
    assert edit.depth[0][0] == pytest.approx(before[4, WRIST] + 0.1, abs=PERSPECTIVE)


@pytest.mark.parametrize(
    ("depth", "words"),
    [
        (((-0.12,),), "right wrist put 12 cm in front of the pelvis, frame 7"),
        (((0.12,), (0.304,)), "right wrist put 12 to 30 cm behind the pelvis, frames 7–8"),
        (((-0.12,), (-0.3,)), "right wrist put 12 to 30 cm in front of the pelvis, frames 7–8"),
        (((-0.12,), (0.3,)), "right wrist put 12 cm in front of to 30 cm behind the pelvis, frames 7–8"),
        (((0.001,),), "right wrist put 0 cm behind the pelvis, frame 7"),
    ],
)
def test_depths_in_words(depth: tuple, words: str):
    assert describe(SetDepth(frames=tuple(range(len(depth))), joints=(WRIST,), depth=depth), 7) == words
