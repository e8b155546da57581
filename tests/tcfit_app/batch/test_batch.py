"""Many clips: what each one gives, what is done again and what is not, and what is said about it."""

import csv
import json
import multiprocessing
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.files.npz import write_npz
from fitting_core.io.result_files import read_fit
from tcfit_app.cli.ending import INPUT_ERROR
from tcfit_app.cli.main import main, parse
from tcfit_app.fitting import process_queue
from tcfit_app.home.catalogue import Catalogue
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tests.drivers.processes import needs_fork
from tests.samples.batch_clips import CHEAP, events, write_batch, write_clip, write_list

pytestmark = needs_fork
SETTINGS = list(CHEAP)


@pytest.fixture(autouse=True)
def forks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that need not import torch again; how they are really started is tested in test_batch_crash.py."""
    monkeypatch.setattr(process_queue, "CONTEXT", multiprocessing.get_context("fork"))


def batch(folder: Path, *options: str) -> int:
    return main(["batch", str(folder / "clips.csv"), *SETTINGS, "--jobs", "1", *options])


def rows(folder: Path) -> dict[str, dict[str, Any]]:
    content = json.loads((folder / "clips.batch" / "summary.json").read_text())
    with (folder / "clips.batch" / "summary.csv").open(newline="") as file:
        assert [row["clip"] for row in csv.DictReader(file)] == [row["clip"] for row in content["rows"]]
    return {row["clip"]: row for row in content["rows"]}


def states(folder: Path) -> list[str]:
    return [row["state"] for row in rows(folder).values()]


def fits(folder: Path) -> int:
    """How many clips were fitted so far, in all runs."""
    return len(list(events(folder, "fitted")))


def test_a_clip_gives_what_a_fit_gives(tmp_path: Path, free_body: BodyModel, capsys):
    write_batch(tmp_path, free_body, clips=2)
    assert batch(tmp_path) == 0
    alone = tmp_path / "alone"
    assert main(["fit", "--keypoints", str(tmp_path / "keypoints" / "c001"), "--out", str(alone), *SETTINGS]) == 0
    one, other = read_fit(alone), read_fit(tmp_path / "fits" / "c001")
    for name, values in vars(one.params).items():
        assert (values == getattr(other.params, name)).all(), name
    assert {f.name for f in alone.iterdir()} == {f.name for f in (tmp_path / "fits/c001").iterdir()}
    row = rows(tmp_path)["fits/c001"]
    assert row["state"] == "done" and row["frames"] == 3 and 0 < row["body_p95_px"] < 15 and row["seconds"] > 0
    output = capsys.readouterr().out
    assert "[1/2] done   fits/c000" in output and "fitted now" in output and "clips.batch/summary.csv" in output


def test_what_is_done_is_left_until_its_files_or_settings_change(tmp_path: Path, free_body: BodyModel):
    write_batch(tmp_path, free_body, clips=3)
    assert batch(tmp_path) == 0 and fits(tmp_path) == 3
    before = (tmp_path / "fits/c000/fit.npz").stat().st_mtime_ns
    assert batch(tmp_path) == 0 and fits(tmp_path) == 3 and states(tmp_path) == ["done before"] * 3
    assert batch(tmp_path, "--device", "cpu") == 0 and fits(tmp_path) == 3
    write_clip(tmp_path / "keypoints/c001", free_body, seed=77)
    shutil.rmtree(tmp_path / "fits/c002")
    assert batch(tmp_path) == 0 and states(tmp_path) == ["done before", "done", "done"]
    assert (tmp_path / "fits/c000/fit.npz").stat().st_mtime_ns == before
    shutil.rmtree(tmp_path / "keypoints/c000")  # of a clip that is done the input is not needed any more
    assert batch(tmp_path) == 0 and fits(tmp_path) == 5
    assert batch(tmp_path, "--set", "shape_sample.seed=7") == INPUT_ERROR  # but now it is
    write_clip(tmp_path / "keypoints/c000", free_body)
    assert (
        batch(tmp_path, "--set", "shape_sample.seed=7") == 0
        and states(tmp_path) == ["done"] * 3
        and fits(tmp_path) == 8
    )


def test_a_failure_is_kept_and_tried_again_only_when_asked_or_mended(tmp_path: Path, free_body: BodyModel, capsys):
    write_batch(tmp_path, free_body, clips=3, broken=1)
    assert batch(tmp_path) == 1 and states(tmp_path) == ["done", "failed", "done"]
    assert "is not readable as JSON" in rows(tmp_path)["fits/c001"]["reason"] and not (tmp_path / "fits/c001").exists()
    (note,) = (tmp_path / "clips.batch/failed").iterdir()
    assert "is not readable" in json.loads(note.read_text())["reason"]
    assert batch(tmp_path) == 1 and states(tmp_path) == ["done before", "failed before", "done before"]
    assert len(list(events(tmp_path, "started"))) == 3
    assert batch(tmp_path, "--retry") == 1 and states(tmp_path)[1] == "failed"
    assert "is not readable" in capsys.readouterr().out
    write_clip(tmp_path / "keypoints/c001", free_body)
    assert batch(tmp_path) == 0 and states(tmp_path) == ["done before", "done", "done before"] and not note.exists()


def test_other_files_among_the_results_stay(tmp_path: Path, free_body: BodyModel, capsys):
    write_batch(tmp_path, free_body, clips=1)
    out = tmp_path / "fits/c000"
    out.mkdir(parents=True)
    (out / "thesis.tex").write_text("mine")
    assert batch(tmp_path) == INPUT_ERROR
    assert "line 2, column out" in (error := capsys.readouterr().err) and "thesis.tex" in error
    assert batch(tmp_path, "--overwrite") == 0
    (out / "overlay.mp4").write_text("of the fit that is to be replaced")
    assert batch(tmp_path, "--set", "shape_sample.seed=3") == 0 and fits(tmp_path) == 2
    assert {f.name for f in out.iterdir()} == {"fit.npz", "summary.json", "thesis.tex"}


def test_nothing_is_started_if_a_file_is_missing(tmp_path: Path, free_body: BodyModel, capsys):
    write_batch(tmp_path, free_body, clips=1)
    rows = [{"keypoints": f"keypoints/{name}", "out": f"fits/{name}", "gender": ""} for name in ("c000", "x", "y")]
    write_list(tmp_path, rows)
    assert batch(tmp_path) == INPUT_ERROR
    error = capsys.readouterr().err
    assert "has 2 errors" in error and "line 3, column keypoints: " in error and "keypoints/y does not exist" in error
    assert not (tmp_path / "fits").exists() and not (tmp_path / "clips.batch").exists()
    assert batch(tmp_path, "--jobs", "0") == INPUT_ERROR and batch(tmp_path, "--device", "cuda:9") == INPUT_ERROR


def test_clips_differ_in_what_the_list_says(tmp_path: Path, free_body: BodyModel):
    write_clip(tmp_path / "k", free_body, frames=4)
    rows = [{"keypoints": "k", "out": "a"}, {"keypoints": "k", "out": "b", "first_frame": "2", "focal_length": "500"}]
    write_list(tmp_path, rows)
    assert batch(tmp_path) == 0
    a, b = read_fit(tmp_path / "a"), read_fit(tmp_path / "b")
    assert (len(a.joints), len(b.joints), b.first_frame) == (4, 2, 2)
    assert (a.camera.focal, b.camera.focal) == ((800.0, 800.0), (500.0, 500.0))


def test_a_clip_is_fitted_again_when_its_camera_file_changes(tmp_path: Path, free_body: BodyModel):
    write_clip(tmp_path / "k", free_body, frames=2)
    camera = {"K": np.array([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]]), "size": np.array([640, 480])}
    write_npz(tmp_path / "camera.npz", camera)
    write_list(tmp_path, [{"keypoints": "k", "out": "a", "camera": "camera.npz"}])
    assert batch(tmp_path) == 0 and read_fit(tmp_path / "a").camera.focal == (800.0, 800.0)
    before = read_fit(tmp_path / "a")
    assert batch(tmp_path) == 0 and fits(tmp_path) == 1
    write_npz(tmp_path / "camera.npz", camera | {"dist": np.array([-0.1, 0, 0, 0])})
    assert batch(tmp_path) == 0
    after = read_fit(tmp_path / "a").camera.lens
    assert before.camera.lens is None and after is not None and after.distortion == (-0.1, 0, 0, 0)
    (tmp_path / "camera.npz").unlink()
    write_list(tmp_path, [{"keypoints": "k", "out": "b", "camera": "camera.npz"}])
    assert batch(tmp_path) == INPUT_ERROR and not (tmp_path / "b").exists()


def test_a_clip_begins_with_its_own_start_and_is_fitted_again_when_that_changes(tmp_path: Path, free_body: BodyModel):
    write_clip(tmp_path / "k", free_body)
    write_list(tmp_path, [{"keypoints": "k", "out": "first"}])
    assert batch(tmp_path) == 0
    shutil.copyfile(tmp_path / "first" / "fit.npz", tmp_path / "start.npz")
    write_list(tmp_path, [{"keypoints": "k", "out": "a", "start": "start.npz"}, {"keypoints": "k", "out": "b"}])
    assert batch(tmp_path) == 0
    a, b = (json.loads((tmp_path / name / "summary.json").read_text())["start"] for name in "ab")
    assert a["source"] == "start.npz" and a["frames"] == 3 and b is None
    done = fits(tmp_path)
    assert batch(tmp_path) == 0 and fits(tmp_path) == done
    shutil.copyfile(tmp_path / "a" / "fit.npz", tmp_path / "start.npz")
    assert batch(tmp_path) == 0 and fits(tmp_path) == done + 1
    (tmp_path / "start.npz").unlink()
    write_list(tmp_path, [{"keypoints": "k", "out": "c", "start": "start.npz"}])
    assert batch(tmp_path) == INPUT_ERROR and not (tmp_path / "c").exists()


def test_projects_get_another_run_and_lose_nothing(tmp_path: Path, free_body: BodyModel):
    write_batch(tmp_path, free_body, clips=1)
    assert batch(tmp_path, "--projects") == 0
    with Project.open(tmp_path / "fits/c000") as project:
        (run,) = project.runs.all()
        assert run.state == "finished" and project.runs.load(run.id).last.phase == 1 and run.summary["frames"] == 3
        project.append(MarkBad(frames=(0,), joints=(4,)))
    assert batch(tmp_path, "--projects") == 0 and states(tmp_path) == ["done before"]
    assert batch(tmp_path, "--projects", "--set", "shape_sample.seed=9") == 0 and states(tmp_path) == ["done"]
    with Project.open(tmp_path / "fits/c000") as project:
        assert [(run.state, run.edits_seen) for run in project.runs.all()] == [("finished", 0), ("finished", 1)]
        assert len(project.log) == 1
    write_clip(tmp_path / "keypoints/c000", free_body, seed=5)
    assert batch(tmp_path, "--projects") == 1
    assert "already a project, with other keypoints" in rows(tmp_path)["fits/c000"]["reason"]


def test_an_unforeseen_error_is_a_failure_with_its_place(tmp_path: Path, free_body: BodyModel, monkeypatch):
    write_batch(tmp_path, free_body, clips=2)

    def failing(*args: object, **kwargs: object) -> None:
        raise ZeroDivisionError("by chance")

    monkeypatch.setattr("tcfit_app.batch.clip_fit.write_result", failing)
    assert batch(tmp_path) == 1
    assert rows(tmp_path)["fits/c000"]["reason"] == "ZeroDivisionError: by chance"
    note = sorted((tmp_path / "clips.batch/failed").iterdir())[0]
    assert "in failing" in json.loads(note.read_text())["trace"]


def test_a_plugin_that_interrupts_fails_its_clip(tmp_path: Path, free_body: BodyModel, monkeypatch, capfd):
    write_batch(tmp_path, free_body, clips=1)

    def interrupting(*args: object, **kwargs: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("tcfit_app.batch.clip_fit.write_result", interrupting)
    assert batch(tmp_path) == 1
    assert "A plugin interrupted the fit" in rows(tmp_path)["fits/c000"]["reason"]
    assert "Traceback" not in capfd.readouterr().err


def test_the_options_of_ray():
    assert parse(["batch", "c.csv"]).ray is None
    assert parse(["batch", "c.csv", "--ray"]).ray == () and parse(["batch", "c.csv", "--ray", "local"]).ray == (
        "local",
    )


@pytest.mark.parametrize("address", [[], ["127.0.0.1:1"], ["ray://127.0.0.1:1"]])
def test_a_cluster_that_does_not_answer_is_reported(tmp_path: Path, free_body: BodyModel, capsys, address: list[str]):
    pytest.importorskip("ray", reason="Ray is not installed (pip install tcfit[ray])")
    write_batch(tmp_path, free_body, clips=1)
    assert main(["batch", str(tmp_path / "clips.csv"), *SETTINGS, "--ray", *address]) == INPUT_ERROR
    assert "no cluster answers" in capsys.readouterr().err


def test_report_option_prints_states_and_fits_nothing(
    tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture[str]
):
    command = ["batch", str(write_batch(tmp_path, free_body, clips=3, broken=1)), *CHEAP, "--jobs", "1"]
    assert main([*command, "--report"]) == 0 and states(tmp_path) == ["left"] * 3
    assert main(command) == 1 and fits(tmp_path) == 2
    capsys.readouterr()
    assert main([*command, "--report", "--retry"]) == 1 and fits(tmp_path) == 2
    assert sorted(states(tmp_path)) == ["done before", "done before", "failed before"]
    assert f"tcfit review {tmp_path / 'fits'}" in capsys.readouterr().out


def test_batch_results_are_in_the_list_of_clips(tmp_path: Path, free_body: BodyModel):
    command = ["batch", str(write_batch(tmp_path, free_body, clips=2)), *CHEAP, "--jobs", "1"]
    assert main(command) == 0
    rows, _ = Catalogue(tmp_path).refresh()
    assert [(row.place, row.kind, row.state) for row in rows] == [
        ("fits/c000", "result", "fitted"),
        ("fits/c001", "result", "fitted"),
    ]
    assert all(row.off and row.frames > 0 for row in rows)
