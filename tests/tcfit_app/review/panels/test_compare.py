"""What the panel Fit shows while two fits are compared."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting_core import keypoints as kp
from fitting_core.errors import InputError
from fitting_core.measure.references.files import read_reference
from tcfit_app.analysis.run_metrics import Metric
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.review.gestures.actions import ACTIONS
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tests.drivers.lone_page import BODY, CONFIG, LonePage, sample_fit, sample_project
from tests.samples.sessions import FRAMES
from tests.tcfit_app.review.panels.conftest import Opener


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
