"""A keypoint is dragged in a tab: what is fitted is what was saved, and what is shown never goes back."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.keypoints import INDEX
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.fitting.live import Correction
from tcfit_app.review.browser.page_events import Drag
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tests.drivers.lone_page import LonePage, tiny_page
from tests.samples.sessions import PATIENCE

WRIST, FRAME = INDEX["right_wrist"], 4


@pytest.fixture
def tested(panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel) -> Iterator[LonePage]:
    with tiny_page(panel_server, tmp_path / "p", tiny_body, FitPanel) as made:
        made.page.tab.set(frame=FRAME)
        yield made


def drag(tested: LonePage, phase: str, dx: float) -> None:
    tested.page.receive(Drag(phase, (WRIST,), dx, 0.0, FRAME))  # pyright: ignore[reportArgumentType]


def test_the_fit_converges_where_the_keypoint_was_let_go(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    session, run = tested.page.tab.session, tested.fit()
    fitted, edited = [], Correction.edited

    def noted(correction: Correction, xy: np.ndarray) -> Clip:
        fitted.append(xy)
        return edited(correction, xy)

    monkeypatch.setattr(Correction, "edited", noted)
    drag(tested, "start", 0.0)
    drag(tested, "move", 10.0)
    tested.until(lambda: session.edit_follower.live is not None)
    drag(tested, "end", 60.0)  # the pointer went on since its last move
    tested.until(lambda: not session.edit_follower.busy)
    assert np.array_equal(fitted[-1], session.project.corrected.xy[FRAME, [WRIST]])
    assert session.edits_since(session.edit_follower.of(run.id)) == 0


@pytest.mark.parametrize("chosen", [True, False])
def test_the_old_body_does_not_come_back_when_a_drag_ends(tested: LonePage, chosen: bool):
    tab, run = tested.page.tab, tested.fit()
    session, end = tab.session, time.monotonic() + PATIENCE
    if chosen:
        tab.set(b=FitChoice(run=run.id))

    def body() -> np.ndarray:
        """As the next drawing has it, after the worker's news."""
        session.take_news()
        shown = tab.look()
        drawn = shown.body("b")
        assert drawn is not None
        return tab.data.vertices(drawn)

    old = body()
    drag(tested, "start", 0.0)
    drag(tested, "move", 40.0)
    tested.until(lambda: session.edit_follower.live is not None)
    assert not np.array_equal(body(), old)
    drag(tested, "end", 60.0)
    while session.edit_follower.busy:
        assert not np.array_equal(body(), old)
        assert time.monotonic() < end
        time.sleep(0.002)  # the fit needs the processor too
    assert not np.array_equal(body(), old)
    assert tab.state.b.run == (session.edit_follower.of(run.id).id if chosen else None)


@pytest.mark.parametrize("by_key", [False, True])
def test_a_run_that_has_corrections_gets_no_second_run_of_them(tested: LonePage, by_key: bool):
    """All edits stand in both, whichever of the two is on show."""
    tab, run = tested.page.tab, tested.fit()
    session = tab.session

    def corrected(dx: float) -> Shown:
        drag(tested, "start", 0.0)
        drag(tested, "end", dx)
        tested.until(lambda: not session.edit_follower.busy)
        return tested.shown

    first = corrected(150.0)
    before = first.params.body_pose.clone()
    tab.set(b=FitChoice(run=run.id), frame=0, selection=(WRIST,))
    if by_key:
        tested.page.gestures.correcting.nudge(30.0, 0.0)
        tested.idle()
    else:
        corrected(30.0)
    second = tested.shown
    assert (first.run.id, first.run.parent) == (second.run.id, run.id)
    assert not np.array_equal(before, second.params.body_pose)


def test_a_drag_of_another_frame_or_run_leaves_this_body_alone(tested: LonePage):
    tab, first, second = tested.page.tab, tested.fit(), tested.fit()
    tab.set(mode="ab", a=FitChoice(run=first.id))
    drag(tested, "start", 0.0)
    drag(tested, "move", 40.0)
    tested.until(lambda: tab.session.edit_follower.live is not None)
    shown = tab.look()
    assert shown.b is not None and shown.b.run.id == second.id
    assert shown.live_b is not None and shown.live_a is None
    tab.set(frame=0)
    assert tab.look().live is None and tab.look().revision is None
    drag(tested, "cancel", 0.0)
