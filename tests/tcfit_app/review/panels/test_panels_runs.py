"""The panels Runs, Compare and Export on fits of a tiny project."""

import io
import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
import viser

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.camera import World
from fitting_core.errors import InputError
from fitting_core.io import read_detections
from fitting_core.motion import OWN_WORLD, Progress
from tcfit_app.analysis.run_metrics import Metric
from tcfit_app.analysis.seen import FAINT
from tcfit_app.exports.source import ExportSource
from tcfit_app.exports.table import EXPORTS, Export
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.project.edits.kinds import MarkBad, MoveKeypoint
from tcfit_app.project.packed import unpack
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Given, Source
from tcfit_app.review.browser.page_events import Press
from tcfit_app.review.drawing.frame import Frames
from tcfit_app.review.panels.compare_panel import ComparePanel
from tcfit_app.review.panels.export_panel import ExportPanel
from tcfit_app.review.panels.runs.runs_panel import RunsPanel
from tcfit_app.review.panels.view_panel import run_names
from tcfit_app.review.tab.state import FitSettings
from tests.drivers.lone_page import LonePage, tiny_page
from tests.samples.sessions import FRAMES, QUICK

EVIL = "<img src=x onerror=alert(1)>"


Opener = Callable[[type], LonePage]


@pytest.fixture
def panel_of(panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel) -> Iterator[Opener]:
    with ExitStack() as opened:
        yield lambda kind: opened.enter_context(tiny_page(panel_server, tmp_path / "p", tiny_body, kind))


def test_runs_are_renamed_shown_deleted_and_restored(panel_of: Opener):
    tested = panel_of(RunsPanel)
    session = tested.page.tab.session
    assert "No fits yet" in tested.html()
    first, second = tested.fit(), tested.fit()
    tested.press("runs.choose", str(first.id))
    tested.draw()
    tested.enter("Name", EVIL)
    tested.click("Rename")
    assert session.project.runs.get(first.id).name == EVIL
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
    assert tested.field("Name").value == EVIL


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
    assert tested.notices[-1].kind == "error" and tested.page.tab.session.fits.runs[0].name == "Run 1"


def test_nothing_is_sent_when_nothing_changed(panel_of: Opener):
    tested = panel_of(ComparePanel)
    before = tested.html()
    tested.fit()
    assert tested.html() != before
    tested.until(lambda: "Jitter" in tested.html())
    assert not tested.draw()


def test_two_fits_are_compared(panel_of: Opener):
    tested = panel_of(ComparePanel)
    assert "Make one in the panel Fit first" in tested.html()
    tested.fit()
    assert "Measuring" in tested.html()
    tested.until(lambda: "Jitter" in tested.html() and "B − A" in tested.html())


def test_a_re_run_stands_beside_what_it_came_from(panel_of: Opener):
    tested = panel_of(RunsPanel)
    first = tested.fit()
    tab, session = tested.page.tab, tested.page.tab.session
    assert tested.button("Compare with its parent").disabled
    tab.set(frames=range(2, 5))
    tested.page.gestures.fitting.frames()
    rerun = session.fits.runs[-1]
    assert (tab.state.a.run, tab.state.b.run) == (first.id, rerun.id)
    tested.until(lambda: not session.jobs)
    a, b = tab.look().a, tab.look().b
    assert a is not None and b is not None and (a.run.id, b.run.id) == (first.id, rerun.id)
    seconds = {metric.name: metric.value for metric in _metrics(tested, b)}["seconds"]
    assert b.result is not None and seconds == pytest.approx(b.result.seconds), "its own, not its parent's"
    tab.set(a=FitChoice(), b=FitChoice())
    tested.draw()
    tested.click("Compare with its parent")
    assert (tab.state.mode, tab.state.a.run, tab.state.b.run) == ("ab", first.id, rerun.id)


def _metrics(tested: LonePage, shown: Shown) -> tuple[Metric, ...]:
    found: list[tuple[Metric, ...] | None] = []
    tested.until(lambda: found.append(tested.page.tab.data.metrics(shown)) or found[-1] is not None)
    assert found[-1] is not None
    return found[-1]


