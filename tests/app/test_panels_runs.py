"""The panels Runs, Compare and Export on fits of a tiny project."""

import io
import json
import time
from collections.abc import Iterator
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.io.openpose import read_openpose
from tcfit_app import exports
from tcfit_app.exporting import Exporting
from tcfit_app.exports import EXPORTS, Export, ExportSource
from tcfit_app.fits import FitChoice
from tcfit_app.panels import compare
from tcfit_app.panels.compare import ComparePanel, peaks
from tcfit_app.panels.export import ExportPanel
from tcfit_app.panels.runs import RunsPanel
from tests.app.panel_pages import FRAMES, QUICK, PanelPage, panel_page

EVIL = "<img src=x onerror=alert(1)>"


@pytest.fixture
def page(panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel) -> Iterator[PanelPage]:
    with panel_page(panel_server, tmp_path / "p", tiny_body) as page:
        yield page


def test_runs_are_renamed_shown_deleted_and_restored(page: PanelPage):
    panel = RunsPanel(page)
    panel.draw()
    assert "Nothing was fitted yet" in page.html()
    first, second = page.fit(), page.fit()
    panel.draw()
    page.enter("Run", f"{first.id} · {first.name}")
    page.enter("Name", EVIL)
    _choose(page, "Rename")
    panel.draw()
    assert page.session.project.runs.get(first.id).name == EVIL
    assert "<img" not in page.html() and "&lt;img src=x" in page.html()
    _choose(page, "Show as A")
    assert page.state.a == FitChoice(run=first.id)
    panel.draw()
    _choose(page, "Delete")
    panel.draw()
    assert [run.id for run in page.session.fits.runs] == [second.id]
    page.press("Restore")
    panel.draw()
    assert [run.id for run in page.session.fits.runs] == [first.id, second.id]


def test_removing_for_good_asks(page: PanelPage):
    panel = RunsPanel(page)
    run = page.fit()
    panel.draw()
    _choose(page, "Delete")
    panel.draw()
    page.press("Remove for good")
    assert page.session.project.runs.get(run.id).deleted
    page.press("Remove 1 deleted run")
    with pytest.raises(InputError, match="no run"):
        page.session.project.runs.get(run.id)


def test_settings_of_a_run_are_taken_for_the_next(page: PanelPage):
    panel = RunsPanel(page)
    page.fit()
    panel.draw()
    page.enter("Run", "1 · Run 1")
    page.set(settings=type(page.state.settings)())
    page.press("Use its settings")
    settings = page.state.settings
    assert (settings.config, settings.preset, settings.focal) == (QUICK, "paper", None)


def test_a_run_without_a_name_or_result_is_refused(page: PanelPage):
    panel = RunsPanel(page)
    page.fit()
    panel.draw()
    page.enter("Name", "   ")
    _choose(page, "Rename")
    assert page.notices[-1].kind == "error" and page.session.fits.runs[0].name == "Run 1"


@pytest.mark.parametrize("kind", [RunsPanel, ComparePanel, ExportPanel])
def test_nothing_is_sent_when_nothing_changed(page: PanelPage, kind: type, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compare, "SETTLING", 0.0)
    page.fit()
    panel = kind(page)
    page.until(lambda: not getattr(panel, "_waiting", False) and page.sent, panel)
    end = time.monotonic() + 0.3
    while time.monotonic() < end:
        panel.draw()
    page.sent.clear()
    panel.draw()
    assert not page.sent


def test_two_fits_are_compared(page: PanelPage, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compare, "SETTLING", 0.0)
    panel = ComparePanel(page)
    panel.draw()
    assert "There is none yet" in page.html()
    page.fit()
    panel.draw()
    assert "being measured" in page.html()
    page.until(lambda: "Jitter" in page.html(), panel)
    page.until(lambda: not panel._waiting, panel)
    frames = page.find("Differ most").options
    assert 1 <= len(frames) <= FRAMES
    page.enter("Differ most", frames[0])
    assert page.state.frame == int(frames[0])


def test_peaks_are_apart_from_each_other():
    values = np.zeros(100)
    values[[10, 11, 12, 50, 90]] = 5, 9, 6, 7, 8
    values[70] = np.nan
    assert peaks(values) == [11, 90, 50]
    assert peaks(np.zeros(5)) == [] == peaks(np.zeros(0))


def test_files_are_downloaded(page: PanelPage):
    panel = ExportPanel(page)
    panel.draw()
    assert page.find("Summary").disabled and not page.find("Corrected keypoints").disabled
    page.press("Summary")
    assert "no fit to export" in page.notices[-1].text
    page.fit()
    panel.draw()
    got = {}
    for name in ("fit", "summary", "figures", "keypoints"):
        page.press(EXPORTS[name].title)
        assert panel.running is not None
        panel.running.join(30)
        panel.draw()
        assert panel.running.state == "finished", panel.running.reason
        got[name] = page.client.downloads["test clip" + EXPORTS[name].suffix]  # pyright: ignore
    with np.load(io.BytesIO(got["fit"]), allow_pickle=False) as fit:
        assert fit["poses"].shape == (FRAMES, 165) and bool(fit["complete"])
    assert json.loads(got["summary"])["frames"] == FRAMES
    rows = got["figures"].decode().splitlines()
    assert len(rows) == FRAMES + 1 and rows[0].startswith("frame,A Reprojection") and rows[1].startswith("0,")
    with ZipFile(io.BytesIO(got["keypoints"])) as archive:
        assert len(archive.namelist()) == FRAMES


def test_exported_keypoints_are_the_corrected_ones(page: PanelPage, tmp_path: Path):
    ExportPanel(page)
    page.press("Corrected keypoints")
    while not page.client.downloads:  # pyright: ignore
        time.sleep(0.01)
    (content,) = page.client.downloads.values()  # pyright: ignore
    with ZipFile(io.BytesIO(content)) as archive:
        archive.extractall(tmp_path / "read")
    people = read_openpose(tmp_path / "read")
    assert len(people.frames) == FRAMES


def test_an_export_can_be_cancelled_and_can_fail(page: PanelPage):
    def endless(source: ExportSource, path: Path, progress: exports.Progress) -> None:
        path.write_bytes(b"half")
        while True:
            progress(0.5)
            time.sleep(0.001)

    def broken(source: ExportSource, path: Path, progress: exports.Progress) -> None:
        raise InputError("No off-screen OpenGL here.")

    source, got = ExportSource(clip=page.session.project.clip, a=None, b=None), []
    one = Exporting(Export(title="x", suffix=".x", hint="", write=endless), source, got.append)
    one.cancel()
    one.join(10)
    other = Exporting(Export(title="x", suffix=".x", hint="", write=broken), source, got.append)
    other.join(10)
    assert (one.state, other.state, other.reason) == ("cancelled", "failed", "No off-screen OpenGL here.")
    assert not got


def _choose(page: PanelPage, option: str) -> None:
    """Press a button of a group."""
    groups = [h for h in page.client.gui._gui_input_handle_from_uuid.values() if option in getattr(h, "options", ())]
    groups[0]._impl.value = option
    page._call(groups[0], client=page.client)
