"""The panels View, Keypoints and Review: what their buttons and inputs do, and what they send."""

import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser
from viser import _gui_api, _gui_handles
from viser._icons import svg_from_icon

from fitting_core.errors import InputError
from fitting_core.keypoints import GROUPS, INDEX
from tcfit_app.analysis.body_regions import LIMB_OF
from tcfit_app.analysis.findings import WHOLE
from tcfit_app.analysis.suspicion import ReviewQueue, Suspect
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.kinds import CopyFrom, MarkBad, Restore, SwapSides
from tcfit_app.project.project import Project
from tcfit_app.review.browser.page_events import Drag, LookAt
from tcfit_app.review.drawing.status import lasting
from tcfit_app.review.gestures.actions import ACTIONS
from tcfit_app.review.gestures.zooming import surroundings, zoom_to_selection
from tcfit_app.review.page import SKELETON
from tcfit_app.review.panels import PANELS
from tcfit_app.server.viser_bridge import icon, keep_icons_open
from tests.drivers.lone_page import LonePage, lone_page, sample_project
from tests.samples.media import write_images
from tests.samples.project_samples import FRAMES

ATTACK = "<img src=x onerror=alert(1)>"
FIRST = 7
"""The number that users see for frame 0 of the sample clip."""


@pytest.fixture
def project(tmp_path: Path) -> Iterator[Project]:
    with sample_project(tmp_path / "walk.tcfit", "first", ATTACK) as made:
        yield made


@pytest.fixture
def tested(panel_server: viser.ViserServer, project: Project) -> Iterator[LonePage]:
    with lone_page(panel_server, project) as made:
        yield made


def suspect(frame: int, *, reason: str = "left wrist 42 px off", joints: tuple[int, ...] = (7,)) -> Suspect:
    frames = range(frame, frame + 1)
    return Suspect(
        frame=frame, frames=frames, score=2.0, kind="cost", reason=reason, joints=joints, about=("left arm",), also=()
    )


def with_suspects(tested: LonePage, *found: Suspect) -> None:
    queue = ReviewQueue(left=found, looked_at=1)
    tested.page.tab.data.queue = lambda shown: queue  # pyright: ignore[reportAttributeAccessIssue]


def test_nothing_is_sent_when_nothing_has_changed(tested: LonePage):
    with_suspects(tested, suspect(2))
    assert tested.draw()
    assert not tested.draw()
    tested.page.tab.seek(3)
    assert tested.draw()
    assert not tested.draw()