def test_fits_are_compared_with_a_reference(panel_of: Opener, tmp_path: Path):
    tested = panel_of(ComparePanel)
    points = np.random.default_rng(0).normal(0, 0.2, (FRAMES, len(kp.LIMBS), 3))
    np.savez(tmp_path / "reference.npz", points=points, names=np.array(kp.NAMES)[kp.LIMBS])
    tested.draw()
    assert "only be compared with each other" in tested.html()
    tested.click("Compare with this")
    assert tested.notices[-1].kind == "error" and "Type where" in tested.notices[-1].text
    tested.enter("File", str(tmp_path / "reference.npz"))
    tested.enter("Begins at frame", "-2")
    tested.click("Compare with this")
    assert "expected a whole number" in tested.notices[-1].text
    first = tested.page.tab.session.project.clip.first_frame
    tested.enter("Begins at frame", str(first + 2))
    tested.click("Compare with this")
    tested.until(lambda: "in its own world" in tested.html())
    tested.fit()
    tested.until(lambda: f"PA-MPJPE, {FRAMES - 2} of {FRAMES} frames" in tested.html())
    assert tested.page.tab.session.project.reference is not None
    tested.click("Remove the reference")
    tested.until(lambda: "PA-MPJPE" not in tested.html())
    assert tested.page.tab.session.project.reference is None


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


def downloaded(tested: LonePage, name: str) -> bytes:
    """What the browser gets of an export."""
    tested.press("export.begin", name)
    running = tested.panels[0].running
    tested.settle()
    assert running.state == "finished", running.reason
    assert "downloaded" in tested.html()
    return tested.downloads[running.title]


def test_files_are_downloaded(panel_of: Opener):
    tested = panel_of(ExportPanel)
    assert tested.button("Summary").disabled and not tested.button("OpenPose").disabled
    tested.page.receive(Press("export.begin", "summary"))
    assert tested.panels[0].running is None, "a button that is off does nothing"
    with pytest.raises(InputError, match="no fit to export"):
        tested.panels[0]._begin(EXPORTS["summary"])
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
    others = {"fbx", "elan", "picture", "sheet", "overlay", "side-by-side", "project", "project-with-video"}
    assert set(EXPORTS) - set(_MADE) == others


def test_run_frames_and_axes_are_chosen(panel_of: Opener):
    tested = panel_of(ExportPanel)
    tested.fit()
    tested.draw()
    assert tested.button("selected").disabled
    tested.page.tab.set(frames=range(2, 5))
    tested.click("frames 2–4")
    tested.click("A: ")
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
    tested = panel_of(ExportPanel)
    tested.fit()
    for label, views in (("side", ("side",)), ("both", ("camera", "side")), ("camera", ("camera",))):
        tested.press("export.view", {"camera": ""}.get(label, label))
        assert tested.panels[0]._source(EXPORTS["picture"]).views == views


@pytest.mark.parametrize("missing", ["Install Blender first.", ""])
def test_fbx_waits_for_blender(panel_of: Opener, monkeypatch: pytest.MonkeyPatch, missing: str):
    monkeypatch.setitem(EXPORTS, "fbx", replace(EXPORTS["fbx"], missing=lambda: missing))
    tested = panel_of(ExportPanel)
    tested.fit()
    tested.draw()
    assert tested.button("Character (FBX)").disabled == bool(missing) and missing in tested.html()


