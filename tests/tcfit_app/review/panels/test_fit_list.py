"""The list of fits in the panel Fit: showing, naming, deleting, restoring."""

from dataclasses import replace

import pytest

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT
from fitting_core.errors import InputError
from tcfit_app.analysis.seen import FAINT
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.storage.run_record import Given, Run, Source
from tcfit_app.review.drawing.frame import Frames
from tcfit_app.review.panels.fit.fit_list import LISTED
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tcfit_app.review.tab.state import FitSettings
from tests.drivers.lone_page import LonePage
from tests.samples.sessions import QUICK
from tests.tcfit_app.review.panels.conftest import ATTACK, Opener


@pytest.fixture
def tested(panel_of: Opener) -> LonePage:
    made = panel_of(FitPanel)
    made.page.tab.set(folds=frozenset({"fit.deleted"}))
    return made


def choose(tested: LonePage, run: Run, label: str) -> None:
    """A line in the menu of the fit on show."""
    tested.press(f"fits.menu {run.id}", label)
    tested.draw()


def rename(tested: LonePage, run: Run, name: str) -> None:
    choose(tested, run, "Rename …")
    tested.enter("Name", name)
    tested.click("Rename")
    tested.draw()


def test_fits_are_shown_renamed_deleted_and_restored(tested: LonePage):
    tab, session = tested.page.tab, tested.page.tab.session
    first, second = tested.fit(), tested.fit()
    tested.press("fits.show", str(first.id))
    assert tab.state.b == FitChoice(run=first.id)
    rename(tested, first, ATTACK)
    assert session.project.runs.get(first.id).name == ATTACK
    assert "<img" not in tested.html() and "&lt;img src=x" in tested.html()
    choose(tested, first, "Delete")
    assert [run.id for run in session.fits.runs] == [second.id]
    assert tested.shown.run.id == second.id, "the newest, in its place"
    tested.click("Restore")
    assert [run.id for run in session.fits.runs] == [first.id, second.id]
    tested.until(lambda: (shown := tab.look().b) is not None and shown.run.id == first.id)  # what was chosen
    rename(tested, first, "   ")
    assert tested.notices[-1].kind == "error" and session.project.runs.get(first.id).name == ATTACK


def test_a_fit_and_its_corrections_are_one_row(tested: LonePage):
    tab, run = tested.page.tab, tested.fit()
    tab.set(selection=(kp.INDEX["right_wrist"],))
    for _ in range(2):
        tested.page.gestures.correcting.nudge(5.0, 0.0)
        tested.idle()
    assert "Fit 1 with 2 corrections" in tested.html() and tested.html().count("fits.show") == 2, "a row and its button"
    rename(tested, run, "waltz")
    assert "waltz with 2 corrections" in tested.html()
    choose(tested, run, "Compare with/waltz")
    assert (tab.look().a.run.id, tab.look().b.run.kind) == (run.id, "corrections")  # pyright: ignore[reportOptionalMemberAccess]
    choose(tested, run, "Delete")
    assert not tab.session.fits.runs and "Deleted (1)" in tested.html()
    tested.click("Restore")
    assert [one.kind for one in tab.session.fits.runs] == ["fit", "corrections"]


def test_the_newest_are_listed_and_the_others_on_request(tested: LonePage):
    session, first = tested.page.tab.session, tested.fit()
    for _ in range(LISTED + 1):
        session.project.runs.start(QUICK, body=first.body, edits_seen=0)
    html = tested.html()
    assert "Fit 1<" in html and "Fit 2<" not in html and f"Fit {LISTED + 2}<" in html, "the one on show, and the newest"
    tested.click("1 more")
    assert "Fit 2<" in tested.html()


def test_a_run_is_corrected_as_long_as_a_correction_stands(tested: LonePage):
    tab, correcting = tested.page.tab, tested.page.gestures.correcting
    run = tested.fit()
    tab.set(selection=(kp.INDEX["right_wrist"],), b=FitChoice(run=run.id))

    def shows(kind: str) -> bool:
        shown, session = tab.look().b, tab.session
        rests = not session.jobs and not session.edit_follower.busy
        return rests and shown is not None and shown.run.kind == kind

    for b in (FitChoice(run=run.id), FitChoice()):
        tab.set(b=b)
        correcting.nudge(5.0, 0.0)
        correcting.nudge(0.0, 5.0)
        tested.until(lambda: shows("corrections"))
        correcting.undo()
        tested.until(lambda: shows("corrections"))
        correcting.undo()
        tested.until(lambda: shows("fit"))
        correcting.redo()
        tested.until(lambda: shows("corrections"))
        correcting.undo()
        tested.until(lambda: shows("fit"))
    correcting.nudge(5.0, 0.0)
    tested.until(lambda: shows("corrections"))
    assert [one.kind for one in tab.session.fits.runs] == ["fit", "corrections"]


