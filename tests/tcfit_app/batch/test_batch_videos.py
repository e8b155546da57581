"""Clips of a list without keypoints: they are found, once, and another detector's make it another clip."""

import multiprocessing
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.clips.options import ClipOptions
from fitting_core.clips.reading import read_clip
from fitting_core.detect.detectors import DETECTORS
from fitting_core.io.result_files import read_fit
from tcfit_app.batch import clip_fit, inputs
from tcfit_app.cli.ending import INPUT_ERROR
from tcfit_app.cli.main import main
from tcfit_app.fitting import process_queue
from tests.drivers.processes import needs_fork
from tests.samples.batch_clips import CAMERA, CHEAP, fitted, states_of, write_clip, write_list
from tests.samples.fake_detector import FakeDetector, known, one_person
from tests.samples.media import write_film

pytestmark = needs_fork
OPTIONS = [option for option in CHEAP if option not in ("--image-size", "640", "480")]


@pytest.fixture(autouse=True)
def forks(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Processes that know the fake detector."""
    monkeypatch.setattr(process_queue, "CONTEXT", multiprocessing.get_context("fork"))
    forget()
    yield
    forget()


def forget() -> None:
    """What is known of detectors, as in a new process."""
    inputs.detector_version.cache_clear()
    clip_fit._detector.cache_clear()


@pytest.fixture
def folder(tmp_path: Path, free_body: BodyModel, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two videos without keypoints and one with them, and a fake detector that finds those."""
    write_clip(tmp_path / "keypoints", free_body)
    put(monkeypatch, tmp_path)
    for name in ("a", "b", "c"):
        write_film(tmp_path / f"{name}.avi", [np.full((480, 640, 3), ord(name), np.uint8)] * 3)
    rows = [{"video": f"{name}.avi", "keypoints": "", "out": f"fits/{name}"} for name in ("a", "b")]
    write_list(tmp_path, [*rows, {"video": "c.avi", "keypoints": "keypoints", "out": "fits/c"}])
    return tmp_path


def put(monkeypatch: pytest.MonkeyPatch, folder: Path, version: str = "1", name: str = "mediapipe") -> None:
    clip = read_clip(None, folder / "keypoints", clip=ClipOptions(image_size=CAMERA.size))
    monkeypatch.setitem(DETECTORS, name, known(FakeDetector(one_person(clip.keypoints), version=version)))
    forget()


def batch(folder: Path, *options: str, jobs: int = 1) -> int:
    return main(["batch", str(folder / "clips.csv"), *OPTIONS, "--jobs", str(jobs), *options])


def test_a_video_is_enough(folder: Path, keypoint_store: Path):
    assert batch(folder, jobs=2) == 0 and states_of(folder) == ["done"] * 3
    found, given = read_fit(folder / "fits/a"), read_fit(folder / "fits/c")
    assert found.params.body_pose.shape == given.params.body_pose.shape
    assert (found.params.body_pose - given.params.body_pose).abs().max() < 0.05
    assert len(list(keypoint_store.iterdir())) == 2


def test_clips_of_one_video_that_are_fitted_at_once(folder: Path, keypoint_store: Path):
    """Both look for the same keypoints in the same place."""
    write_list(folder, [{"video": "a.avi", "out": f"fits/{name}"} for name in "xyz"])
    assert batch(folder, jobs=3) == 0 and len(fitted(folder)) == 3
    one, other = (read_fit(folder / "fits" / name).params for name in "xz")
    assert (one.body_pose == other.body_pose).all()
    (found,) = keypoint_store.iterdir()
    assert sorted(file.name for file in found.iterdir()) == ["part-000000.npz", "settings.json"]


def test_clip_is_fitted_again_when_its_detector_changes(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """Only clips whose keypoints it has found."""
    assert batch(folder) == 0
    put(monkeypatch, folder, version="2")
    assert batch(folder) == 0 and states_of(folder) == ["done", "done", "done before"]
    put(monkeypatch, folder, name="mediapipe-fast")
    assert batch(folder, "--detector", "mediapipe-fast") == 0
    assert states_of(folder) == ["done", "done", "done before"]


def test_what_is_done_does_not_need_its_detector(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    assert batch(folder) == 0
    monkeypatch.undo()
    monkeypatch.setenv("TCFIT_DETECTORS", str(tmp_path / "empty"))
    forget()
    assert batch(folder) == 0 and states_of(folder) == ["done before"] * 3
    capsys.readouterr()
    assert batch(folder, "--set", "shape_sample.seed=7") == INPUT_ERROR
    said = capsys.readouterr().err
    assert said.count("tcfit models add mediapipe") == 1 and "line 2, column detector: " in said


def test_long_video_is_fitted_in_parts(folder: Path, capsys: pytest.CaptureFixture[str]):
    write_list(folder, [{"video": "a.avi", "out": "fits/a", "frame_rate": "0.2", "part_minutes": "0.1"}])
    assert batch(folder) == 0
    parts = sorted((folder / "fits/a").iterdir())
    assert [part.name for part in parts] == ["00-00-00", "00-00-05", "00-00-10"]
    assert [(fit.first_frame, len(fit.params)) for fit in map(read_fit, parts)] == [(0, 1), (1, 1), (2, 1)]
    assert batch(folder) == 0 and "3 of 3 clips were finished before" in capsys.readouterr().out
