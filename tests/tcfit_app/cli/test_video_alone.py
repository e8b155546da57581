"""`tcfit fit` and `tcfit new` of a video without keypoints: they are found, and it is said by what."""

import sys
from pathlib import Path

import numpy as np
import pytest

from fitting_core.clips.options import ClipOptions
from fitting_core.clips.reading import read_clip
from fitting_core.detect.detectors import DETECTORS
from fitting_core.io.result_files import read_fit
from tcfit_app.cli.main import main, parse
from tcfit_app.options.clip_input import clip_of
from tcfit_app.project.project import Project
from tests.samples.fake_detector import FakeDetector, known, one_person
from tests.samples.media import write_film
from tests.tcfit_app.conftest import FRAMES, FinishedRun

FOUND = f"Keypoints: fake, in {FRAMES} of {FRAMES} frames"


@pytest.fixture
def video(tmp_path: Path) -> Path:
    return write_film(tmp_path / "wave.avi", [np.zeros((480, 640, 3), np.uint8)] * FRAMES, frame_rate=30)


@pytest.fixture
def fake(keypoint_folder: Path, monkeypatch: pytest.MonkeyPatch) -> FakeDetector:
    """It finds the keypoints of the clip that all other tests fit."""
    clip = read_clip(None, keypoint_folder, clip=ClipOptions(image_size=(640, 480)))
    detector = FakeDetector(one_person(clip.keypoints))
    monkeypatch.setitem(DETECTORS, "mediapipe", known(detector))
    return detector


@pytest.fixture
def fit_video(fit_arguments: list[str], video: Path) -> list[str]:
    """`tcfit fit VIDEO` into tmp_path/out."""
    rest = fit_arguments[fit_arguments.index("--focal-length") :]
    return ["fit", str(video), *rest]


def test_a_fit(
    fit_video: list[str],
    fake: FakeDetector,
    finished: FinishedRun,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setattr("fitting_core.fit.fitting.fit_events", finished.replay)
    assert main(fit_video) == 0
    said = capsys.readouterr().err
    assert f"Detecting keypoints in {FRAMES} frames ..." in said and FOUND in said
    assert "Note: Keypoints were found by fake (version 1)." in said
    assert len(read_fit(tmp_path / "out").params) == FRAMES and len(fake.asked) == FRAMES
    assert main(fit_video) == 0
    assert "Detecting" not in (said := capsys.readouterr().err) and FOUND in said
    assert len(fake.asked) == FRAMES, "found before"


def test_a_bar_on_a_terminal(
    fit_video: list[str],
    fake: FakeDetector,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main(["new", fit_video[1], "--out", str(tmp_path / "a.tcfit")]) == 0
    assert (
        "Keypoints:" in (said := capsys.readouterr().err) and f"{FRAMES}/{FRAMES}" in said and "Detecting" not in said
    )


def test_without_keypoints_on_demand(
    fit_video: list[str], fake: FakeDetector, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    video, alone = fit_video[1], ["--keypoints", "none"]
    assert main(["new", video, *alone, "--out", str(tmp_path / "a.tcfit")]) == 0
    assert "No keypoints yet" in capsys.readouterr().err
    with Project.open(tmp_path / "a.tcfit") as project:
        assert not project.has_detections and len(project.clip) == FRAMES
    refused = {
        "a fit needs keypoints": [*fit_video, *alone],
        "--people all cannot be combined with --keypoints none": ["new", video, *alone, "--people", "all"],
        "--person needs keypoints, and": ["new", video, *alone, "--person", "1"],
        "--detector needs keypoints, and": ["new", video, *alone, "--detector", "dwpose-l"],
        "--keypoints none needs a video": ["new", *alone],
    }
    for words, command in refused.items():
        assert main(command) == 2
        assert words in capsys.readouterr().err
    assert not fake.asked


def test_a_review_finds_nothing_itself(video: Path, fake: FakeDetector):
    """The app does, while it is looked at; by the detector that is named."""
    for more in ([], ["--keypoints", "none"], ["--detector", "mediapipe-fast"]):
        clip = clip_of(parse(["review", str(video), *more]))
        assert len(clip) == FRAMES and not clip.keypoints.confidence.any()
    assert not fake.asked


def test_what_is_lacking_is_told_once_and_nothing_is_written(
    fit_video: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("TCFIT_DETECTORS", str(tmp_path / "empty"))
    assert main(fit_video) == 2
    said = capsys.readouterr().err
    assert said.count("tcfit models add mediapipe") == 1 and "Traceback" not in said
    assert not (tmp_path / "out").exists()
