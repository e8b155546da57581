"""Clips of one person: one shape for all of them, and what is done again when something changes."""

import json
import multiprocessing
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.io.result_files import read_fit
from tcfit_app.batch import rounds
from tcfit_app.cli.ending import INPUT_ERROR
from tcfit_app.cli.main import main
from tcfit_app.fitting import process_queue
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tests.drivers.processes import needs_fork
from tests.samples.batch_clips import CHEAP, events, write_clip, write_list

pytestmark = [needs_fork, pytest.mark.thorough]
ANNA = ("a0", "a1", "a2")


@pytest.fixture(autouse=True)
def forks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_queue, "CONTEXT", multiprocessing.get_context("fork"))


def batch(folder: Path, *options: str) -> int:
    return main(["batch", str(folder / "clips.csv"), *CHEAP, "--jobs", "1", *options])


def write(folder: Path, clips: dict[str, str], **more: str) -> None:
    """A list of clips with the subject of each; all phases."""
    rows = [{"keypoints": f"k/{name}", "out": name, "subject": who} for name, who in clips.items()]
    write_list(folder, [row | {"last_phase": "3"} | more for row in rows])


def made(folder: Path, body: BodyModel, clips: dict[str, str]) -> None:
    for seed, name in enumerate(clips):
        write_clip(folder / "k" / name, body, seed=seed)
    write(folder, clips)


def betas(folder: Path, name: str) -> np.ndarray:
    return read_fit(folder / name).params.betas[0].numpy()


def new(folder: Path, kind: str = "fitted") -> Iterator[list[str]]:
    """What has been done since the last time."""
    seen = 0
    while True:
        found = list(events(folder, kind))
        yield sorted(found[seen:])
        seen = len(found)


def states(folder: Path) -> dict[str, str]:
    rows = json.loads((folder / "clips.batch" / "summary.json").read_text())["rows"]
    return {row["clip"]: row["state"] for row in rows}


def seconds(folder: Path, name: str) -> float:
    rows = json.loads((folder / "clips.batch" / "summary.json").read_text())["rows"]
    return next(row["seconds"] for row in rows if row["clip"] == name)


def test_clips_of_a_subject_share_a_shape_and_only_what_changed_is_done_again(
    tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture[str]
):
    clips = dict.fromkeys(ANNA, "anna") | {"b": "", "c": "carl"}
    made(tmp_path, free_body, clips)
    done = new(tmp_path)
    assert batch(tmp_path) == 0
    first = sorted([f"{name} (first phase)" for name in (*ANNA, "c")])
    shapes = ["anna (shape from 3 clips)", "carl (shape from 1 clip)"]
    assert next(done) == sorted([*first, *shapes, *clips])
    assert all((betas(tmp_path, name) == betas(tmp_path, "a0")).all() for name in ANNA)
    assert len({tuple(betas(tmp_path, name)) for name in clips}) == 3
    assert main(["fit", "--keypoints", str(tmp_path / "k/c"), "--out", str(tmp_path / "alone"), *alone(CHEAP)]) == 0
    assert np.allclose(betas(tmp_path, "alone"), betas(tmp_path, "c"))  # one clip's shape is what a fit finds
    assert seconds(tmp_path, "c") > json.loads((tmp_path / "c" / "summary.json").read_text())["batch"]["seconds"] + 0.01
    capsys.readouterr()
    assert batch(tmp_path) == 0 and next(done) == []
    assert set(states(tmp_path).values()) == {"done before"} and "anna:" not in capsys.readouterr().out

    write_clip(tmp_path / "k" / "a1", free_body, seed=50)
    before = betas(tmp_path, "a0")
    assert batch(tmp_path) == 0
    assert next(done) == sorted(["a1 (first phase)", shapes[0], *ANNA])
    assert "anna: the clips have changed" in capsys.readouterr().out
    assert (betas(tmp_path, "a0") != before).any() and states(tmp_path)["c"] == "done before"

    write(tmp_path, {"a0": "anna", "a2": "anna", "a1": "", "b": "", "c": "carl"})  # a1 shows somebody else
    assert batch(tmp_path) == 0
    assert next(done) == sorted(["a1", "a0", "a2", "anna (shape from 2 clips)"])
    assert batch(tmp_path, "--temporal-weight", "50") == 0  # nothing of first phases or shapes changes
    assert next(done) == sorted(["a0", "a1", "a2", "b", "c"]), "a shape was found again that cannot have changed"
    assert "Shapes of subjects: 2 of 2 were done, or failed, in an earlier run." in capsys.readouterr().out