def test_the_axes_of_the_calibration_are_offered_where_a_camera_stands_in_a_world(panel_of: Opener):
    tested = panel_of(ExportPanel)
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
    tested = panel_of(ExportPanel)
    run, clip = tested.fit(), tested.page.tab.session.project.clip.name

    def name(export: str) -> str:
        downloaded(tested, export)
        return tested.panels[0].running.title.removeprefix(clip)

    assert [name(export) for export in ("npz", "figures", "pose")] == [".smplx.npz", ".figures.csv", ".pose"]
    tested.press("export.side", "A")
    tested.page.tab.set(frames=range(2, 5))
    tested.press("export.frames", "selected")
    assert name("npz") == f"-run{run.id}-per-frame-2-4.smplx.npz"
    assert name("figures") == "-2-4.figures.csv", "it shows A and B"
    assert name("pose") == "-2-4.pose" and name("project") == ".tcfit.zip"
    tested.page.tab.set(frames=None, a=FitChoice(phase=2))
    tested.draw()
    assert name("figures") == f"-run{run.id}-shared-shape-run{run.id}-temporal.figures.csv"
    second = tested.fit()
    tested.page.tab.set(b=FitChoice(run=run.id))
    tested.press("export.side", "B")
    assert name("summary") == f"-run{run.id}-temporal.summary.json"
    tested.page.tab.set(b=FitChoice(run=second.id))
    assert name("summary") == ".summary.json"


def test_long_names_of_runs_are_told_apart(panel_of: Opener):
    tested = panel_of(ExportPanel)
    run = tested.fit()
    name = f"a very long name {'of a run ' * 15}corrected"
    tested.page.tab.session.project.runs.rename(run.id, name)
    shown = tested.html()
    assert f'<span class="tcfit-name">{name}</span><span class="tcfit-phase"> · temporal</span>' in shown
    assert f'title="{name} · temporal"' in shown
    renamed = tested.page.tab.session.fits.runs[0]
    others = [replace(renamed, id=2, name=f"{name} twice"), replace(renamed, id=3, name=f"{name[:9]}, {name}")]
    names = run_names([renamed, *others])
    assert names == ["a very long name…n corrected", "a very long name…ected twice", "a very lo, a ver…n corrected"]
    assert run_names([renamed, replace(renamed, id=2)])[1] == "a very long name…n corrected (#2)"
    assert run_names([replace(renamed, name="Newest")]) == ["Newest (#1)"]


def test_the_project_is_downloaded(panel_of: Opener, tmp_path: Path):
    tested = panel_of(ExportPanel)
    tested.fit()
    (tmp_path / "got.zip").write_bytes(downloaded(tested, "project"))
    unpack(tmp_path / "got.zip", tmp_path / "got.tcfit")
    with Project.open(tmp_path / "got.tcfit") as found:
        assert [run.name for run in found.runs.all()] == ["Run 1"] and found.runs.load(1).last.phase == 3


def test_exported_keypoints_are_the_corrected_ones(panel_of: Opener, tmp_path: Path):
    tested = panel_of(ExportPanel)
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
    export = Export(title="Odd", group="Motion", suffix=".x", hint="", write=write, needs="keypoints")
    monkeypatch.setitem(EXPORTS, "odd", export)
    return panel_of(ExportPanel)


def test_an_export_can_be_cancelled(panel_of: Opener, monkeypatch: pytest.MonkeyPatch):
    tested = exporting(panel_of, monkeypatch, endless)
    tested.press("export.begin", "odd")
    tested.until(lambda: "in progress … 50%" in tested.html())
    with pytest.raises(InputError, match="is still being made"):
        tested.press("export.begin", "odd")
    tested.click("Cancel")
    tested.settle()
    assert "cancelled" in tested.html() and not tested.downloads


def test_why_an_export_fails_is_told(panel_of: Opener, monkeypatch: pytest.MonkeyPatch):
    tested = exporting(panel_of, monkeypatch, broken)
    tested.press("export.begin", "odd")
    tested.settle()
    assert "No off-screen OpenGL here." in tested.html() and not tested.downloads


def test_an_export_ends_with_its_tab(panel_of: Opener, monkeypatch: pytest.MonkeyPatch):
    tested = exporting(panel_of, monkeypatch, endless)
    tested.press("export.begin", "odd")
    running = tested.panels[0].running
    tested.page.close()
    tested.until(lambda: running.state == "cancelled")
    tested.until(lambda: not tested.page.tab.session.tasks.busy)
