"""Results of other programs and learned systems as runs of a project: commands, session, panel Fit, uploads."""

import csv
import pickle
import threading
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
import torch
import viser

from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.errors import InputError
from fitting_core.io import read_motion
from fitting_core.io.motion.animation_npz import write_animation_npz
from fitting_core.io.motion.imported_motion import ImportedMotion
from fitting_core.io.motion.smplifyx import write_smplifyx
from fitting_core.keypoints import Keypoints
from fitting_core.motion import Motion
from fitting_core.priors.files.network import write_prior_network
from tcfit_app.analysis.curves import curve
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.suspicion import findings, review_queue
from tcfit_app.cli.main import main
from tcfit_app.fitting.fits import FitChoice, Fits, Shown
from tcfit_app.imports import results as importing
from tcfit_app.imports.results import ImportChoices, import_run
from tcfit_app.imports.uploads import upload
from tcfit_app.project.project import Project
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tests.drivers.lone_page import LonePage, tiny_page
from tests.fitting_core.io.motion.learned_files import (
    gvhmr,
    joblib_bytes,
    torch_bytes,
    truth,
    wham,
    written,
)
from tests.fitting_core.priors.networks import random_latents, random_network
from tests.samples.project_samples import CAMERA, FRAMES, sample_clip, sample_params
from tests.samples.sessions import OneBody, small_clip

NONE = ImportChoices()


def results(
    folder: Path, body: BodyModel, frames: int = FRAMES, *, first: int = 0, seed: int = 3, rate: float = 25
) -> Path:
    """A folder of SMPLify-X results that tells its body and camera."""
    params = sample_params(seed, frames, 12)
    stems = [f"walk_{first + t:06d}" for t in range(frames)]
    write_smplifyx(folder, params, stems=stems, camera=CAMERA, body=body, frame_rate=rate)
    return folder


def test_smplifyx_results_become_a_run(project: Project, tmp_path: Path, tiny_body: BodyModel):
    folder = results(tmp_path / "smplifyx", tiny_body)
    run = import_run(project, OneBody(tiny_body), folder, name="SMPLify-X")
    assert (run.name, run.kind, run.state, run.parent) == ("SMPLify-X", "imported", "finished", None)
    assert run.summary == {"source": str(folder), "format": "SMPLify-X results", "placed": True}
    with Project.open(project.folder, read_only=True) as again:
        fit = again.runs.load(run.id)
    expected = joints_in_space(tiny_body, sample_params(3, FRAMES, 12))
    assert np.abs(joints_in_space(tiny_body, fit.last.params) - expected).max() < 1e-5
    assert fit.camera.focal == CAMERA.focal and fit.observed.all() and np.isnan(fit.last.frame_cost).all()
    assert fit.last.notes == (f"Imported from {folder}, read as SMPLify-X results.",)


def test_an_export_becomes_a_run_as_it_was(project: Project, tmp_path: Path, tiny_body: BodyModel):
    params = sample_params(5, FRAMES, 12)
    motion = Motion(body=tiny_body, params=params, camera=CAMERA, frame_rate=25.0, name="w").one_shape
    write_animation_npz(tmp_path / "walk.npz", motion.in_axes("z-up"))
    run = import_run(project, OneBody(tiny_body), tmp_path / "walk.npz")
    fit = project.runs.load(run.id)
    assert np.abs(joints_in_space(tiny_body, fit.last.params) - joints_in_space(tiny_body, motion.params)).max() < 1e-9


def test_the_wrong_clip_is_refused_and_nothing_kept(project: Project, tmp_path: Path, tiny_body: BodyModel):
    folder = results(tmp_path / "other", tiny_body, FRAMES - 2, first=100)
    with pytest.raises(InputError, match=f"has {FRAMES - 2} frames .* expected some of the clip's {FRAMES} frames"):
        import_run(project, OneBody(tiny_body), folder)
    assert project.runs.all() == [] and not list((project.folder / "runs").glob("*.npz"))
    # Whose numbers nobody tells may be of any part of the clip.
    arrays = {"poses": np.zeros((FRAMES - 2, 165)), "trans": np.zeros((FRAMES - 2, 3)), "axes": "camera"}
    np.savez(tmp_path / "cut.npz", **arrays)
    with pytest.raises(InputError, match=r"expected all of .* Give --first-frame, .*it may cover part of the clip"):
        import_run(project, OneBody(tiny_body), tmp_path / "cut.npz")
    run = import_run(project, OneBody(tiny_body), tmp_path / "cut.npz", ImportChoices(first_frame=first_frame(project)))
    assert project.runs.load(run.id).observed.any(1).tolist() == [True] * (FRAMES - 2) + [False] * 2


