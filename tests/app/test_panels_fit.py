"""The panel Fit: what is entered gets into the run, what is wrong is told and fits nothing, and what is drawn."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.config import PRESETS
from fitting_core.config_file import as_toml
from fitting_core.settings import changed
from tcfit_app.edits import MarkBad
from tcfit_app.panels.fit import FitPanel
from tcfit_app.panels.fit_progress import POINTS, charted, curves
from tcfit_app.panels.fit_settings import differences, nearest_preset
from tcfit_app.view_state import FitSettings
from tests.app.panel_pages import QUICK, PanelPage, panel_page


@pytest.fixture
def page(panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel) -> Iterator[PanelPage]:
    with panel_page(panel_server, tmp_path / "p", tiny_body) as page:
        yield page


@pytest.fixture
def panel(page: PanelPage) -> FitPanel:
    panel = FitPanel(page)
    panel.draw()
    return panel


def test_what_is_entered_is_in_the_run(page: PanelPage, panel: FitPanel):
    page.enter("w_T", 42.5)
    page.enter("Mode", "sliding window")
    page.enter("Window", 3)
    page.enter("Focal length", 1000.0)
    page.press("Fit everything")
    (job,) = page.session.jobs.values()
    assert job.run is not None
    page.until(lambda: not page.session.jobs, panel)
    run = page.session.project.runs.get(job.run)
    assert run.state == "finished"
    assert run.config == changed(
        QUICK, {"temporal.weight": 42.5, "temporal.mode": "sliding_window", "temporal.window_size": 3}, origin=""
    )
    clip, camera = page.session.project.clip.camera, page.session.fits.fit(run).camera
    assert camera.focal == (1000.0, pytest.approx(1000 * clip.focal[1] / clip.focal[0]))
    assert camera.center == clip.center and "review" in camera.source
    assert page.corrected_fit().camera == camera  # pyright: ignore
    page.set(frames=range(2, 4))
    panel.draw()
    jobs, submit = [], page.session.worker.submit
    page.session.worker.submit = lambda job: jobs.append(job) or submit(job)  # pyright: ignore
    page.press("Re-run frames 2–3")
    assert jobs[0].job.clip.camera == camera, "it is fitted again as its own camera sees it"
    page.until(lambda: not page.session.jobs, panel)
    rerun = page.session.fits.runs[-1]
    assert (rerun.kind, rerun.frames, rerun.parent) == ("frames", range(2, 4), run.id)
    assert page.session.fits.fit(rerun).camera == camera


@pytest.mark.parametrize(
    ("label", "value", "said"),
    [
        ("Window", 1, "expected 2 or more"),
        ("Window", 2.5, "whole number"),
        ("w_T", -1.0, "0 or more"),
        ("Focal length", 0.0, "above 0"),
        ("Gender", "male", "No male smplx body. Put &lt;SMPLX&gt;.npz there."),
        ("Around", -1, "0 to 1000"),
    ],
)
def test_a_wrong_value_is_told_and_fits_nothing(page: PanelPage, panel: FitPanel, label: str, value: object, said: str):
    page.enter(label, value)
    panel.draw()
    assert said in page.html()
    assert page.find(label).value == value, "it stays, to be put right"
    assert page.find("Fit everything").disabled
    page.press("Fit everything")
    assert page.notices and page.notices[-1].kind == "error"
    assert not page.session.jobs and not page.session.fits.runs
    page.enter("Preset", "tcfit")
    panel.draw()
    if label != "Gender":
        assert page.find(label).value != value
    assert not page.state.settings.problems and said not in page.html()


def test_a_preset_sets_everything_and_changes_are_named(page: PanelPage, panel: FitPanel):
    page.enter("Preset", "tcfit")
    panel.draw()
    assert page.state.settings.config == PRESETS["tcfit"] and not page.find("Back to the preset").visible
    page.enter("w_T", 5.0)
    page.enter("Window", 9)
    panel.draw()
    assert "w_T, window size" in page.html()
    page.press("Back to the preset")
    panel.draw()
    assert page.state.settings.config == PRESETS["tcfit"]
    assert page.find("w_T").value == 100.0 and page.find("Window").value == 7


def test_all_settings_as_a_text(page: PanelPage, panel: FitPanel):
    text = page.find("TOML").value
    assert text == as_toml(QUICK, preset_name="paper")
    page.enter("TOML", text.replace("hand_components = 12", "hand_components = 6"))
    page.press("Use these settings")
    panel.draw()
    assert page.state.settings.config == replace(QUICK, hand_components=6)
    page.enter("TOML", "hand_components = 99")
    page.press("Use these settings")
    assert "hand_components is 99" in page.notices[-1].text
    page.enter("TOML", "[weights\n")
    page.press("Use these settings")
    assert "is no TOML" in page.notices[-1].text
    assert page.state.settings.config == replace(QUICK, hand_components=6)


def test_echoes_of_the_server_are_ignored(page: PanelPage, panel: FitPanel):
    before = page.state.settings
    for label in ("Preset", "w_T", "Mode", "Focal length", "Around", "Gender", "TOML"):
        page.echo(label)
    assert page.state.settings is before


def test_nothing_is_sent_when_nothing_changed(page: PanelPage, panel: FitPanel):
    page.sent.clear()
    panel.draw()
    assert not page.sent
    page.enter("w_T", 5.0)
    panel.draw()
    assert page.sent
    page.sent.clear()
    panel.draw()
    panel.draw()
    assert not page.sent


def test_typing_on_is_not_overwritten(page: PanelPage, panel: FitPanel):
    """Two values come in before the drawing thread takes the first."""
    waiting: list = []
    page._do = waiting.append
    page.enter("w_T", 1.0)
    page.enter("w_T", 12.0)
    waiting.pop(0)()
    panel.draw()
    assert page.find("w_T").value == 12.0
    waiting.pop(0)()
    panel.draw()
    assert page.find("w_T").value == 12.0 == page.state.settings.config.temporal.weight


def test_cancel_and_what_remains_to_be_seen(page: PanelPage, panel: FitPanel):
    page.enter("TOML", as_toml(replace(QUICK, settings=replace(QUICK.settings, iterations=500)), preset_name="paper"))
    page.press("Use these settings")
    page.press("Fit everything")
    page.press("Fit everything")
    page.until(lambda: next(iter(page.session.jobs.values())).progress, panel)
    assert "phase 1 of 3" in page.html() and "waiting" in page.html()
    page.press("Cancel all")
    page.until(lambda: not page.session.jobs, panel)
    panel.draw()
    assert [run.state for run in page.session.fits.runs] == ["cancelled"] * 2
    assert "cancelled" in page.html() and not page.find("Cancel").visible


def test_a_failure_is_shown_until_the_next_job(page: PanelPage, panel: FitPanel, monkeypatch: pytest.MonkeyPatch):
    def fail(*_: object) -> None:
        raise MemoryError("no <b>memory</b>")

    with monkeypatch.context() as broken:
        broken.setattr("tcfit_app.jobs.fit_events", fail)
        page.press("Fit everything")
        page.until(lambda: not page.session.jobs, panel)
    panel.draw()
    assert "MemoryError: no &lt;b&gt;memory&lt;/b&gt;" in page.html()
    page.press("Fit everything")
    panel.draw()
    assert "MemoryError" not in page.html()


def test_edited_and_flagged_frames_are_re_run(page: PanelPage, panel: FitPanel):
    run = page.fit()
    panel.draw()
    assert page.find("Re-run around edits").disabled
    page.session.edit(MarkBad(frames=(1,), joints=(4,)), author="test")
    assert page.session.frames_edited_since(run) == {1}
    page.session.undo(author="test")
    assert page.session.frames_edited_since(run) == {1}, "undone again is changed again"
    page.session.mark([5], "flag", author="test")
    page.enter("Around", 0)
    panel.draw()
    page.press("Re-run around edits: 1, 5")
    page.until(lambda: not page.session.jobs, panel)
    again = page.session.fits.fit(page.session.fits.runs[-1]).last.params.body_pose
    before = page.session.fits.fit(run).last.params.body_pose
    moved = np.flatnonzero((again != before).any(1).numpy())
    assert set(moved) <= {1, 5}


def test_loss_curves_are_thinned_and_have_the_largest_terms():
    costs = {f"term{i}": float(i) for i in range(9)}
    losses = [(0.5 * i, {**costs, "total": 36.0}) for i in range(5000)]
    names = charted(losses)
    assert names == ("total", "term4", "term5", "term6", "term7", "term8")
    x, *ys = curves([(0.0, {"total": 0.0, "term8": float("inf")}), *losses], names)
    assert len(x) == POINTS and x[0] == 0 and x[-1] == losses[-1][0]
    assert ys[0][0] > 0, "the axis is logarithmic" and np.isnan(ys[-1][0])


def test_presets_are_told_apart():
    for name, config in PRESETS.items():
        assert nearest_preset(config) == name and not differences(config, name)
    assert FitSettings().preset == nearest_preset(FitSettings().config)