def test_only_keypoints_in_the_picture_are_zoomed_to(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    page, seen = tested.page, []
    monkeypatch.setattr(page.tab.scene, "zoom_to", seen.append)
    detected = page.tab.session.project.corrected.confidence[0] > 0
    there, absent = np.flatnonzero(detected)[:2].tolist(), int(np.flatnonzero(~detected)[0])
    page.tab.set(selection=(*there, absent))
    zoom_to_selection(page.tab)
    page.tab.set(selection=tuple(there))
    zoom_to_selection(page.tab)
    assert seen[0] == seen[1]
    page.tab.set(selection=(absent,))
    with pytest.raises(InputError, match="nothing to zoom to"):
        zoom_to_selection(page.tab)


@pytest.mark.parametrize("size", [(45, 60), (640, 480), (3840, 2160)])
def test_zooming_leaves_room_and_stays_in_the_picture(size: tuple[int, int]):
    width, height = size
    middle, diagonal = np.array([[width / 2, height / 2]]), np.hypot(*size)
    assert np.allclose(surroundings(middle, size), middle + diagonal / 30 * np.array([[-1], [1]]))
    corners = np.array([[0.0, 1.0], [width, height - 1]])
    assert np.allclose(surroundings(corners, size), [[0, 0], [width, height]])
    assert np.allclose(surroundings(np.array([[-9.0, 1.0]]), size)[0], [-9, max(0, 1 - diagonal / 30)])
    length, along = max(size), int(np.argmax(size))
    far = np.ones((2, 2))
    far[:, along] = length / 4, 3 * length / 4
    assert np.allclose(surroundings(far, size)[:, along], [0.15 * length, 0.85 * length])


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


def test_a_keypoint_has_one_name_wherever_it_is_read(tested: LonePage):
    joints = tuple(INDEX[name] for name in ("left_wrist", "left_index4", "face_outer_lip3"))
    names = ("left wrist", "left index tip", "face outer lip 3")
    page = tested.page
    page.tab.set(selection=joints)
    page.gestures.correcting.toggle_bad()
    assert page.tab.message[0].startswith(f"Saved: {', '.join(names)} marked bad")
    assert all(f">{name}<" in tested.html() for name in names)
    assert set(names) <= set(tested.field("Keypoint").options)
    assert [SKELETON.names[joint] for joint in joints] == list(names)


def test_playing_sends_little(tested: LonePage):
    with_suspects(tested)
    tested.page.tab.toggle_playing()
    tested.draw()
    tested.page.tab.set(frame=2)
    assert len(tested.draw()) == 1  # the number in the field "Frame"


@pytest.mark.parametrize("hidden", ["run", "author", "reason"])
def test_what_others_wrote_is_shown_as_text(hidden: str, tested: LonePage):
    if hidden == "author":
        tested.page.tab.session.edit(MarkBad(frames=(1,), joints=(4,)), author=ATTACK)
    if hidden == "reason":
        with_suspects(tested, suspect(2, reason=ATTACK))
    shown = tested.html()
    assert "<img" not in shown
    # Dropdowns show options as text by themselves.
    assert (hidden == "run" and ATTACK in tested.field("A shows").options) or "&lt;img src=x" in shown


def test_what_the_server_sets_is_no_wish_of_the_user(tested: LonePage):
    tested.draw()
    frame = tested.field("Frame")
    tested.page.tab.seek(3)
    tested.draw()
    assert frame.value == FIRST + 3 and tested.page.tab.state.frame == 3
    frame._impl.value = FIRST + 1
    tested.call_back(frame, None)
    assert tested.page.tab.state.frame == 3


def test_view_inputs(tested: LonePage):
    tested.draw()
    page = tested.page
    tested.enter("Frame", FIRST + 4)
    assert page.tab.state.frame == 4


def test_view_buttons(tested: LonePage):
    tested.draw()
    page = tested.page
    tested.press("action", "space")
    tested.press("action", "ghost")
    assert page.tab.state.mode == "space" and page.tab.state.ghost
    tested.press("view.group", "face")
    assert page.tab.state.groups == set(GROUPS) - {"face"}
    tested.press("action", "keypoints")
    tested.press("view.speed", "0.25")
    assert (page.tab.state.keypoints, page.tab.state.speed) == (False, 0.25)
    assert 'data-value="0.25" aria-pressed="true"' in tested.html()


def test_choosing_runs_and_phases(tested: LonePage):
    tested.draw()
    page, runs = tested.page, tested.page.tab.session.fits.runs
    assert tested.field("B shows").options == ("Newest", ATTACK, "first")
    tested.enter("B shows", "first")
    tested.press("runs.phase_b", "2")
    assert page.tab.state.b == FitChoice(run=runs[0].id, phase=2)
    tested.enter("A shows", "first")
    tested.draw()
    assert tested.field("A shows").value == "first"
    page.tab.session.delete(runs[0].id)
    tested.draw()
    assert tested.field("A shows").value == "Newest"


def test_correcting_buttons_and_where_they_apply(tested: LonePage):
    page = tested.page
    page.tab.seek(2)
    assert f"apply to frame {FIRST + 2}<" in tested.html()
    page.tab.set(frames=range(1, 4), selection=(4,))
    assert f"apply to frames {FIRST + 1}–{FIRST + 3}<" in tested.html()
    tested.press("action", "bad")
    assert last_edit(page) == MarkBad(frames=(1, 2, 3), joints=(4,))
    assert ">Restore</span><kbd>X</kbd>" in tested.html()
    assert f"apply to frames {FIRST + 1}–{FIRST + 3}" in tested.html()
    page.tab.set(frames=None)
    assert ">Restore</span><kbd>X</kbd>" in tested.html()
    page.tab.set(frames=range(1, 4))
    tested.press("keypoints.group", "left_hand")
    tested.press("action", "bad")
    assert last_edit(page) == MarkBad(frames=(1, 2, 3), joints=tuple(range(25, 46)))
    tested.press("action", "bad")
    assert last_edit(page) == Restore(frames=(1, 2, 3), joints=tuple(range(25, 46)))
    page.tab.set(selection=(4,))
    tested.press("keypoints.swap", "arms")
    assert isinstance(last_edit(page), SwapSides)


def test_copies_go_to_all_selected_frames(tested: LonePage):
    page = tested.page
    there = np.flatnonzero(page.tab.session.project.detections.confidence[1] > 0)
    page.tab.set(frames=range(2, 4), selection=(int(there[0]),))
    page.tab.seek(3)
    tested.press("action", "copy")
    assert last_edit(page) == CopyFrom(frames=(2, 3), joints=(int(there[0]),), source=1)


def test_what_is_nowhere_is_not_copied_or_moved(tested: LonePage):
    page = tested.page
    missing = int(np.flatnonzero(page.tab.session.project.detections.confidence[1] == 0)[0])
    page.tab.seek(1)
    page.tab.set(selection=(missing,))
    assert "missing" in tested.html()
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
    page.tab.set(keypoints=False)
    with pytest.raises(InputError, match="hidden"):
        tested.press("action", "all")


def last_edit(page) -> object:
    return page.tab.session.project.log[-1].action


def test_a_moved_keypoint_says_where_it_was(tested: LonePage):
    page = tested.page
    joint = int(np.flatnonzero(page.tab.session.project.detections.confidence[0] > 0)[0])
    page.tab.set(selection=(joint,))
    before = page.tab.session.project.corrected.xy[0, joint].copy()
    tested.press("action", "nudge_right")
    shown = tested.html()
    assert "corrected" in shown and f"was {before[0]:.1f}, {before[1]:.1f}" in shown


def test_selecting_by_name(tested: LonePage):
    tested.draw()
    tested.enter("Keypoint", "right wrist")
    assert tested.page.tab.state.selection == (INDEX["right_wrist"],)
    tested.press("keypoints.group", "face")
    assert tested.page.tab.state.selection == tuple(range(67, 137))
    tested.draw()
    assert tested.field("Keypoint").value == "Select by name"
    assert "70 keypoints selected" in tested.html()


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
    question = f"Undo an edit of anna? right wrist marked bad, frame {FIRST + 2}. Press Ctrl+Z again"
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
    assert tab.message[0].startswith("Redo an edit of anna?") and project.undoable is None
    tested.press("action", "redo")
    assert project.undoable is not None


def test_who_else_has_the_clip_open_is_shown(tested: LonePage):
    tab = tested.page.tab
    assert not [chip for chip in lasting(tab) if chip.text.startswith("Also here")]
    tab.authors = lambda: [tab.author, "browser 1", tab.author, "anna", "browser 2", "browser 1"]
    assert "Also here: anna, 2 other browsers" in [chip.text for chip in lasting(tab)]


def test_history(tested: LonePage):
    page = tested.page
    page.tab.set(selection=(4,))
    assert "Nothing to undo" in tested.html()
    tested.press("action", "bad")
    assert f"Undo: right wrist marked bad, frame {FIRST}<" in tested.html()
    tested.press("action", "undo")
    assert page.tab.message[0] == f"Undone: right wrist marked bad, frame {FIRST}"
    tested.press("action", "redo")
    page.tab.author = "another"
    tested.press("action", "undo")
    tested.press("action", "undo")
    assert page.tab.message[0].endswith("(made in another browser)")
    shown = tested.html()
    assert "Nothing to undo" in shown and f"Redo: right wrist marked bad, frame {FIRST}<" in shown
    assert 'class="tcfit-off"' in shown
    page.tab.seek(5)
    tested.press("keypoints.visit", str(page.tab.session.project.log[0].id))
    assert page.tab.state.frame == 0 and page.tab.state.selection == (4,) and not page.tab.state.suggested
    tested.press("keypoints.follow")
    assert not page.tab.session.edit_follower.after_edits


def test_the_review_queue(tested: LonePage):
    page = tested.page
    with_suspects(tested, suspect(4), replace(suspect(2), reason="nose off", joints=(0,)))
    shown = tested.html()
    assert "1 of 3 reviewed; flagged frames: 0" in shown and "left wrist 42 px off" in shown
    tested.press("review.go", "2 cost left arm")
    assert (page.tab.state.frame, page.tab.state.selection, page.tab.state.suggested) == (2, (0,), True)
    assert 'class="tcfit-here" data-tcfit="review.go" data-value="2 cost left arm"' in tested.html()
    page.receive(LookAt(entry="4 cost left arm"))
    assert (page.tab.state.frame, page.tab.state.selection, page.tab.state.suggested) == (4, (7,), True)
    page.receive(LookAt(entry="3 cost left arm"))
    assert page.tab.state.frame == 4, "there is no such entry any more"
    with_suspects(tested, suspect(4), replace(suspect(4), joints=(4,), about=("right arm",)))
    page.receive(LookAt(entry="4 cost right arm"))
    assert page.tab.state.selection == (4,), "of two limbs in one frame, the one that was clicked"
    with_suspects(tested, suspect(4), replace(suspect(2), reason="nose off", joints=(0,)))
    tested.press("review.go", "2 cost left arm")
    tested.press("action", "flag")
    tested.press("action", "next_suspect")
    assert page.tab.state.frame == 4
    tested.press("action", "fine")
    assert "flagged frames: 1" in tested.html()
    page.tab.seek(2)
    assert "Remove flag" in tested.html()


def test_looks_fine_is_taken_back_and_leaves_flags(tested: LonePage):
    page, marks = tested.page, tested.page.tab.session.project.marks
    with_suspects(tested)
    page.tab.seek(2)
    for state in ("checked", None):
        tested.press("action", "fine")
        assert (marks.all()[2].state if state else 2 not in marks.all()) == (state or True)
    tested.press("action", "flag")
    page.tab.set(frames=range(1, 4))
    tested.press("action", "fine")
    assert {frame: mark.state for frame, mark in marks.all().items()} == {1: "checked", 2: "flag", 3: "checked"}
    page.tab.set(frames=range(2, 3))
    tested.press("action", "fine")
    assert marks.all()[2].state == "checked", "said of this frame alone it counts"
    assert "Undo &quot;looks fine&quot;" in tested.html()
    page.tab.set(frames=range(1, 4))
    tested.press("action", "fine")
    assert not marks.all()


def test_undo_takes_flags_and_looks_fine_back(tested: LonePage):
    page, marks = tested.page, tested.page.tab.session.project.marks
    with_suspects(tested)
    known = page.tab.session.project.keypoints_version
    page.tab.seek(2)
    tested.press("action", "flag")
    page.tab.seek(3)
    tested.press("action", "fine")
    assert f"Undo: marked as looking fine, frame {FIRST + 3}" in tested.html()
    page.tab.seek(0)
    tested.press("action", "undo")
    assert list(marks.all()) == [2] and page.tab.state.frame == 3
    assert page.tab.message[0] == f"Undone: marked as looking fine, frame {FIRST + 3}"
    tested.press("action", "undo")
    assert not marks.all() and page.tab.state.frame == 2 and f"Redo: flagged, frame {FIRST + 2}" in tested.html()
    tested.press("action", "redo")
    assert marks.all()[2].state == "flag" and page.tab.session.project.keypoints_version == known, (
        "no keypoint is another"
    )


def test_what_looks_fine_gives_way_to_the_next_entry(tested: LonePage):
    page, queue = tested.page, [replace(suspect(frame), score=5.0 - i) for i, frame in enumerate((4, 2, 5, 3))]
    with_suspects(tested, *queue)
    for _ in range(2):
        tested.press("action", "next_suspect")
    assert page.tab.state.frame == 2

    def made_anew(shown: object) -> ReviewQueue | None:
        checked = page.tab.session.project.marks.of_limbs().get("left arm", {})
        left = tuple(found for found in queue if found.frame not in checked)
        return ReviewQueue(left=left, looked_at=len(checked)) if ready else None

    ready = True
    page.tab.data.queue = made_anew  # pyright: ignore[reportAttributeAccessIssue]
    marks = page.tab.session.project.marks
    mark = marks.set

    def marked(*given: Any, **named: Any) -> None:
        nonlocal ready
        mark(*given, **named)
        ready = False

    marks.set = marked  # pyright: ignore[reportAttributeAccessIssue]
    tested.press("action", "fine")
    assert page.tab.state.frame == 5, "the one after it, though the queue is being made anew"
    ready = True
    tested.press("action", "next_suspect")
    assert page.tab.state.frame == 3
    tested.press("action", "next_suspect")
    assert page.tab.state.frame == 4


def test_all_listed_entries_are_marked_as_fine_except_for_flagged_ones(panel_server: viser.ViserServer, tmp_path: Path):
    limbs = sorted({*LIMB_OF.values(), WHOLE})
    kinds = ("jump", "depth")
    entries = [replace(suspect(i), kind=kinds[i % 2], about=(limbs[i % len(limbs)],)) for i in range(100)]
    with (
        sample_project(tmp_path / "long.tcfit", "first", frames=100) as project,
        lone_page(panel_server, project) as tested,
    ):

        def left(shown: object) -> ReviewQueue:
            fine = project.marks.of_limbs()
            found = tuple(e for e in entries if any(e.frame not in fine.get(limb, {}) for limb in e.about))
            return ReviewQueue(left=found, looked_at=len(entries) - len(found))

        tested.page.tab.data.queue = left  # pyright: ignore[reportAttributeAccessIssue]
        project.marks.set([0], "flag")
        for kind in kinds:
            tested.html()
            tested.press("review.kind", kind)
            assert "All 50 look fine" in tested.html()
            tested.press("action", "all_fine")
        assert left(None).left == (entries[0],)
        assert len(project.log) == 1 + len(kinds), "one undo for each"
        project.marks.set([0], None)
        tested.press("review.kind", "")
        tested.press("action", "all_fine")
        assert "All 100 reviewed." in tested.html()
        tested.press("action", "undo")
        assert left(None).left == (entries[0],)


def test_the_last_queue_is_gone_through_while_a_newer_one_is_computed(tested: LonePage):
    page = tested.page
    page.tab.data.problem = lambda what, shown: ""  # pyright: ignore[reportAttributeAccessIssue]
    page.tab.data.queue = lambda shown: None  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(InputError, match="still being looked for"):
        tested.press("action", "next_suspect")
    with_suspects(tested, suspect(2), suspect(4))
    assert "Looking again" not in tested.html()
    page.tab.data.queue = lambda shown: None  # pyright: ignore[reportAttributeAccessIssue]
    assert "2 listed" in tested.html() and "Looking again" in tested.html()
    for frame in (2, 4):
        tested.press("action", "next_suspect")
        assert page.tab.state.frame == frame


def test_the_queue_is_filtered_by_kind(tested: LonePage):
    page, first = tested.page, suspect(4)
    knee = replace(suspect(2), kind="jump", score=1.5, about=("left leg",), reason="left knee jumps")
    others = (
        replace(suspect(frame), kind="jump", score=1.2, about=("head",), reason="nose jumps") for frame in range(4)
    )
    with_suspects(tested, first, knee)
    assert 'data-tcfit="review.kind"' not in tested.html(), "two entries need no filter"
    with_suspects(tested, first, knee, *others)
    tested.html()
    tested.press("review.kind", "jump")
    assert "left wrist 42 px off" not in tested.html() and "left knee jumps" in tested.html()
    tested.press("action", "next_suspect")
    assert page.tab.state.frame == 2
    with_suspects(tested, first)
    assert "No entries match this filter." in tested.html()
    with pytest.raises(InputError, match="No entry of the queue is listed"):
        tested.press("action", "next_suspect")


def test_a_review_queue_that_cannot_be_made_says_why(tested: LonePage):
    assert "Suspicious frames cannot be found: " in tested.html()  # the sample's body is no real one


def test_finding_the_video_again(tested: LonePage, tmp_path: Path):
    page = tested.page
    assert "created without a video" in tested.html()
    assert tested.field("New location").visible
    folder = write_images(tmp_path / "images", *(f"{frame:03}.png" for frame in range(FRAMES)))
    tested.field("New location")._impl.value = f'"{folder}" '
    tested.press("review.relink")
    tested.settle()
    (told,) = tested.notices
    assert (told.title, told.text) == (
        "Video found",
        str(folder),
    ) and page.tab.session.project.media.problem == ""


def test_read_only_buttons_are_off(panel_server: viser.ViserServer, tmp_path: Path):
    sample_project(tmp_path / "walk.tcfit", "first").close()
    with Project.open(tmp_path / "walk.tcfit", read_only=True) as project, lone_page(panel_server, project) as tested:
        tested.page.tab.set(selection=(4,))
        shown = tested.html()
        editable = {name: not tested.field(name).disabled for name in ("w_T", "Held near (m)", "Note", "Name", "Frame")}
        assert editable == dict.fromkeys(editable, False) | {"Frame": True}
        assert lasting(tested.page.tab)[0].text == "Read-only: nothing can be changed"
    assert re.search(
        'data-value="swap_body" title="Swap left and right of the body .S.. [^"]*read-only[^"]*" disabled', shown
    )
    assert shown.count(" disabled") > 12


def test_what_needs_a_fit_or_the_video_is_off_without(panel_server: viser.ViserServer, tmp_path: Path):
    sample_project(tmp_path / "walk.tcfit").close()
    with Project.open(tmp_path / "walk.tcfit") as project, lone_page(panel_server, project) as tested:
        gestures = tested.page.gestures
        for name in ("ab", "space", "blinked", "bodies", "outline", "difference", "side"):
            assert "There is no fit yet" in ACTIONS[name].obstacle(gestures), name
        assert "no finished fit" in ACTIONS["approve"].obstacle(gestures)
        assert tested.button("Clip to picture").disabled
        assert tested.field("A shows").disabled and not tested.field("Name").visible


def test_an_entry_outside_the_selected_frames_ends_their_selection(tested: LonePage):
    page = tested.page
    with_suspects(tested, suspect(4))
    page.tab.set(frames=range(1, 3))
    assert f"Both apply to frames {FIRST + 1}–{FIRST + 2}." in tested.html()
    tested.press("review.go", "4 cost left arm")
    assert (
        page.tab.state.frames is None
        and f"O marks left arm, frame {FIRST + 4} as fine, T flags frame {FIRST + 4}." in tested.html()
    )
    wide = replace(suspect(2), frames=range(1, 4))
    page.gestures.reviewing.show(wide)
    span = f"frames {FIRST + 1}–{FIRST + 3}"
    assert f"O marks left arm, {span} as fine, T flags {span}." in tested.html()
    tested.press("action", "fine")
    marks = page.tab.session.project.marks
    assert sorted(marks.of_limbs()["left arm"]) == list(marks.states()) == [1, 2, 3] and not marks.all()


def test_an_entry_of_several_frames_is_corrected_in_all_of_them(tested: LonePage):
    page = tested.page
    page.gestures.reviewing.show(replace(suspect(2), frames=range(1, 4), joints=(4,)))
    tested.press("action", "bad")
    assert last_edit(page) == MarkBad(frames=(1, 2, 3), joints=(4,))
    page.tab.seek(3)
    assert page.tab.chosen_frames == range(1, 4) and page.tab.played == range(page.tab.length)
    page.tab.seek(5)
    assert page.tab.state.frames is None, "outside the entry the frame on show counts again"
    page.tab.set(frames=range(1, 4))
    page.gestures.reviewing.show(suspect(2))
    page.tab.seek(5)
    assert page.tab.state.frames == range(1, 4), "the user's own selection stays"


def test_the_queue_stays_while_the_fit_follows_an_edit(tested: LonePage):
    """Corrected keypoints beside the uncorrected fit were entries that vanished seconds later."""
    follower = tested.page.tab.session.edit_follower
    with_suspects(tested, suspect(4))
    assert "1 listed" in tested.html()
    follower._under_way.add(1)
    with_suspects(tested, suspect(4), suspect(2))
    assert "1 listed" in tested.html() and "Looking again" in tested.html()
    follower._under_way.clear()
    assert "2 listed" in tested.html() and "Looking again" not in tested.html()


def test_frames_that_are_selected_elsewhere_are_not_changed(tested: LonePage):
    page, project = tested.page, tested.page.tab.session.project
    page.tab.set(frames=range(1, 4), selection=(4,))
    page.tab.seek(5)
    page.gestures.correcting.nudge(1.0, 0.0)  # of the frame on show alone
    known = len(project.log)
    changing = ("bad", "reset", "copy", "interpolate", "swap_body", "mirror_depth", "clear_depth", "fine", "flag")
    for name in changing:
        with pytest.raises(InputError, match=f"frames {FIRST + 1}–{FIRST + 3}, and frame {FIRST + 5} is on show"):
            tested.press("action", name)
    with pytest.raises(InputError, match="is on show"):
        tested.press("keypoints.swap", "legs")
    assert len(project.log) == known and not project.marks.all()
    assert "nothing is changed" in tested.html()
    tested.press("frames.go")
    assert page.tab.state.frame == 1 and "nothing is changed" not in tested.html()
    tested.press("action", "bad")
    assert last_edit(page) == MarkBad(frames=(1, 2, 3), joints=(4,))
    page.tab.seek(5)
    tested.press("frames.none")
    tested.press("action", "flag")
    assert list(project.marks.all()) == [5]


def test_icons_are_viser_s_own(monkeypatch: pytest.MonkeyPatch):
    """Read from its archive by us, as viser does it slowly."""
    for kind in PANELS:
        assert icon(kind.icon) == svg_from_icon(kind.icon)
    for user in (_gui_handles, _gui_api):
        monkeypatch.setattr(user, "svg_from_icon", svg_from_icon)
    keep_icons_open()
    assert _gui_handles.svg_from_icon is icon and _gui_api.svg_from_icon is icon  # pyright: ignore