def first_frame(project: Project) -> int:
    return project.clip.first_frame


def test_a_result_of_a_part_of_the_clip_is_shown_and_measured_there_alone(
    project: Project, tmp_path: Path, tiny_body: BodyModel
):
    """As of systems that lose a person and find them again under another number."""
    first = first_frame(project)
    part = results(tmp_path / "part", tiny_body, 3, first=first + 1, rate=project.clip.frame_rate)
    run = import_run(project, OneBody(tiny_body), part)
    fits = Fits(project)
    shown = fits.show(FitChoice(run=run.id))
    assert shown is not None and [shown.has(t) for t in range(FRAMES)] == [False, True, True, True, False, False]
    assert shown == fits.show(FitChoice(run=run.id)), "what is on show is compared at every draw"
    (note,) = (note for note in fits.fit(run).last.notes if "no result" in note)
    assert f"3 of the clip's {FRAMES} frames ({first}, {first + 4}-{first + 5})" in note
    posed = PosedFit.of(project.clip, fits.fit(run), Meshes(tiny_body), there=shown.there)
    for name in ("reprojection_body", "jitter"):
        values = curve(name, posed).values
        assert np.isnan(values[[0, 4, 5]]).all() and np.isfinite(values[1:4]).any(), name
    assert not {found.frame for found in review_queue(findings(posed)).left} & {0, 4, 5}


def test_a_body_that_is_not_here_is_named(project: Project, tmp_path: Path, tiny_body: BodyModel):
    for file in results(tmp_path / "r", tiny_body).rglob("about.json"):
        file.write_text(file.read_text().replace('"body_hash": ""', '"body_hash": "0123456789abcdef"'))
    with pytest.raises(InputError, match=r"needs a neutral smplx body that is missing .SHA-256 0123456789ab"):
        import_run(project, Gone(tiny_body), tmp_path / "r")
    run = import_run(project, Gone(tiny_body), tmp_path / "r", ImportChoices(body_model="smplx"))
    fit = project.runs.load(run.id)
    assert not fit.last.params.betas.any() and not fit.last.params.left_hand_pose.any()
    assert any("shape, expression and hands (components) mean nothing" in note for note in fit.last.notes)


class Gone(OneBody):
    """Has another body than those of runs."""

    def of(self, record: object) -> BodyModel:
        raise InputError("it is gone")


