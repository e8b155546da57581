"""The panel Review: the queue, what looks fine, flags."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import viser

from fitting_core.errors import InputError
from tcfit_app.analysis.body_regions import LIMB_OF
from tcfit_app.analysis.findings import WHOLE
from tcfit_app.analysis.suspicion import ReviewQueue
from tcfit_app.fitting.reports import RunningJob
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.review.browser.page_events import LookAt
from tcfit_app.review.panels.review_panel import ReviewPanel
from tests.drivers.lone_page import LonePage, lone_page, sample_project
from tests.tcfit_app.review.panels.conftest import suspect, with_suspects

FIRST = 7
"""The number that users see for frame 0 of the sample clip."""


def test_the_review_queue(tested: LonePage):
    page = tested.page
    with_suspects(tested, suspect(4), replace(suspect(2), reason="nose off", joints=(0,)))
    shown = tested.html()
    assert "2 suspicious places" in shown and "1 of 3 reviewed" in shown and "<b>Left wrist 42 px off</b>" in shown
    page.timeline.draw()
    entries = page.tab.channel._sent["suspicions"].found  # pyright: ignore[reportOptionalMemberAccess]
    assert [(entry.frame, entry.reason) for entry in entries] == [(2, "nose off"), (4, "left wrist 42 px off")]
    tested.press("review.go", "2 cost left arm")
    assert (page.tab.state.frame, page.tab.state.selection, page.tab.state.suggested) == (2, (0,), True)
    assert 'aria-current="true" data-tcfit="review.go" data-value="2 cost left arm"' in tested.html()
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
    page.tab.seek(2)
    assert "Remove flag" in tested.html()


def test_the_first_entries_are_cards_and_the_one_on_show_is_among_them(tested: LonePage):
    tested.page.tab.in_list = True
    tested.panels = []
    before = tested.html().count("<button")  # other panels have some from the start
    tested.only(ReviewPanel)
    with_suspects(tested, *(suspect(frame) for frame in range(8)))
    shown = tested.html()
    assert tested.field("New location").visible, "the project has no video, so fewer are listed"
    assert shown.count("<button") - before < 12 and ">5 more<" in shown
    for _ in range(8):
        tested.press("action", "next_suspect")
        assert tested.html().count('aria-current="true"') == 1
    tested.press("review.more")
    assert tested.html().count('data-tcfit="review.go"') == 8


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
    page.tab.seek(0)
    tested.press("action", "undo")
    assert list(marks.all()) == [2] and page.tab.state.frame == 3
    assert page.tab.message[0] == f"Undone: marked as looking fine, frame {FIRST + 3}"
    tested.press("action", "undo")
    assert not marks.all() and page.tab.state.frame == 2
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
        for kind in ("Jumps", "Depth"):
            tested.press("review.menu", f"{kind}: 50")
            assert "All listed look fine (50)" in tested.html()
            tested.press("action", "all_fine")
        assert left(None).left == (entries[0],)
        assert len(project.log) == 1 + len(kinds), "one undo for each"
        project.marks.set([0], None)
        tested.press("review.menu", "All kinds")
        tested.press("action", "all_fine")
        assert "All 100 reviewed" in tested.html()
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
    assert "2 suspicious places" in tested.html() and "Looking again" in tested.html()
    for frame in (2, 4):
        tested.press("action", "next_suspect")
        assert page.tab.state.frame == frame


def test_a_fit_in_progress_says_how_far_it_is(tested: LonePage):
    page = tested.page
    run = page.tab.session.fits.runs[-1]
    page.tab.session.jobs[99] = RunningJob(number=99, run=run.id, title="Fit", phases=(3,), started=True)
    assert ": starting. Suspicious places are found when it is done." in tested.html()
    del page.tab.session.jobs[99]


def test_the_queue_is_filtered_by_kind(tested: LonePage):
    page, first = tested.page, replace(suspect(4), kind="depth")
    knee = replace(suspect(2), kind="jump", score=1.5, about=("left leg",), reason="left knee jumps")
    others = (
        replace(suspect(frame), kind="jump", score=1.2, about=("head",), reason="nose jumps") for frame in range(4)
    )
    with_suspects(tested, first, knee, *others)
    tested.press("review.menu", "Jumps: 5")
    assert "Left wrist 42 px off" not in tested.html() and "Left knee jumps" in tested.html()
    tested.press("action", "next_suspect")
    assert page.tab.state.frame == 2
    with_suspects(tested, first)
    assert "Jumps only: 0 of 1" in tested.html()
    with pytest.raises(InputError, match="No entry of the queue is listed"):
        tested.press("action", "next_suspect")


def test_a_review_queue_that_cannot_be_made_says_why(tested: LonePage):
    assert "Suspicious places cannot be found: " in tested.html()  # the sample's body is no real one


def test_an_entry_outside_the_selected_frames_ends_their_selection(tested: LonePage):
    page = tested.page
    with_suspects(tested, suspect(4))
    page.tab.set(frames=range(1, 3))
    page.tab.seek(1)
    assert f">Looks fine, frames {FIRST + 1}–{FIRST + 2}<" in tested.html()
    tested.press("review.go", "4 cost left arm")
    assert page.tab.state.frames is None and f'title="left arm, frame {FIRST + 4} (O)"' in tested.html()
    wide = replace(suspect(2), frames=range(1, 4))
    page.gestures.reviewing.show(wide)
    span = f"frames {FIRST + 1}–{FIRST + 3}"
    assert f'title="left arm, {span} (O)"' in tested.html() and f"Flag {span}" in tested.html()
    tested.press("action", "fine")
    marks = page.tab.session.project.marks
    assert sorted(marks.of_limbs()["left arm"]) == list(marks.states()) == [1, 2, 3] and not marks.all()


def test_an_entry_of_several_frames_is_corrected_in_all_of_them(tested: LonePage):
    page = tested.page
    page.gestures.reviewing.show(replace(suspect(2), frames=range(1, 4), joints=(4,)))
    tested.press("action", "bad")
    assert tested.last_edit == MarkBad(frames=(1, 2, 3), joints=(4,))
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
    assert "1 suspicious place<" in tested.html()
    follower._under_way.add(1)
    with_suspects(tested, suspect(4), suspect(2))
    assert "1 suspicious place<" in tested.html() and "Looking again" in tested.html()
    follower._under_way.clear()
    assert "2 suspicious places" in tested.html() and "Looking again" not in tested.html()
