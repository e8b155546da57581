"""The panel Correct: what acts on the selection, corrections and their history."""

import time

import numpy as np
import pytest

from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX
from tcfit_app.project.edits.kinds import CopyFrom, MarkBad, Restore, SwapSides
from tcfit_app.review.browser.page_events import Drag
from tcfit_app.review.panels.correct.correct_panel import CorrectPanel
from tests.drivers.lone_page import LonePage

FIRST = 7
"""The number that users see for frame 0 of the sample clip."""


def test_keypoints_are_selected_in_every_mode_but_not_while_they_are_hidden(tested: LonePage):
    page = tested.page
    page.tab.set(keypoints=False)
    with pytest.raises(InputError, match="Keypoints are hidden"):
        page.gestures.correcting.select_all()
    assert page.tab.state.selection == ()
    page.tab.set(mode="space", keypoints=True)
    page.gestures.correcting.select_all()
    chosen = page.tab.state.selection
    page.gestures.correcting.toggle_bad()
    assert chosen and page.tab.session.project.corrected.bad[0, list(chosen)].all()


def test_keypoints_under_the_pointer_are_left_alone_by_keys(tested: LonePage):
    page, frame = tested.page, 2
    page.tab.set(frame=frame, selection=(4,))
    page.gestures.correcting.reset()
    before = page.tab.session.project.last_edit
    page.receive(Drag("start", (4,), 0.0, 0.0, frame))
    for command in (page.gestures.correcting.toggle_bad, page.gestures.correcting.undo, page.gestures.correcting.redo):
        with pytest.raises(InputError, match="being dragged"):
            command()
    assert page.tab.session.project.last_edit == before
    page.receive(Drag("end", (4,), 3.0, 0.0, frame))
    page.gestures.correcting.toggle_bad()
    assert page.tab.session.project.last_edit == before + 2 and page.tab.session.project.corrected.bad[frame, 4]


def test_correcting_buttons_and_where_they_apply(tested: LonePage):
    page = tested.page
    page.tab.seek(2)
    assert f"<b>Nothing selected</b><span>frame {FIRST + 2}<" in tested.html()
    page.tab.set(frames=range(1, 4), selection=(4,))
    assert f"<b>Right wrist</b><span>frames {FIRST + 1}–{FIRST + 3}<" in tested.html()
    tested.press("action", "bad")
    assert tested.last_edit == MarkBad(frames=(1, 2, 3), joints=(4,))
    assert ">Restore</span><kbd>X</kbd>" in tested.html()
    tested.press("action", "select_left_hand")
    assert "<b>Left hand</b>" in tested.html()
    tested.press("action", "bad")
    assert tested.last_edit == MarkBad(frames=(1, 2, 3), joints=tuple(range(25, 46)))
    tested.press("action", "bad")
    assert tested.last_edit == Restore(frames=(1, 2, 3), joints=tuple(range(25, 46)))
    page.tab.set(selection=(4,))
    tested.press("action", "swap_arms")
    assert isinstance(tested.last_edit, SwapSides)


def test_copies_go_to_all_selected_frames(tested: LonePage):
    page = tested.page
    there = np.flatnonzero(page.tab.session.project.detections.confidence[1] > 0)
    page.tab.set(frames=range(2, 4), selection=(int(there[0]),))
    page.tab.seek(3)
    tested.press("action", "copy")
    assert tested.last_edit == CopyFrom(frames=(2, 3), joints=(int(there[0]),), source=1)


def test_what_is_nowhere_is_not_copied_or_moved(tested: LonePage):
    page = tested.page
    missing = int(np.flatnonzero(page.tab.session.project.detections.confidence[1] == 0)[0])
    page.tab.seek(1)
    page.tab.set(selection=(missing,))
    assert "Not detected." in tested.html()
    correcting = page.gestures.correcting
    with pytest.raises(InputError, match=f"none of the selected keypoints exists in frame {FIRST + 1}"):
        correcting.nudge(1.0, 0.0)
    page.tab.seek(2)
    with pytest.raises(InputError, match=f"Cannot be copied.* frame {FIRST + 1}"):
        correcting.copy_previous()
    assert not page.tab.session.project.log


