"""The panel Runs: naming, showing, deleting, restoring."""

from dataclasses import replace

import pytest

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT
from fitting_core.errors import InputError
from tcfit_app.analysis.seen import FAINT
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.storage.run_record import Given, Source
from tcfit_app.review.drawing.frame import Frames
from tcfit_app.review.panels.compare_panel import ComparePanel
from tcfit_app.review.panels.runs.runs_panel import RunsPanel
from tcfit_app.review.tab.state import FitSettings
from tests.samples.sessions import QUICK
from tests.tcfit_app.review.panels.conftest import ATTACK, Opener


def test_runs_are_renamed_shown_deleted_and_restored(panel_of: Opener):
    tested = panel_of(RunsPanel)
    session = tested.page.tab.session
    assert "No fits yet" in tested.html()
    first, second = tested.fit(), tested.fit()
    tested.press("runs.choose", str(first.id))
    tested.draw()
    tested.enter("Name", ATTACK)
    tested.click("Rename")
    assert session.project.runs.get(first.id).name == ATTACK
    assert "<img" not in tested.html() and "&lt;img src=x" in tested.html()
    tested.click("Show as A")
    assert tested.page.tab.state.a == FitChoice(run=first.id)
    tested.click("Delete")
    tested.draw()
    assert [run.id for run in session.fits.runs] == [second.id]
    tested.click("Restore")
    assert [run.id for run in session.fits.runs] == [first.id, second.id]
    tested.press("runs.choose", str(first.id))
    tested.draw()
    assert tested.field("Name").value == ATTACK


def test_in_the_place_of_a_deleted_run_the_newest_is_shown(panel_of: Opener):
    tested = panel_of(RunsPanel)
    tab = tested.page.tab
    first, second = tested.fit(), tested.fit()
    tab.set(b=FitChoice(run=second.id))
    tested.press("runs.choose", str(second.id))
    tested.click("Delete")
    shown = tab.look().b
    assert shown is not None and shown.run.id == first.id and tab.shown.held is not None
    tested.draw()
    folders = [h for h in tested._children() if getattr(h, "label", "") == "Deleted runs"]
    assert [(folder.visible, folder.expand_by_default) for folder in folders] == [(True, True)]
    tested.press("deleted.restore", str(second.id))
    tested.until(lambda: (shown := tab.look().b) is not None and shown.run.id == second.id)  # what was chosen


def test_a_run_is_corrected_as_long_as_a_correction_stands(panel_of: Opener):
    tested = panel_of(RunsPanel)
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


def test_what_keypoints_do_not_show_is_fainter(panel_of: Opener):
    tested = panel_of(RunsPanel)
    tested.fit()
    tab = tested.page.tab
    tab.session.edit(MarkBad(frames=(2, 3), joints=(kp.INDEX["left_wrist"],)), author="me")
    tab.session.edit(MarkBad(frames=(3,), joints=tuple(range(kp.COUNT))), author="me")
    tested.until(lambda: not tab.session.jobs and not tab.session.edit_follower.busy)

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


def test_a_new_run_does_not_take_the_place_of_the_one_at_hand(panel_of: Opener):
    tested = panel_of(RunsPanel)
    first = tested.fit()
    tested.draw()
    tested.enter("Name", "mine")
    rename, delete = (tested.button(label) for label in ("Rename", "Delete"))
    second = tested.fit()
    tested.draw()
    assert tested.field("Name").value == "mine" and f"{first.id}" in rename.value
    tested.press("runs.choose", str(second.id))
    tested.draw()  # the user presses just before that is drawn
    tested.press(delete.command, delete.value)
    assert [run.id for run in tested.page.tab.session.fits.runs] == [second.id]
    with pytest.raises(InputError, match="has been deleted"):
        tested.press(rename.command, rename.value)


def test_removing_for_good_asks(panel_of: Opener):
    tested = panel_of(RunsPanel)
    run = tested.fit()
    tested.click("Delete")
    tested.click("Remove all permanently")
    assert tested.page.tab.session.project.runs.get(run.id).deleted
    tested.click("Keep them")
    assert "Remove 1 deleted run" not in tested.html()
    tested.click("Remove all permanently")
    tested.click("Remove 1 deleted run")
    with pytest.raises(InputError, match="no run"):
        tested.page.tab.session.project.runs.get(run.id)


def test_settings_of_a_run_are_taken_for_the_next(panel_of: Opener):
    tested = panel_of(RunsPanel)
    tested.fit()
    tested.page.tab.set(settings=FitSettings())
    tested.click("Use its settings")
    settings = tested.page.tab.state.settings
    assert (settings.config, settings.preset, settings.focal) == (QUICK, "paper", None)


def test_a_fit_that_starts_from_a_run_is_shown_beside_it(panel_of: Opener):
    tested = panel_of(RunsPanel)
    tab, session, first = tested.page.tab, tested.page.tab.session, tested.fit()
    tab.set(settings=replace(FitSettings(config=QUICK), given=Given(start=Source(run=first.id))))
    tested.page.gestures.fitting.everything()
    tested.until(lambda: len(session.fits.runs) == 2 and not session.jobs)
    run = session.fits.runs[-1]
    assert (run.kind, run.state, run.parent) == ("fit", "finished", first.id)
    assert tab.state.a == FitChoice(run=first.id), "what it began with stands beside it"
    tested.press("runs.choose", str(run.id))
    html = tested.html()
    assert "started from another result" in html
    assert f"Phase 1 begins with {first.name}" in html, "the sentence is among its notes"
    tab.set(settings=FitSettings())
    tested.click("Use its settings")
    assert tab.state.settings.given == run.given


def test_a_run_without_a_name_is_refused(panel_of: Opener):
    tested = panel_of(RunsPanel)
    tested.fit()
    tested.draw()
    tested.enter("Name", "   ")
    tested.click("Rename")
    assert tested.notices[-1].kind == "error" and tested.page.tab.session.fits.runs[0].name == "Fit 1"


def test_nothing_is_sent_when_nothing_changed(panel_of: Opener):
    tested = panel_of(ComparePanel)
    before = tested.html()
    tested.fit()
    tested.page.tab.set(mode="ab")
    assert tested.html() != before
    tested.until(lambda: "Jitter" in tested.html())
    assert not tested.draw()
