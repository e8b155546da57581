"""The panel Export."""

import io
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from fitting_core.camera import World
from fitting_core.errors import InputError
from fitting_core.io import read_detections
from fitting_core.motion import OWN_WORLD, Progress
from tcfit_app.exports.source import ExportSource
from tcfit_app.exports.table import EXPORTS, Export
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.kinds import MoveKeypoint
from tcfit_app.review.browser.page_events import Press
from tcfit_app.review.panels.export_panel import ExportPanel
from tests.drivers.lone_page import LonePage
from tests.samples.sessions import FRAMES
from tests.tcfit_app.review.panels.conftest import Opener

FOLDS = frozenset({"export.formats", "export.axes"})

_MADE = (
    "glb",
    "npz",
    "bvh",
    "trc",
    "trc-markers",
    "c3d",
    "contacts",
    "joints",
    "smplifyx",
    "fit",
    "mixamo",
    "unreal",
    "vrm",
    "vrma",
    "angles",
    "mot",
    "obj",
    "openpose",
    "coco",
    "pose",
    "figures",
    "summary",
)
"""Exports that need neither OpenGL nor a video."""


def opened(panel_of: Opener) -> LonePage:
    """The panel, with its folds open."""
    tested = panel_of(ExportPanel)
    tested.page.tab.set(folds=FOLDS)
    return tested


def downloaded(tested: LonePage, name: str) -> bytes:
    """What the browser gets of an export."""
    tested.downloads.clear()
    tested.press("export.begin", name)
    running = tested.page.gestures.exporting.task.last
    tested.settle()
    assert running is not None
    assert running.state == "finished", running.reason
    assert tested.page.tab.message[0].startswith(f"{running.title}: downloaded")
    return tested.downloads[running.title]


def test_files_are_downloaded(panel_of: Opener):
    tested = opened(panel_of)
    exporting = tested.page.gestures.exporting
    assert tested.button("Summary").disabled and not tested.button("OpenPose").disabled
    assert "There is no finished fit yet." in tested.html() and "Go to Fit" in tested.html()
    tested.page.receive(Press("export.begin", "summary"))
    assert exporting.task.last is None, "a button that is off does nothing"
    with pytest.raises(InputError, match="no finished fit to export"):
        exporting.begin("summary")
    tested.fit()
    got = {name: downloaded(tested, name) for name in _MADE if not EXPORTS[name].missing()}
    with np.load(io.BytesIO(got["fit"]), allow_pickle=False) as fit:
        assert fit["poses"].shape == (FRAMES, 165) and bool(fit["complete"])
    assert json.loads(got["summary"])["frames"] == FRAMES
    rows = got["figures"].decode().splitlines()
    assert len(rows) == FRAMES + 1 and rows[0].startswith("frame,time_ms,A Reprojection")
    assert rows[1].startswith("0,0,") and rows[2].startswith("1,40,")
    assert got["trc"].startswith(b"PathFileType") and got["trc-markers"].startswith(b"PathFileType")
    assert got["c3d"][1:2] == b"\x50" and got["contacts"].startswith(b"side,first_frame")
    assert got["angles"].startswith(b"# Joint angles") and b"nRows=" + str(FRAMES).encode() in got["mot"]
    assert sum(not line.startswith(b"#") for line in got["joints"].splitlines()) == FRAMES + 1
    assert got["glb"].startswith(b"glTF") and json.loads(got["coco"])["images"]
    for name, suffix, count in (("bvh", ".bvh", 1), ("obj", ".obj", FRAMES), ("smplifyx", ".pkl", FRAMES)):
        with ZipFile(io.BytesIO(got[name])) as archive:
            assert sum(entry.endswith(suffix) for entry in archive.namelist()) == count
            assert any(entry.endswith(".json") for entry in archive.namelist()), "what the format has no place for"
    others = {"fbx", "elan", "picture", "sheet", "overlay", "side-by-side"}
    assert set(EXPORTS) - set(_MADE) == others


def test_run_frames_and_axes_are_chosen(panel_of: Opener):
    tested = opened(panel_of)
    tested.fit()
    assert "export.selected" not in tested.html() and "export.side" not in tested.html()
    tested.page.tab.set(frames=range(2, 5), mode="ab")
    tested.click("Frames 2–4")
    tested.press("export.side", "a")
    tested.click("y up")
    run = tested.page.tab.session.fits.runs[0]
    first = tested.page.tab.session.fits.fit(run).phase(1)
    assert first is not None
    with np.load(io.BytesIO(downloaded(tested, "npz")), allow_pickle=False) as read:
        assert read["trans"].shape == (3, 3) and int(read["first_frame"]) == 2
        assert str(read["axes"]).startswith("y-up")
        assert np.allclose(read["pose_body"], first.params.body_pose[2:5])
    tested.page.tab.set(frames=None)
    tested.draw()
    with np.load(io.BytesIO(downloaded(tested, "npz")), allow_pickle=False) as read:
        assert len(read["trans"]) == FRAMES, "the selection is gone, and with it the wish"


def test_a_view_of_pictures_is_chosen(panel_of: Opener):
    tested = opened(panel_of)
    tested.fit()
    for label, views in (("side", ("side",)), ("both", ("camera", "side")), ("camera", ("camera",))):
        tested.press("export.view", {"camera": ""}.get(label, label))
        assert tested.page.gestures.exporting.source(EXPORTS["picture"]).views == views


