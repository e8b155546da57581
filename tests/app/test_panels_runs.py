"""The panels Runs, Compare and Export on fits of a tiny project."""

import io
import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
import viser

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.io.openpose import read_openpose
from tcfit_app import exports
from tcfit_app.between_runs import peaks
from tcfit_app.exporting import Exporting
from tcfit_app.exports import EXPORTS, Export, ExportSource
from tcfit_app.fits import FitChoice
from tcfit_app.panels import compare
from tcfit_app.panels.compare import ComparePanel
from tcfit_app.panels.export import ExportPanel
from tcfit_app.panels.runs import RunsPanel
from tcfit_app.view_state import FitSettings
from tests.app.lone_page import LonePage, tiny_page
from tests.app.project_samples import sample_clip
from tests.app.sessions import FRAMES, QUICK

EVIL = "<img src=x onerror=alert(1)>"


Opener = Callable[[type], LonePage]


@pytest.fixture
def panel_of(panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel) -> Iterator[Opener]:
    with ExitStack() as opened:
        yield lambda kind: opened.enter_context(tiny_page(panel_server, tmp_path / "p", tiny_body, kind))


def test_runs_are_renamed_shown_deleted_and_restored(panel_of: Opener):
    tested = panel_of(RunsPanel)
    session = tested.page.session
    assert "Nothing was fitted yet" in tested.html()
    first, second = tested.fit(), tested.fit()
    tested.enter("Run", f"{first.id} · {first.name}")
    tested.draw()
    tested.enter("Name", EVIL)
    tested.click("Rename")
    assert session.project.runs.get(first.id).name == EVIL
    assert "<img" not in tested.html() and "&lt;img src=x" in tested.html()
    tested.click("Show as A")
    assert tested.page.state.a == FitChoice(run=first.id)
    tested.click("Delete")
    tested.draw()
    assert [run.id for run in session.fits.runs] == [second.id]
    tested.press("deleted.restore")
    assert [run.id for run in session.fits.runs] == [first.id, second.id]
    tested.press("runs.choose", str(first.id))
    tested.draw()
    assert tested.field("Run").value == f"{first.id} · {EVIL}" and tested.field("Name").value == EVIL


def test_removing_for_good_asks(panel_of: Opener):
    tested = panel_of(RunsPanel)
    run = tested.fit()
    tested.click("Delete")
    tested.click("Remove all for good")
    assert tested.page.session.project.runs.get(run.id).deleted
    tested.click("Keep them")
    assert "Remove 1 deleted run" not in tested.html()
    tested.click("Remove all for good")
    tested.click("Remove 1 deleted run")
    with pytest.raises(InputError, match="no run"):
        tested.page.session.project.runs.get(run.id)


def test_settings_of_a_run_are_taken_for_the_next(panel_of: Opener):
    tested = panel_of(RunsPanel)
    tested.fit()
    tested.page.set(settings=FitSettings())
    tested.click("Use its settings")
    settings = tested.page.state.settings
    assert (settings.config, settings.preset, settings.focal) == (QUICK, "paper", None)


def test_a_run_without_a_name_is_refused(panel_of: Opener):
    tested = panel_of(RunsPanel)
    tested.fit()
    tested.draw()
    tested.enter("Name", "   ")
    tested.click("Rename")
    assert tested.notices[-1].kind == "error" and tested.page.session.fits.runs[0].name == "Run 1"


@pytest.mark.parametrize("kind", [RunsPanel, ComparePanel, ExportPanel])
def test_nothing_is_sent_when_nothing_changed(panel_of: Opener, kind: type, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compare, "SETTLING", 0.0)
    tested = panel_of(kind)
    before = tested.html()
    tested.fit()
    assert tested.html() != before
    tested.until(lambda: not getattr(tested.panels[0], "_waiting", False))
    tested.draw()
    assert not tested.draw()


def test_two_fits_are_compared(panel_of: Opener, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compare, "SETTLING", 0.0)
    tested = panel_of(ComparePanel)
    assert "There is none yet" in tested.html()
    tested.fit()
    assert "Being measured" in tested.html()
    tested.until(lambda: "Jitter" in tested.html() and "compare.frame" in tested.html())
    tested.press("compare.frame", "3")
    assert tested.page.state.frame == 3