def test_what_keypoints_do_not_show_is_fainter(tested: LonePage):
    tested.fit()
    tab = tested.page.tab
    tab.session.edit(MarkBad(frames=(2, 3), joints=(kp.INDEX["left_wrist"],)), author="me")
    tab.session.edit(MarkBad(frames=(3,), joints=tuple(range(kp.COUNT))), author="me")
    tested.idle()

    joints = [JOINT[name] for name in ("left_elbow", "right_elbow", "left_hip")]

    def seen(frame: int) -> tuple[list[float], str]:
        """The mean opacity of what the joints move, and the label."""
        tab.seek(frame)
        shown = tab.look()
        drawn = Frames(tab, lambda shown: None).of(shown)
        assert drawn is not None and shown.b is not None
        layer, fit = drawn.bodies["b"], shown.b
        assert layer.opacities is not None and layer.opacity == tab.state.opacity
        weights = tab.data.meshes(fit).body.skinning_weights[:, joints]
        return (weights.T @ layer.opacities / (255 * weights.sum(0))).tolist(), drawn.labels[0][0]

    (usual, title), (partly, _), (faint, told) = seen(1), seen(2), seen(3)
    assert partly[0] < usual[0] - 0.2 and partly[1:] == pytest.approx(usual[1:], abs=0.02)
    assert faint == pytest.approx([FAINT] * 3, abs=0.01)
    assert "no keypoints here" in told and "no keypoint" not in title


def test_a_button_acts_on_the_fit_that_it_was_for(tested: LonePage):
    first = tested.fit()
    tested.draw()
    second = tested.fit()
    tested.press("fits.show", str(second.id))
    choose(tested, second, "Delete")
    tested.press("fits.show", str(first.id))
    choose(tested, first, "Rename …")
    session = tested.page.tab.session
    session.delete(first.id)
    with pytest.raises(InputError, match="has been deleted"):
        tested.press("fits.rename", str(first.id))


def test_removing_for_good_asks(tested: LonePage):
    run = tested.fit()
    choose(tested, run, "Delete")
    tested.click("Remove all permanently")
    assert tested.page.tab.session.project.runs.get(run.id).deleted
    tested.click("Keep them")
    assert "Remove 1 deleted fit" not in tested.html()
    tested.click("Remove all permanently")
    tested.click("Remove 1 deleted fit")
    with pytest.raises(InputError, match="no run"):
        tested.page.tab.session.project.runs.get(run.id)


def test_settings_of_a_run_are_taken_for_the_next(tested: LonePage):
    run = tested.fit()
    tested.page.tab.set(settings=FitSettings())
    choose(tested, run, "Use its settings")
    settings = tested.page.tab.state.settings
    assert (settings.config, settings.preset, settings.focal) == (QUICK, "paper", None)


def test_a_fit_that_starts_from_a_run_is_shown_beside_it(tested: LonePage):
    tab, session, first = tested.page.tab, tested.page.tab.session, tested.fit()
    tab.set(settings=replace(FitSettings(config=QUICK), given=Given(start=Source(run=first.id))))
    tested.page.gestures.fitting.everything()
    tested.until(lambda: len(session.fits.runs) == 2 and not session.jobs)
    run = session.fits.runs[-1]
    assert (run.kind, run.state, run.parent) == ("fit", "finished", first.id)
    assert tab.state.a == FitChoice(run=first.id), "what it began with stands beside it"
    choose(tested, run, "Details")
    html = tested.html()
    assert "Fit 2 from Fit 1" in html
    assert f"Phase 1 begins with {first.name}" in html, "the sentence is among its notes"
    tab.set(settings=FitSettings())
    choose(tested, run, "Use its settings")
    assert tab.state.settings.given == run.given