@pytest.mark.parametrize("missing", ["Install Blender first.", ""])
def test_fbx_waits_for_blender(panel_of: Opener, monkeypatch: pytest.MonkeyPatch, missing: str):
    monkeypatch.setitem(EXPORTS, "fbx", replace(EXPORTS["fbx"], missing=lambda: missing))
    tested = opened(panel_of)
    tested.fit()
    tested.draw()
    assert tested.button("Character (FBX)").disabled == bool(missing) and missing in tested.html()
    assert tested.button("Unity, Unreal").value == ("glb" if missing else "fbx")


def test_the_axes_of_the_calibration_are_offered_where_a_camera_stands_in_a_world(panel_of: Opener):
    tested = opened(panel_of)
    project = tested.page.tab.session.project
    assert "calibration" not in tested.html()
    turned = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
    world = World(rotation=turned, translation=(0.3, 1.2, 4.0), up="z")
    project.set_camera(replace(project.clip.camera, world=world))
    run = tested.fit()
    tested.page.tab.set(a=FitChoice())  # the button is drawn anew
    tested.click("calibration's")
    with np.load(io.BytesIO(downloaded(tested, "npz")), allow_pickle=False) as read:
        axes, place, to_world = str(read["axes"]), read["camera_place"], read["camera_to_world"]
    assert axes.startswith(OWN_WORLD)
    np.testing.assert_allclose(to_world, np.array(turned).T)
    np.testing.assert_allclose(place, world.place)
    assert tested.page.tab.session.fits.fit(run).camera.world == world


def test_files_name_run_phase_and_frames_unless_they_are_the_usual_ones(panel_of: Opener):
    tested = opened(panel_of)
    run, clip = tested.fit(), tested.page.tab.session.project.clip.name

    def name(export: str) -> str:
        downloaded(tested, export)
        return next(iter(tested.downloads)).removeprefix(clip)

    assert [name(export) for export in ("npz", "figures", "pose")] == [".smplx.npz", ".figures.csv", ".pose"]
    tested.page.tab.set(frames=range(2, 5), mode="ab")
    tested.press("export.side", "a")
    tested.press("export.selected", "True")
    assert name("npz") == "-fit1-first-pass-2-4.smplx.npz"
    assert name("figures") == "-2-4.figures.csv", "it shows A and B"
    assert name("pose") == "-2-4.pose"
    tested.page.tab.set(frames=None, a=FitChoice(phase=2))
    tested.draw()
    assert name("figures") == "-fit1-one-shape-fit1.figures.csv"
    second = tested.fit()
    tested.page.tab.set(b=FitChoice(run=run.id))
    tested.page.tab.set(mode="edit")
    assert name("summary") == "-fit1.summary.json"
    tested.page.tab.set(b=FitChoice(run=second.id))
    assert name("summary") == ".summary.json"


def test_exported_keypoints_are_the_corrected_ones(panel_of: Opener, tmp_path: Path):
    tested = opened(panel_of)
    session = tested.page.tab.session
    session.project.append(MoveKeypoint(frames=(3,), joints=(4,), xy=(((12.5, 34.25),),)))
    (tmp_path / "got.zip").write_bytes(downloaded(tested, "openpose"))
    with ZipFile(tmp_path / "got.zip") as archive:
        archive.extractall(tmp_path / "openpose")
    for name in ("coco", "pose"):
        (tmp_path / f"keypoints.{name}").write_bytes(downloaded(tested, name))
    for path in (tmp_path / "openpose", tmp_path / "keypoints.coco", tmp_path / "keypoints.pose"):
        people = read_detections(path)
        assert len(people.frames) == FRAMES
        assert np.allclose(people.frames[3][0, 4, :2], (12.5, 34.25), atol=0.01)


def endless(source: ExportSource, path: Path, progress: Progress) -> None:
    path.write_bytes(b"half")
    while True:
        progress(0.5)
        time.sleep(0.001)


def broken(source: ExportSource, path: Path, progress: Progress) -> None:
    raise InputError("No off-screen OpenGL here.")


def exporting(panel_of: Opener, monkeypatch: pytest.MonkeyPatch, write: Callable[..., None]) -> LonePage:
    """The panel, with a format that is written so."""
    export = Export(title="Odd", group="Blender", suffix=".x", hint="", write=write, needs="keypoints")
    monkeypatch.setitem(EXPORTS, "odd", export)
    return opened(panel_of)


def test_an_export_can_be_cancelled(panel_of: Opener, monkeypatch: pytest.MonkeyPatch):
    tested = exporting(panel_of, monkeypatch, endless)
    tested.press("export.begin", "odd")
    shown = lambda: [message for message in tested.page.header.status.messages(0.0, "") if message.progress]  # noqa: E731
    tested.until(lambda: shown() and shown()[0].progress == 0.5)
    with pytest.raises(InputError, match="wait for it"):
        tested.press("export.begin", "odd")
    (message,) = shown()
    assert "clip.x: being written" in message.text and message.cancel is not None
    message.cancel()
    tested.settle()
    assert not tested.downloads and not shown()


def test_why_an_export_fails_is_told(panel_of: Opener, monkeypatch: pytest.MonkeyPatch):
    tested = exporting(panel_of, monkeypatch, broken)
    tested.press("export.begin", "odd")
    tested.settle()
    assert tested.notices[-1].text == "No off-screen OpenGL here." and not tested.downloads


def test_an_export_ends_with_its_tab(panel_of: Opener, monkeypatch: pytest.MonkeyPatch):
    tested = exporting(panel_of, monkeypatch, endless)
    tested.press("export.begin", "odd")
    running = tested.page.gestures.exporting.task.last
    assert running is not None
    tested.page.close()
    tested.until(lambda: running.state == "cancelled")
    tested.until(lambda: not tested.page.tab.session.tasks.busy)