def test_all_keypoints_are_those_on_show(tested: LonePage):
    page = tested.page
    page.tab.set(groups=frozenset({"body", "left_hand"}))
    confidence = page.tab.session.project.detections.confidence
    tested.press("action", "all")
    assert page.tab.state.selection == tuple(np.flatnonzero(confidence[0, :46]))
    page.tab.set(frames=range(3))
    tested.press("action", "all")
    assert page.tab.state.selection == tuple(np.flatnonzero(confidence[:3, :46].any(0))), "seen in any of the frames"


def test_selecting_by_name(tested: LonePage):
    tested.draw()
    tested.enter("Keypoint", "right wrist")
    assert tested.page.tab.state.selection == (INDEX["right_wrist"],)
    tested.draw()
    assert not tested.field("Keypoint").visible, "another one is selected in the picture"
    tested.page.tab.set(selection=())
    tested.draw()
    assert tested.field("Keypoint").visible and tested.field("Keypoint").value == "Find by name"


def test_an_undo_of_an_edit_of_someone_else_asks_first(tested: LonePage):
    tab = tested.page.tab
    me, project = tab.author, tab.session.project
    tab.author = "anna"
    tab.set(selection=(4,))
    tab.seek(2)
    tested.press("action", "bad")
    tab.author = me
    tab.seek(0)
    tested.press("action", "undo")
    question = f"Ctrl+Z again to undo the edit of anna: right wrist marked bad, frame {FIRST + 2}"
    assert tab.message[0] == question and tab.message[1] > time.monotonic() + 8, "long enough to be read"
    assert tab.state.frame == 2 and project.undoable is not None
    tab.set(selection=(5,))
    tested.press("action", "bad")
    tested.press("action", "undo")
    assert tab.message[0].startswith("Undone: left shoulder"), "an own edit needs no question"
    tested.press("action", "undo")
    assert tab.message[0] == question, "the answer was for another question"
    tested.press("action", "undo")
    assert tab.message[0].endswith("(made by anna)") and project.undoable is None
    tested.press("action", "redo")
    assert tab.message[0].startswith("Ctrl+Y again to redo the edit of anna") and project.undoable is None
    tested.press("action", "redo")
    assert project.undoable is not None


def test_history(tested: LonePage):
    page = tested.page
    page.tab.set(selection=(4,), folds={"corrections"})
    tested.press("action", "bad")
    tested.press("action", "undo")
    assert page.tab.message[0] == f"Undone: right wrist marked bad, frame {FIRST}"
    tested.press("action", "redo")
    page.tab.author = "another"
    tested.press("action", "undo")
    tested.press("action", "undo")
    assert page.tab.message[0].endswith("(made in another browser)")
    shown = tested.html()
    assert 'class="tcfit-off"' in shown
    page.tab.seek(5)
    tested.press("correct.visit", str(page.tab.session.project.log[0].id))
    assert page.tab.state.frame == 0 and page.tab.state.selection == (4,) and not page.tab.state.suggested
    tested.press("correct.follow")
    assert not page.tab.session.edit_follower.after_edits


@pytest.mark.parametrize(("names", "frames", "count"), [
    ((), None, 4),
    (("right_elbow",), None, 8),
    (("right_wrist",), None, 12),
    (("left_thumb4",), range(3), 12),
    (("nose", "left_ankle"), range(3), 8),
    (("right_wrist",), range(3, 5), 4),
])  # fmt: skip
def test_what_is_on_show_acts_on_what_is_selected(
    tested: LonePage, names: tuple[str, ...], frames: range | None, count: int
):
    tested.panels = []
    before = tested.html().count("<button")  # other panels have some from the start
    tested.only(CorrectPanel)
    tested.page.tab.set(selection=tuple(INDEX[name] for name in names), frames=frames)
    shown = tested.html()
    assert shown.count("<button") - before + tested.field("Keypoint").visible == count <= 12
    assert ("Hand shape" in shown) == (count == 12) and ("Depth, pin, lock" in shown) == (count > 4)
    assert ("Go there" in shown) == (frames == range(3, 5))


def test_several_are_counted_by_their_state(tested: LonePage):
    tab = tested.page.tab
    there = np.flatnonzero(tab.session.project.detections.confidence[:3].all(0))[:2].tolist()
    tab.set(selection=tuple(there))
    tested.press("action", "bad")
    assert "Both keypoints marked bad." in tested.html()
    tab.set(frames=range(3))
    assert "4 detected, 2 marked bad, of 6 keypoints." in tested.html()
    tab.set(selection=(there[0],))
    assert "2 detected, 1 marked bad, of 3 frames." in tested.html()
