"""`tcfit evaluate` on results and projects: tables, files, and what is said about wrong options."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluation.synthetic.truth import write_truth
from fitting_core import keypoints as kp
from fitting_core.body.markers.joint_centres import joint_centres_in_space
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.io.result_files import write_result
from fitting_core.io.truth import Truth
from fitting_core.keypoints import Keypoints
from fitting_core.measure.references.bodies import reference_of
from fitting_core.results.fit_result import FitResult, PhaseResult
from tcfit_app.cli.main import main
from tcfit_app.evaluation.evaluated_fits import evaluated_fit
from tcfit_app.evaluation.evaluating import notes_about
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import BodyRecord
from tests.fitting_core.measure import test_clocks as laboratory
from tests.tcfit_app.conftest import CAMERA, FRAMES, FinishedRun, motion


@pytest.fixture
def truth(tmp_path: Path, free_body: BodyModel) -> Path:
    params = motion()
    path = tmp_path / "truth.npz"
    write_truth(
        path,
        Truth(
            params=params,
            joints=joints_in_space(free_body, params),
            keypoints=np.zeros((FRAMES, 137, 2)),
            visible=np.ones((FRAMES, 137), bool),
            exists=np.ones(137, bool),
            camera=CAMERA,
            frame_rate=30.0,
            body_hash=free_body.hash,
        ),
    )
    return path


def records_in(folder: Path) -> list[dict[str, str]]:
    with (folder / "metrics.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.thorough
def test_a_result_against_its_truth(finished: FinishedRun, truth: Path, tmp_path: Path, capsys: pytest.CaptureFixture):
    out = tmp_path / "report"
    arguments = ["evaluate", str(finished.folder), "--reference", str(truth), "--out", str(out)]
    assert main([*arguments, "--every", "3"]) == 0
    told = capsys.readouterr().out
    assert "PA-MPJPE, mm" in told and "phase 1" in told and "Wrote" in told
    first, final = records_in(out)
    assert (first["method"], final["method"]) == ("phase 1", "final")
    assert 0 < float(final["pa_mpjpe_mean [mm]"]) < 300 and 0 < float(final["vertex_to_surface_mean [cm]"]) < 30
    content = json.loads((out / "metrics.json").read_bytes())
    assert content["format"] == "tcfit evaluation 1" and len(content["records"]) == 2
    assert len(content["records"][0]["comparison"]["curves"]["vertex_to_surface"]) == FRAMES


def project_with_fit(folder: Path, body: BodyModel, *, reference: bool, first_frame: int = 0) -> Path:
    """Two runs, of which the first is the truth itself; the second stands 10 cm farther away."""
    params = motion()
    points, exists = keypoints_in_space(body, params)
    seen = np.tile(0.9 * exists, (FRAMES, 1))
    xy = points[..., :2] / np.where(exists[:, None], points[..., 2:], 1) * CAMERA.focal + CAMERA.center
    found = Keypoints(xy=xy, confidence=seen)
    clip = Clip(keypoints=found, camera=CAMERA, frame_rate=25.0, name="walk & turn", first_frame=first_frame)
    with Project.create(folder, clip) as project:
        if reference:
            made = reference_of("truth", "made here", body, params, frame_rate=25.0, in_camera=True)
            project.set_reference(made)
        record = BodyRecord(kind=body.kind, gender=body.gender, hash=body.hash, source=str(body.source or ""))
        for name, away in (("exact", 0.0), ("far", 0.1)):
            shift = params.camera_translation + params.camera_translation.new_tensor([0, 0, away])
            run = project.runs.start(FitConfig(), body=record, edits_seen=0, name=name)
            project.runs.finish(run.id, fit_result(replace(params, camera_translation=shift)))
    return folder


def fit_result(params) -> FitResult:
    phases = tuple(
        PhaseResult(phase=n, params=params, objective={"total": 1.0}, frame_cost=np.ones(len(params)), seconds=1.0)
        for n in (1, 3)
    )
    return FitResult(phases=phases, camera=CAMERA, config=FitConfig(), observed=np.ones((len(params), 55), bool))


def test_a_project_has_its_own_reference(tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture):
    project = project_with_fit(tmp_path / "x.tcfit", free_body, reference=True)
    for run, error in (("exact", 0.0), ("2", 100.0)):
        out = tmp_path / run
        arguments = ["evaluate", str(project), "--run", run, "--out", str(out), "--every", "6"]
        assert main(arguments) == 0
        final = records_in(out)[-1]
        assert float(final["joint_error_mean [mm]"]) == pytest.approx(error, abs=1e-3)
        assert float(final["reprojection_mean [px]"]) == pytest.approx(0, abs=0.5 + 0.1 * error)
    assert main(["evaluate", str(project), "--run", "none"]) == 2
    assert "no such run. Runs with a result: 'exact' (#1), 'far' (#2)" in capsys.readouterr().err


def test_which_run_is_measured_is_the_same_as_anywhere_else(
    tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture
):
    """What was imported last is not what is measured where nobody chose, and a name that two runs have is refused."""
    folder = project_with_fit(tmp_path / "x.tcfit", free_body, reference=False)
    with Project.open(folder) as project:
        far = project.runs.get(2)
        run = project.runs.start(FitConfig(), body=far.body, edits_seen=0, name="theirs", kind="imported")
        project.runs.finish(run.id, project.runs.load(2))
    assert evaluated_fit(folder).name.endswith(", far")
    assert evaluated_fit(folder, run="#3").name.endswith(", theirs")
    with Project.open(folder) as project:
        project.runs.rename(3, "far")
    assert main(["evaluate", str(folder), "--run", "far"]) == 2
    assert "several runs have this name; give a number" in capsys.readouterr().err


def test_a_reference_at_an_odd_rate_is_told_to_leave_accelerations_out(free_body: BodyModel):
    reference = reference_of("truth", "made here", free_body, motion(), frame_rate=30.0, in_camera=True)
    assert any("accelerations" in note for note in notes_about(reference, 60.0))
    assert not notes_about(reference, 15.0)


def test_without_a_reference_only_smoothness_is_told(
    tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture
):
    project = project_with_fit(tmp_path / "x.tcfit", free_body, reference=False)
    assert main(["evaluate", str(project), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr()
    assert "There is no reference" in told.err and "Jitter" in told.out and "MPJPE" not in told.out


def test_a_reference_of_a_part_is_told_to_be_one(tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture):
    """Cut to the fit's later half, it is refused where it does not say so, and else compared there, with a note."""
    project = project_with_fit(tmp_path / "x.tcfit", free_body, reference=False, first_frame=FRAMES // 2)
    points, exists = keypoints_in_space(free_body, motion())
    points[:, ~exists] = np.nan
    part, names = FRAMES - FRAMES // 2, np.array(kp.NAMES)[kp.LIMBS]
    for name, frames in (("whole", FRAMES), ("late", part)):
        np.savez(tmp_path / f"{name}.npz", points=points[-frames:, kp.LIMBS], names=names)
    arguments = ["evaluate", str(project), "--run", "exact", "--out", str(tmp_path / "out")]
    assert main([*arguments, "--reference", str(tmp_path / "whole.npz")]) == 2
    assert f"Say it with --reference-first-frame {FRAMES // 2}" in capsys.readouterr().err
    for name, first, compared in (("whole", FRAMES // 2, FRAMES), ("late", FRAMES, part)):
        given = ["--reference", str(tmp_path / f"{name}.npz"), "--reference-first-frame", str(first)]
        assert main([*arguments, *given]) == 0
        final = records_in(tmp_path / "out")[-1]
        assert float(final["pa_mpjpe_mean [mm]"]) == pytest.approx(0, abs=1e-3)
        assert (final["frames"], final["compared_frames"]) == (str(FRAMES), str(compared))
        said = f"Compared in {part} of {FRAMES} frames: the fit has the video's frames {FRAMES // 2} to "
        said += f"{FRAMES // 2 + FRAMES - 1}, of which the reference covers {FRAMES} to {FRAMES // 2 + FRAMES - 1}"
        assert (said in capsys.readouterr().err) == (compared < FRAMES)
    assert main([*arguments, "--reference-first-frame", "3"]) == 2
    assert "has no reference: give --reference too" in capsys.readouterr().err


def acted(folder: Path, body: BodyModel, seconds: np.ndarray) -> Path:
    """A result whose only phase is the truth of what laboratories measure in test_clocks.py."""
    params = laboratory.acted(seconds)
    nothing = Keypoints(xy=np.zeros((len(seconds), kp.COUNT, 2)), confidence=np.zeros((len(seconds), kp.COUNT)))
    clip = Clip(keypoints=nothing, camera=CAMERA, frame_rate=laboratory.RATE, name="acted")
    fit = fit_result(params)
    write_result(folder / "acted", replace(fit, phases=fit.phases[:1]), clip, body)
    return folder / "acted"


@pytest.mark.thorough
def test_a_laboratory_whose_clock_is_another(tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture):
    """A fit that is the truth, beside markers at another rate that begin 0.37 s before the video."""
    seconds = np.arange(0, laboratory.SECONDS, 1 / laboratory.RATE)
    result = acted(tmp_path, free_body, seconds)
    seen = laboratory.measured(free_body, "markers", gaps=True, noise=0.001)
    path = laboratory.written(tmp_path, "c3d", *seen)
    np.savez(tmp_path / "camera.npz", R=laboratory.TURN, t=laboratory.SHIFT)
    arguments = ["evaluate", str(result), "--out", str(tmp_path / "out")]
    arguments += ["--reference", str(path), "--camera", str(tmp_path / "camera.npz")]
    figures = []
    for offset in ("auto", "-0.37", "0"):
        assert main([*arguments, "--reference-offset", offset]) == 0
        (record,) = records_in(tmp_path / "out")
        figures.append(float(record["joint_error_mean [mm]"]))
        assert ("The reference's clock was set by the movement: its first frame lies at -0.37" in _told(capsys)) == (
            offset == "auto"
        )
    assert figures[0] < 3.5 and figures[1] < 2.5 and figures[2] > 50
    assert record["compared_frames"] == str(len(seconds))
    assert main(arguments) == 0
    assert "120 frames per second and the fit 30" not in _told(capsys)


def _told(capsys: pytest.CaptureFixture) -> str:
    return capsys.readouterr().err


def test_other_systems_are_judged_beside_the_fit(tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture):
    """In a laboratory's world, at another rate: each by its form, in the same frames, and in no record of its own."""
    seconds = np.arange(0, 2, 1 / laboratory.RATE)
    result = acted(tmp_path, free_body, seconds)
    moments = np.arange(0, 1.5, 1 / 50)
    points = joint_centres_in_space(free_body, laboratory.acted(moments)) @ laboratory.TURN.T + laboratory.SHIFT
    noisy = points + np.random.default_rng(0).normal(0, 0.02, points.shape)
    names = np.array([kp.NAMES[i] for i in kp.LIMBS])
    np.savez(tmp_path / "points.npz", points=points, names=names, time=moments, wham=noisy)
    arguments = ["evaluate", str(result), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--reference", str(tmp_path / "points.npz")]) == 0
    told = capsys.readouterr().out
    assert "wham" in told and "Knee flexion by joint centres, RMS error, °" in told
    other, own = records_in(tmp_path / "out")
    assert other["method"] == "wham" and other["compared_frames"] == own["compared_frames"]
    for figure, least in (("pa_mpjpe_mean [mm]", 15), ("turned_mpjpe [mm]", 20), ("elbow_flexion [°]", 2)):
        assert float(own[figure]) < 0.5 and least < float(other[figure]) < 60


def test_a_user_s_markers_say_what_points_are(tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture):
    seconds = np.arange(0, 2, 1 / laboratory.RATE)
    result = acted(tmp_path, free_body, seconds)
    names, places = laboratory.places_of(free_body, np.arange(0, 2, 1 / laboratory.OWN_RATE), "markers")
    path = laboratory.written(tmp_path, "trc", tuple(f"P{i}" for i in range(len(names))), places)
    lines = [f'P{i} = "{name}"' for i, name in enumerate(names)]
    (tmp_path / "own.toml").write_text("\n".join(["[markers]", *lines]))
    arguments = ["evaluate", str(result), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--reference", str(path)]) == 2
    assert "say with --markers what they are" in _told(capsys)
    assert main([*arguments, "--reference", str(path), "--markers", str(tmp_path / "own.toml")]) == 0
    (record,) = records_in(tmp_path / "out")
    assert float(record["pa_mpjpe_mean [mm]"]) < 0.1


WRONG = {
    "offset in words": (["x", "--reference", "r.c3d", "--reference-offset", "soon"], "expected seconds, such as -0.37"),
    "offset NaN": (["x", "--reference", "r.c3d", "--reference-offset", "nan"], "is not a time"),
    "offset twice": (["x", "--reference-offset", "1", "--reference-first-frame", "3"], "not both"),
    "markers": (["x", "--markers", "m.toml"], "give --reference too"),
    "nothing": ([], "FIT"),
    "camera": (["x", "--camera", "c.npz"], "give --reference too"),
    "every": (["x", "--every", "0"], "expected 1 or more"),
    "no fit": (["nowhere"], "expected a project or a result"),
    "another program's": ([__file__], "Import another program's result into a project (tcfit import PROJECT"),
    "person": (["x", "--person", "2"], "was removed. Import the result into a project"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_options(kind: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.chdir(tmp_path)
    arguments, said = WRONG[kind]
    assert main(["evaluate", *arguments]) == 2
    assert said in capsys.readouterr().err and not list(tmp_path.iterdir())