def test_vposers_numbers_take_the_installed_vposer(
    project: Project, tmp_path: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    folder, latent = results(tmp_path / "r", tiny_body), random_latents(FRAMES)
    for t, file in enumerate(sorted(folder.rglob("*.pkl"))):
        content = pickle.loads(file.read_bytes()) | {"body_pose": latent[t : t + 1].numpy()}
        file.write_bytes(pickle.dumps(content, protocol=2))
    with pytest.raises(InputError, match="32 VPoser numbers instead of angles"):
        import_run(project, OneBody(tiny_body), folder)
    write_prior_network(tmp_path / "vposer.npz", random_network(), notes="")
    for name in ("user_file", "registered_vposer"):
        monkeypatch.setattr(importing, name, lambda: tmp_path / "vposer.npz")
    run = import_run(project, OneBody(tiny_body), folder)
    assert project.runs.load(run.id).last.params.body_pose.abs().max() > 0.1


def test_on_the_command_line(tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture):
    folder = tmp_path / "walk.tcfit"
    Project.create(folder, sample_clip()).__exit__(None, None, None)
    good = results(tmp_path / "smplifyx", free_body)
    assert main(["import", str(folder), str(good)]) == 0
    out = capsys.readouterr()
    assert out.out == f"Imported as run 1, SMPLify-X: smplifyx: {FRAMES} frames, neutral smplx body\n"
    (good / "results" / "walk_000001" / "000.pkl").write_bytes(b"\x80\x02}.")
    assert main(["import", str(folder), str(good)]) == 2
    err = capsys.readouterr().err
    assert err.startswith("tcfit: ") and "walk_000001/000.pkl: has no 'global_orient'" in err and "Traceback" not in err
    assert main(["import", str(tmp_path), str(good)]) == 2 and "not a tcfit project" in capsys.readouterr().err
    with Project.open(folder, read_only=True) as project:
        assert [run.kind for run in project.runs.all()] == ["imported"]


def test_a_result_needs_no_keypoints(tmp_path: Path, free_body: BodyModel):
    """It is imported into a clip that has none, and exported again; what measures keypoints has nothing to show."""
    folder, out, clip = tmp_path / "walk.tcfit", tmp_path / "out", sample_clip()
    nobody = Keypoints(xy=np.zeros_like(clip.keypoints.xy), confidence=np.zeros_like(clip.keypoints.confidence))
    Project.create(folder, replace(clip, keypoints=nobody)).close()
    assert main(["import", str(folder), str(results(tmp_path / "smplifyx", free_body))]) == 0
    formats = ["glb", "figures", "summary"]
    assert main(["export", str(folder), "--out", str(out), "--formats", *formats]) == 0
    assert len(list(out.iterdir())) == len(formats)
    with (out / "walk.figures.csv").open(newline="") as file:
        row = next(csv.DictReader(file))
    assert {value for title, value in row.items() if "Reprojection" in title} == {""}


# --- the panel ---


@pytest.fixture
def tested(panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel) -> Iterator[LonePage]:
    with tiny_page(panel_server, tmp_path / "p", tiny_body, FitPanel) as page:
        yield page


def small_results(folder: Path, body: BodyModel) -> Path:
    clip = small_clip(body)
    stems = [f"w_{t:03d}" for t in range(len(clip))]
    params = sample_params(2, len(clip), 12)
    write_smplifyx(folder, params, stems=stems, camera=clip.camera, body=body, frame_rate=clip.frame_rate)
    return folder


def test_a_path_becomes_a_run_that_can_be_shown_as_a(tested: LonePage, tmp_path: Path, tiny_body: BodyModel):
    own = tested.fit()
    session, tab = tested.page.tab.session, tested.page.tab
    tested.press(f"fits.menu {own.id}", "Import a result …")
    tested.field("Path").value = f" {small_results(tmp_path / 'theirs', tiny_body)} "
    tested.click("Import")
    tested.settle()
    assert tested.notices == [] or tested.notices[-1].kind != "error"
    run = session.fits.runs[-1]
    assert run.kind == "imported" and tab.message[0] == "Imported: SMPLify-X: theirs; Compare (2) shows it"
    shown = session.fits.show(FitChoice())
    assert shown is not None and shown.run.id == own.id, "what was imported is not the newest fit"
    tab.set(mode="ab")
    tested.until(lambda: tab.look().a)  # its fit may have to be read again
    imported = tab.look().a
    assert imported is not None and imported.title == "SMPLify-X: theirs" and imported.run.id == run.id
    tested.press("fits.show", str(run.id))
    assert "Use its settings" not in tested.html()
    with pytest.raises(InputError, match="theirs was imported: its frames and shape cannot be refitted"):
        session.rerun_shape(imported, own.config)
    assert session.edit_follower.begin_drag(imported, 0, (4,), np.zeros((1, 2))) is None


def test_an_import_ends_with_its_tab(
    tested: LonePage, tmp_path: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    gate, read, ended = threading.Event(), importing.read_motion, threading.Event()

    def slowly(*args: Any, **named: Any) -> ImportedMotion:
        assert gate.wait(60)
        ended.set()
        return read(*args, **named)

    monkeypatch.setattr(importing, "read_motion", slowly)
    tested.field("Path").value = str(small_results(tmp_path / "theirs", tiny_body))
    tested.click("Import")
    tested.page.close()
    gate.set()
    assert ended.wait(60)
    for thread in [thread for thread in threading.enumerate() if thread.name == "tcfit: Importing a result"]:
        thread.join(60)
    assert tested.page.tab.session.project.runs.all() == []


def test_what_cannot_be_imported_is_told(tested: LonePage, tmp_path: Path):
    tested.field("Path").value = str(tmp_path / "nowhere")
    tested.click("Import")
    tested.settle()
    assert "there is no such file or folder" in tested.notices[-1].text
    tested.field("First frame").value = "-1"
    tested.click("Import")
    tested.settle()
    assert "First frame is '-1'; expected a whole number" in tested.notices[-1].text
    assert tested.page.tab.session.fits.runs == ()


def _upload(tested: LonePage, name: str, content: bytes) -> None:
    handle = tested.field("Upload a file")
    handle._impl.value = viser.UploadedFile(name=name, content=content)
    tested.call_back(handle, MagicMock())
    tested.settle()


def test_an_upload_becomes_a_run_and_its_name_no_path(tested: LonePage, tmp_path: Path, tiny_body: BodyModel):
    folder, file = small_results(tmp_path / "theirs", tiny_body), tmp_path / "r.zip"
    with zipfile.ZipFile(file, "w") as archive:
        for path in folder.rglob("*.*"):
            archive.write(path, path.relative_to(folder))
    before = sorted(tmp_path.rglob("*"))
    _upload(tested, "../../evil\n.zip", file.read_bytes())
    [run] = tested.page.tab.session.fits.runs
    assert run.name == "SMPLify-X: evil?" and run.summary["source"] == "../../evil?.zip"
    made = [path for path in sorted(tmp_path.rglob("*")) if path not in before]
    assert [path.relative_to(tmp_path).parts[:2] for path in made] == [("p", "runs")]


@pytest.mark.parametrize("content", [b"", b"no result", b"PK\x03\x04 cut off", b"\x80\x02}."])
def test_a_broken_upload_is_told_by_its_own_name(tested: LonePage, content: bytes):
    _upload(tested, "theirs.npz", content)
    assert tested.notices[-1].kind == "error"
    assert tested.notices[-1].text.startswith("theirs.npz") and "tcfit-upload" not in tested.notices[-1].text
    assert tested.page.tab.session.fits.runs == ()


def page_a(tested: LonePage) -> Shown:
    shown = tested.page.tab.look().a
    assert shown is not None
    return shown


def test_an_imported_run_is_compared_and_searched_like_any_other(
    panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel
):
    with tiny_page(panel_server, tmp_path / "p", tiny_body, FitPanel) as tested:
        own, session = tested.fit(), tested.page.tab.session
        run = session.import_run(small_results(tmp_path / "theirs", tiny_body), NONE, lambda text, share: None)
        tested.page.tab.set(mode="ab", a=FitChoice(run=run.id), b=FitChoice(run=own.id))
        tested.until(lambda: "Jitter" in tested.html())
        shown = page_a(tested)
        figures = {figure.name: figure.value for figure in tested.page.tab.data.metrics(shown) or ()}
        assert figures["seconds"] is None and "theirs" in tested.html()
        assert "Something went wrong" not in str(tested.notices)
        tested.until(lambda: tested.page.tab.data.queue(shown) is not None)


# --- learned systems ---


class AnyKind(OneBody):
    """Has a body of every kind."""

    def check(self, *, kind: str, gender: str) -> None:
        pass


def smpl(body: BodyModel) -> Any:
    """Bodies whose SMPL is this one."""
    return AnyKind(replace(body, kind="smpl"))


def test_whams_camera_is_of_the_clips_size(project: Project, tmp_path: Path, tiny_body: BodyModel):
    params = truth(frames=FRAMES)
    path = written(tmp_path / "wham_output.pkl", joblib_bytes(wham({3: (params, np.arange(FRAMES))})))
    run = import_run(project, smpl(tiny_body), path)
    fit = project.runs.load(run.id)
    width, height = CAMERA.size
    assert fit.camera.focal == (np.hypot(width, height),) * 2 and fit.camera.size == CAMERA.size
    assert fit.camera.source == "WHAM's, the image's diagonal"
    assert run.summary["format"] == "WHAM result"
    assert np.abs(joints_in_space(tiny_body, fit.last.params) - joints_in_space(tiny_body, params)).max() < 1e-3


def test_the_person_is_chosen(project: Project, tmp_path: Path, tiny_body: BodyModel):
    frames, params = np.arange(FRAMES), [truth(seed, FRAMES) for seed in (1, 2)]
    people = {4: (params[0], frames), 9: (params[1], frames)}
    path = written(tmp_path / "wham_output.pkl", joblib_bytes(wham(people)))
    for choices, expected in ((ImportChoices(), params[0]), (ImportChoices(person=9), params[1])):
        fit = project.runs.load(import_run(project, smpl(tiny_body), path, choices).id)
        assert torch.allclose(fit.last.params.body_pose, expected.body_pose, atol=1e-5)
    assert fit.last.notes[1] == f"It has 2 people: 4 ({FRAMES} frames), 9 ({FRAMES} frames). Number 9 was taken."


def test_a_person_who_is_not_in_the_whole_clip_is_refused(project: Project, tmp_path: Path, tiny_body: BodyModel):
    path = written(tmp_path / "w.pkl", joblib_bytes(wham({0: (truth(frames=2), np.array([1, 2]))})))
    with pytest.raises(InputError, match="has 2 frames, for the video's frames"):
        import_run(project, smpl(tiny_body), path)


@pytest.mark.parametrize(
    "data",
    [
        torch_bytes(gvhmr(truth())),
        torch_bytes(gvhmr(truth()), _use_new_zipfile_serialization=False),
        joblib_bytes(wham({0: (truth(), np.arange(5))})),
        zlib.compress(joblib_bytes(wham({0: (truth(), np.arange(5))}))),
    ],
    ids=["torch", "torch before 1.6", "joblib", "packed"],
)
def test_uploads(data: bytes):
    with upload("../a result\n.bin", data) as path:
        assert torch.allclose(read_motion(path).params.body_pose, truth().body_pose, atol=1e-5)