def test_fits_are_compared_with_a_reference(panel_of: Opener, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(compare, "SETTLING", 0.0)
    tested = panel_of(ComparePanel)
    points = np.random.default_rng(0).normal(size=(FRAMES, len(kp.LIMBS), 3))
    np.savez(tmp_path / "reference.npz", points=points, names=np.array(kp.NAMES)[kp.LIMBS])
    tested.draw()
    assert "only be compared with each other" in tested.html()
    tested.click("Compare with it")
    assert tested.notices[-1].kind == "error" and "Type where" in tested.notices[-1].text
    tested.enter("Path", str(tmp_path / "reference.npz"))
    tested.click("Compare with it")
    tested.until(lambda: "a world of its own" in tested.html())
    tested.fit()
    tested.until(lambda: "PA-MPJPE" in tested.html())
    assert tested.page.session.project.reference is not None
    tested.click("Forget the reference")
    tested.until(lambda: "PA-MPJPE" not in tested.html())
    assert tested.page.session.project.reference is None


def test_peaks_are_apart_from_each_other():
    values = np.zeros(100)
    values[[10, 11, 12, 50, 90]] = 5, 9, 6, 7, 8
    values[70] = np.nan
    assert peaks(values) == [11, 90, 50]
    assert peaks(np.zeros(5)) == [] == peaks(np.zeros(0))


def test_files_are_downloaded(panel_of: Opener):
    tested = panel_of(ExportPanel)
    assert tested.button("Summary").disabled and not tested.button("Corrected keypoints").disabled
    with pytest.raises(InputError, match="no fit to export"):
        tested.press("export.begin", "summary")
    tested.fit()
    for name in ("fit", "summary", "figures", "keypoints"):
        tested.click(EXPORTS[name].title)
        running = tested.panels[0].running
        running.join(30)
        assert running.state == "finished", running.reason
        assert "sent to the downloads" in tested.html()
    got = {name: tested.downloads["test clip" + export.suffix] for name, export in EXPORTS.items() if name != "overlay"}
    with np.load(io.BytesIO(got["fit"]), allow_pickle=False) as fit:
        assert fit["poses"].shape == (FRAMES, 165) and bool(fit["complete"])
    assert json.loads(got["summary"])["frames"] == FRAMES
    rows = got["figures"].decode().splitlines()
    assert len(rows) == FRAMES + 1 and rows[0].startswith("frame,A Reprojection") and rows[1].startswith("0,")
    with ZipFile(io.BytesIO(got["keypoints"])) as archive:
        assert len(archive.namelist()) == FRAMES


def test_exported_keypoints_are_the_corrected_ones(panel_of: Opener, tmp_path: Path):
    tested = panel_of(ExportPanel)
    tested.click("Corrected keypoints")
    tested.until(lambda: tested.downloads)
    (content,) = tested.downloads.values()
    with ZipFile(io.BytesIO(content)) as archive:
        archive.extractall(tmp_path / "read")
    people = read_openpose(tmp_path / "read")
    assert len(people.frames) == FRAMES


def test_an_export_can_be_cancelled_and_can_fail():
    def endless(source: ExportSource, path: Path, progress: exports.Progress) -> None:
        path.write_bytes(b"half")
        while True:
            progress(0.5)
            time.sleep(0.001)

    def broken(source: ExportSource, path: Path, progress: exports.Progress) -> None:
        raise InputError("No off-screen OpenGL here.")

    source, got = ExportSource(clip=sample_clip(), a=None, b=None), []
    one = Exporting(Export(title="x", suffix=".x", hint="", write=endless), source, got.append)
    one.cancel()
    one.join(10)
    other = Exporting(Export(title="x", suffix=".x", hint="", write=broken), source, got.append)
    other.join(10)
    assert (one.state, other.state, other.reason) == ("cancelled", "failed", "No off-screen OpenGL here.")
    assert not got
