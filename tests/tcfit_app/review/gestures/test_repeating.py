"""A correction made again at all entries of the queue that look alike: which these are, and in which frames."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX
from tcfit_app.analysis.suspicion import ReviewQueue, Suspect
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tcfit_app.review.panels.review_panel import ReviewPanel
from tests.drivers.lone_page import LonePage, lone_page
from tests.samples.sessions import OneBody, small_clip

WRIST = INDEX["left_wrist"]


def entry(worst: int, frames: range, *, kind: str = "reprojection", limb: str = "left arm") -> Suspect:
    return Suspect(
        frame=worst, frames=frames, score=2.0, kind=kind, reason="off", joints=(WRIST,), about=(limb,), also=()
    )


FIRST = entry(1, range(1, 3))
QUEUE = (
    FIRST,
    entry(4, range(4, 5)),
    entry(7, range(6, 8)),
    entry(3, range(3, 4), kind="jump"),
    entry(5, range(5, 6), limb="right arm"),
)


@pytest.fixture
def tested(tmp_path: Path, tiny_body: BodyModel, panel_server: viser.ViserServer) -> Iterator[LonePage]:
    """With a fit, and a queue of which two entries look like the first."""
    with (
        Project.create(tmp_path / "walk.tcfit", small_clip(tiny_body)) as project,
        lone_page(panel_server, project, bodies=OneBody(tiny_body)) as made,
    ):
        made.fit()
        made.only(ReviewPanel)
        made.page.tab.session.edit_follower.after_edits = False
        queue = ReviewQueue(left=QUEUE, looked_at=0)
        made.page.tab.data.queue = lambda shown: queue  # pyright: ignore[reportAttributeAccessIssue]
        yield made


def visit_and_mark_bad(tested: LonePage, frames: range | None) -> None:
    gestures = tested.page.gestures
    gestures.reviewing.show(FIRST)
    tested.page.tab.set(frames=frames)
    gestures.correcting.toggle_bad()


def repeated(tested: LonePage) -> tuple[int, ...]:
    tested.press("action", "repeat")
    edit = tested.page.tab.session.project.log[-1].action
    assert isinstance(edit, MarkBad) and edit.joints == (WRIST,)
    return edit.frames


def test_one_frame_stands_for_the_worst_of_each(tested: LonePage):
    visit_and_mark_bad(tested, None)
    assert "Also at 2 other entries that look alike?" in tested.html()
    assert repeated(tested) == (4, 7)
    assert "look alike?" not in tested.html(), "it was made everywhere"


def test_all_frames_stand_for_all_and_for_those_beside_them(tested: LonePage):
    visit_and_mark_bad(tested, range(0, 3))
    assert repeated(tested) == (3, 4, 5, 6, 7)


def test_it_is_one_step_back(tested: LonePage):
    project = tested.page.tab.session.project
    visit_and_mark_bad(tested, None)
    repeated(tested)
    tested.press("action", "undo")
    assert project.corrected.bad[:, WRIST].nonzero()[0].tolist() == [1]
    assert "Also at 2 other" in tested.html(), "it can be repeated again"


def test_they_are_listed_by_themselves(tested: LonePage):
    visit_and_mark_bad(tested, None)
    tested.press("action", "list_alike")
    assert tested.page.gestures.reviewing.suspects == QUEUE[:3]


def test_flagged_entries_are_left_out(tested: LonePage):
    visit_and_mark_bad(tested, None)
    tested.page.tab.session.mark((4,), "flag", author="somebody")
    assert repeated(tested) == (7,)


def test_what_cannot_be_repeated(tested: LonePage):
    gestures, tab = tested.page.gestures, tested.page.tab
    with pytest.raises(InputError, match="Nothing to repeat"):
        gestures.repeating.repeat()
    tab.set(frame=6, selection=(WRIST,))
    gestures.correcting.toggle_bad()
    assert gestures.repeating.alike is None, "no entry was visited"
    visit_and_mark_bad(tested, None)
    gestures.correcting.toggle_bad()
    gestures.correcting.nudge(3.0, 0.0)
    assert gestures.repeating.alike is None, "a nudge has a place of its own"