def alone(options: Sequence[str]) -> list[str]:
    return [option.replace("last_phase=1", "last_phase=3") for option in options]


def test_a_clip_that_fails_does_not_spoil_its_subject(tmp_path: Path, free_body: BodyModel):
    made(tmp_path, free_body, dict.fromkeys(ANNA, "anna"))
    file = sorted((tmp_path / "k" / "a1").iterdir())[0]
    whole = file.read_text()
    file.write_text(whole[:80])
    assert batch(tmp_path) == 1
    assert states(tmp_path) == {"a0": "done", "a1": "failed", "a2": "done"} and not (tmp_path / "a1").exists()
    assert (betas(tmp_path, "a0") == betas(tmp_path, "a2")).all()
    assert batch(tmp_path, "--retry") == 1
    assert states(tmp_path) == {"a0": "done before", "a1": "failed", "a2": "done before"}
    file.write_text(whole)
    done = new(tmp_path)
    next(done)
    assert batch(tmp_path) == 0 and set(states(tmp_path).values()) == {"done"}
    assert next(done) == sorted([*ANNA, "a1 (first phase)", "anna (shape from 3 clips)"])


def test_where_the_files_of_a_clip_have_gone_its_result_stays(tmp_path: Path, free_body: BodyModel):
    made(tmp_path, free_body, dict.fromkeys(ANNA, "anna"))
    assert batch(tmp_path) == 0
    shutil.rmtree(tmp_path / "k" / "a0")
    assert batch(tmp_path) == 0 and set(states(tmp_path).values()) == {"done before"}
    write_clip(tmp_path / "k" / "a1", free_body, seed=50)
    assert batch(tmp_path) == 1  # it cannot get the new shape
    assert states(tmp_path) == {"a0": "failed", "a1": "done", "a2": "done"} and (tmp_path / "a0/fit.npz").exists()


def test_clips_after_the_first_forty_take_the_shape_and_change_nothing(
    tmp_path: Path, free_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(rounds, "MOST_CLIPS", 2)
    made(tmp_path, free_body, dict.fromkeys(ANNA, "anna"))
    write(tmp_path, dict.fromkeys(ANNA[:2], "anna"))
    assert batch(tmp_path) == 0
    done = new(tmp_path)
    next(done)
    write(tmp_path, dict.fromkeys(ANNA, "anna"))
    assert batch(tmp_path) == 0 and next(done) == ["a2", "a2 (first phase)"]
    assert (betas(tmp_path, "a2") == betas(tmp_path, "a0")).all()


def test_projects_of_a_subject_keep_the_shape_with_their_corrections(tmp_path: Path, free_body: BodyModel):
    made(tmp_path, free_body, dict.fromkeys(ANNA[:2], "anna"))
    assert batch(tmp_path, "--projects") == 0
    with Project.open(tmp_path / "a0") as project:
        project.append(MarkBad(frames=(0,), joints=(4,)))
    assert batch(tmp_path, "--projects", "--temporal-weight", "50") == 0
    shapes = []
    for name in ANNA[:2]:
        with Project.open(tmp_path / name) as project:
            runs = [project.runs.load(run.id) for run in project.runs.all()]
            assert [run.last.phase for run in runs] == [3, 3]
            shapes += [run.last.params.betas[0].numpy() for run in runs]
    assert all((shape == shapes[0]).all() for shape in shapes)


def test_a_known_shape_is_kept(tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture[str]):
    made(tmp_path, free_body, {"a": "", "b": ""})
    known = [0.5, -0.25, *[0.0] * 8]
    (tmp_path / "anna.json").write_text(json.dumps({"betas": known}))
    write(tmp_path, {"a": "", "b": ""}, shape="anna.json")
    assert batch(tmp_path) == 0
    assert (betas(tmp_path, "a") == known).all() and (betas(tmp_path, "b") == known).all()
    out = tmp_path / "again"
    command = ["fit", "--keypoints", str(tmp_path / "k/b"), "--out", str(out), *alone(CHEAP)]
    assert main([*command, "--shape", str(tmp_path / "a")]) == 0  # a result's folder
    assert (betas(tmp_path, "again") == known).all()
    (tmp_path / "anna.json").write_text(json.dumps({"betas": [0.0] * 10}))
    assert batch(tmp_path) == 0 and set(states(tmp_path).values()) == {"done"}
    (tmp_path / "anna.json").write_text(json.dumps({"height": 1.7}))
    capsys.readouterr()
    assert batch(tmp_path) == INPUT_ERROR
    assert "line 2, column shape" in (error := capsys.readouterr().err) and "has no shape (lacks 'betas')" in error
