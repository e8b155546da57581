"""Many clips: what each one gives, what is fitted again, and what is reported."""

import json
import multiprocessing
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.files.npz import write_npz
from fitting_core.io.result_files import read_fit
from tcfit_app.cli.ending import INPUT_ERROR
from tcfit_app.cli.main import main
from tcfit_app.fitting import process_queue
from tcfit_app.home.catalogue import Catalogue
from tests.drivers.processes import needs_fork
from tests.samples.batch_clips import CHEAP, fitted, rows_of, states_of, write_batch, write_clip, write_list

pytestmark = needs_fork


@pytest.fixture(autouse=True)
def forks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that need not import torch again; how they are really started is tested in test_batch_crash.py."""
    monkeypatch.setattr(process_queue, "CONTEXT", multiprocessing.get_context("fork"))


def batch(folder: Path, *options: str) -> int:
    return main(["batch", str(folder / "clips.csv"), *CHEAP, "--jobs", "1", *options])


def test_clip_of_a_batch_equals_a_single_fit_and_is_listed(tmp_path: Path, free_body: BodyModel, capsys):
    write_batch(tmp_path, free_body, clips=2)
    assert batch(tmp_path) == 0
    output = capsys.readouterr().out
    assert "[1/2] done   fits/c000" in output and "fitted now" in output and "clips.batch/summary.csv" in output
    rows, _ = Catalogue(tmp_path).refresh()
    assert [(row.place, row.kind, row.state) for row in rows] == [
        ("fits/c000", "result", "fitted"),
        ("fits/c001", "result", "fitted"),
    ]
    assert all(row.off and row.frames > 0 for row in rows)
    alone = tmp_path / "alone"
    assert main(["fit", "--keypoints", str(tmp_path / "keypoints" / "c001"), "--out", str(alone), *CHEAP]) == 0
    one, other = read_fit(alone), read_fit(tmp_path / "fits" / "c001")
    for name, values in vars(one.params).items():
        assert (values == getattr(other.params, name)).all(), name
    assert {f.name for f in alone.iterdir()} == {f.name for f in (tmp_path / "fits/c001").iterdir()}
    row = rows_of(tmp_path)["fits/c001"]
    assert row["state"] == "done" and row["frames"] == "3" and 0 < float(row["body_p95_px"]) < 15
    assert float(row["seconds"]) > 0 and float(row["jitter_mm_per_frame2"]) > 0


def test_finished_clip_is_skipped_until_its_files_or_settings_change(tmp_path: Path, free_body: BodyModel):
    write_batch(tmp_path, free_body, clips=3)
    assert batch(tmp_path) == 0 and states_of(tmp_path) == ["done"] * 3
    first = fitted(tmp_path)
    assert batch(tmp_path, "--device", "cpu") == 0 and states_of(tmp_path) == ["done before"] * 3
    assert fitted(tmp_path) == first and float(rows_of(tmp_path)["fits/c000"]["body_p95_px"]) > 0
    write_clip(tmp_path / "keypoints/c001", free_body, seed=77)
    shutil.rmtree(tmp_path / "fits/c002")
    assert batch(tmp_path) == 0 and states_of(tmp_path) == ["done before", "done", "done"]
    assert fitted(tmp_path)["c000"] == first["c000"]
    shutil.rmtree(tmp_path / "keypoints/c000")  # a finished clip no longer needs its input
    assert batch(tmp_path) == 0 and states_of(tmp_path) == ["done before"] * 3
    assert batch(tmp_path, "--set", "shape_sample.seed=7") == INPUT_ERROR  # but now it is
    write_clip(tmp_path / "keypoints/c000", free_body)
    assert batch(tmp_path, "--set", "shape_sample.seed=7") == 0 and states_of(tmp_path) == ["done"] * 3


def test_result_without_its_mark_is_fitted_again(tmp_path: Path, free_body: BodyModel):
    """As a process leaves it that dies between the first and the last file; so does one before summary.json."""
    write_batch(tmp_path, free_body, clips=2)
    assert batch(tmp_path) == 0
    summary = tmp_path / "fits/c000/summary.json"
    content = json.loads(summary.read_text())
    del content["batch"]
    summary.write_text(json.dumps(content))
    (tmp_path / "fits/c001/summary.json").unlink()
    assert batch(tmp_path) == 0 and states_of(tmp_path) == ["done", "done"]
    assert batch(tmp_path) == 0 and states_of(tmp_path) == ["done before", "done before"]


def test_failed_clip_does_not_stop_the_others_and_is_fitted_again(tmp_path: Path, free_body: BodyModel, capsys):
    write_batch(tmp_path, free_body, clips=3, broken=1)
    assert batch(tmp_path) == 1 and states_of(tmp_path) == ["done", "failed", "done"]
    assert "is not readable as JSON" in rows_of(tmp_path)["fits/c001"]["reason"]
    assert not (tmp_path / "fits/c001").exists() and "is not readable" in capsys.readouterr().out
    write_clip(tmp_path / "keypoints/c001", free_body)
    assert batch(tmp_path) == 0 and states_of(tmp_path) == ["done before", "done", "done before"]


def test_other_files_among_the_results_stay(tmp_path: Path, free_body: BodyModel, capsys):
    write_batch(tmp_path, free_body, clips=1)
    out = tmp_path / "fits/c000"
    out.mkdir(parents=True)
    (out / "thesis.tex").write_text("mine")
    assert batch(tmp_path) == INPUT_ERROR
    assert "line 2, column out" in (error := capsys.readouterr().err) and "thesis.tex" in error
    assert batch(tmp_path, "--overwrite") == 0
    (out / "overlay.mp4").write_text("of the fit that is to be replaced")
    assert batch(tmp_path, "--set", "shape_sample.seed=3") == 0 and states_of(tmp_path) == ["done"]
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


def _camera(path: Path, version: int) -> None:
    camera = {"K": np.array([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]]), "size": np.array([640, 480])}
    write_npz(path, camera | ({"dist": np.array([-0.1, 0, 0, 0])} if version else {}))


def _shape(path: Path, version: int) -> None:
    path.write_text(json.dumps({"betas": [0.5 - version, -0.25, *[0.0] * 8]}))


def _start(path: Path, version: int) -> None:
    shutil.copyfile(path.parent / f"fits/{'yx'[version]}/fit.npz", path)


@pytest.mark.parametrize(
    ("column", "name", "write"),
    [("camera", "camera.npz", _camera), ("shape", "anna.json", _shape), ("start", "start.npz", _start)],
)
def test_clip_is_fitted_again_when_a_file_of_a_column_changes(
    tmp_path: Path, free_body: BodyModel, column: str, name: str, write: Callable[[Path, int], None]
):
    write_clip(tmp_path / "k", free_body)
    write_list(
        tmp_path, [{"keypoints": "k", "out": f"fits/{out}", "fov": fov} for out, fov in (("x", "40"), ("y", ""))]
    )
    assert batch(tmp_path) == 0
    write(tmp_path / name, 0)
    write_list(tmp_path, [{"keypoints": "k", "out": "a", column: name, "last_phase": "2"}])
    assert batch(tmp_path) == 0 and states_of(tmp_path) == ["done"]
    before = read_fit(tmp_path / "a")
    assert batch(tmp_path) == 0 and states_of(tmp_path) == ["done before"]
    write(tmp_path / name, 1)
    assert batch(tmp_path) == 0 and states_of(tmp_path) == ["done"]
    after = read_fit(tmp_path / "a")
    if column == "camera":
        assert before.camera.lens is None and after.camera.lens is not None
    elif column == "shape":
        assert [round(float(fit.params.betas[0, 0]), 4) for fit in (before, after)] == [0.5, -0.5]
    else:
        assert json.loads((tmp_path / "a/summary.json").read_text())["start"]["source"] == name
    (tmp_path / name).unlink()
    write_list(tmp_path, [{"keypoints": "k", "out": "b", column: name}])
    assert batch(tmp_path) == INPUT_ERROR and not (tmp_path / "b").exists()


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (ZeroDivisionError("by chance"), "ZeroDivisionError: by chance"),
        (KeyboardInterrupt(), "A plugin interrupted the fit (KeyboardInterrupt)."),
    ],
)
def test_error_in_a_clip_is_its_failure(
    tmp_path: Path, free_body: BodyModel, monkeypatch, capfd, error: BaseException, reason: str
):
    write_batch(tmp_path, free_body, clips=1)

    def failing(*args: object, **kwargs: object) -> None:
        raise error

    monkeypatch.setattr("tcfit_app.batch.clip_fit.write_result", failing)
    assert batch(tmp_path) == 1
    assert rows_of(tmp_path)["fits/c000"]["reason"] == reason
    assert ("in failing" in capfd.readouterr().err) is isinstance(error, Exception)


@pytest.mark.parametrize("address", [[], ["127.0.0.1:1"], ["ray://127.0.0.1:1"]])
def test_silent_cluster_is_reported(tmp_path: Path, free_body: BodyModel, capsys, address: list[str]):
    pytest.importorskip("ray", reason="Ray is not installed (pip install tcfit[ray])")
    write_batch(tmp_path, free_body, clips=1)
    assert main(["batch", str(tmp_path / "clips.csv"), *CHEAP, "--ray", *address]) == INPUT_ERROR
    assert "no cluster answers" in capsys.readouterr().err
