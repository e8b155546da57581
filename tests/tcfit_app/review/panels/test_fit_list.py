"""The fits in the panel Fit: showing, naming, deleting, restoring; and what is shown while two are compared."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT
from fitting_core.errors import InputError
from fitting_core.measure.references.files import read_reference
from tcfit_app.analysis.run_metrics import Metric
from tcfit_app.analysis.seen import FAINT
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.storage.run_record import Given, Run, Source
from tcfit_app.review.drawing.frame import Frames
from tcfit_app.review.gestures.actions import ACTIONS
from tcfit_app.review.panels.fit.fit_list import LISTED
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tcfit_app.review.tab.state import FitSettings
from tests.drivers.lone_page import BODY, CONFIG, LonePage, sample_fit, sample_project
from tests.samples.sessions import FRAMES, QUICK
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


# --- comparing ---


def test_two_fits_are_compared(panel_of: Opener):
    tested = panel_of(FitPanel)
    run, tab = tested.fit(), tested.page.tab
    assert "Compared" not in tested.html() and not tested.field("A").visible
    tab.set(mode="ab")
    assert "Measuring" in tested.html()
    tested.until(lambda: "Jitter" in tested.html() and "B − A" in tested.html())
    assert not tested.draw(), "nothing is sent when nothing changed"
    assert (tested.field("A").value, tested.field("B").value) == ("Fit 1 · first pass", "Fit 1")
    tested.enter("A", "Fit 1 · one shape")
    assert tab.state.a == FitChoice(run=run.id, phase=2)
    tested.enter("B", "Fit 1 · one shape")
    assert "the same fit" in tested.html()
    tested.click("Stop comparing")
    assert tab.state.mode == "edit" and tab.look().a is None


def test_a_re_run_stands_beside_what_it_came_from(panel_of: Opener):
    tested = panel_of(FitPanel)
    first = tested.fit()
    tab, session = tested.page.tab, tested.page.tab.session
    tab.set(frames=range(2, 5))
    tested.page.gestures.fitting.frames()
    rerun = session.fits.runs[-1]
    assert (tab.state.a.run, tab.state.b.run) == (first.id, rerun.id)  # pyright: ignore[reportOptionalMemberAccess]
    tested.until(lambda: not session.jobs)
    assert tab.look().a is None, "nothing is compared yet"
    tab.set(mode="ab")
    a, b = tab.look().a, tab.look().b
    assert a is not None and b is not None and (a.run.id, b.run.id) == (first.id, rerun.id)
    seconds = {metric.name: metric.value for metric in _metrics(tested, b)}["seconds"]
    assert b.result is not None and seconds == pytest.approx(b.result.seconds), "its own, not its parent's"
    tab.set(mode="edit", a=FitChoice(), b=FitChoice())
    tested.press(f"fits.menu {rerun.id}", "Compare with the one before")
    assert tab.state.mode == "ab" and (tab.look().a.run.id, tab.look().b.run.id) == (first.id, rerun.id)  # pyright: ignore[reportOptionalMemberAccess]


def _metrics(tested: LonePage, shown: Shown) -> tuple[Metric, ...]:
    found: list[tuple[Metric, ...] | None] = []
    tested.until(lambda: found.append(tested.page.tab.data.metrics(shown)) or found[-1] is not None)
    assert found[-1] is not None
    return found[-1]


def test_fits_are_compared_with_a_reference(panel_of: Opener, tmp_path: Path):
    tested = panel_of(FitPanel)
    points = np.random.default_rng(0).normal(0, 0.2, (FRAMES, len(kp.LIMBS), 3))
    np.savez(tmp_path / "reference.npz", points=points, names=np.array(kp.NAMES)[kp.LIMBS])
    first = tested.page.tab.session.project.clip.first_frame
    reference = read_reference(tmp_path / "reference.npz")
    tested.page.tab.session.project.set_reference(reference.starting_at(first + 2, 25.0))
    tested.page.tab.set(mode="ab")
    tested.fit()
    tested.until(lambda: f"PA-MPJPE, {FRAMES - 2} of {FRAMES} frames" in tested.html())


def test_one_fit_without_passes_has_nothing_beside_it(page_of: Callable[..., LonePage], tmp_path: Path):
    project = sample_project(tmp_path / "walk.tcfit")
    run = project.runs.start(CONFIG, body=BODY, edits_seen=0, kind="imported", name="theirs")
    project.runs.finish(run.id, sample_fit(0))
    tested = page_of(project)
    for name in ("ab", "wipe", "blinked", "difference", "ghost"):
        with pytest.raises(InputError, match="only one fit"):
            ACTIONS[name].do(tested.page.gestures)
    other = project.runs.start(CONFIG, body=BODY, edits_seen=0, name="ours")
    project.runs.finish(other.id, sample_fit(1))
    tested.until(lambda: len(tested.page.tab.session.fits.runs) == 2)
    ACTIONS["ab"].do(tested.page.gestures)
    assert tested.page.tab.state.mode == "ab"
