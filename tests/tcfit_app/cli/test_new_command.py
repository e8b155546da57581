"""`tcfit new`: the project that it makes, where, and what it refuses; and, with `tcfit fit`, a video alone."""

import sys
from pathlib import Path

import numpy as np
import pytest

from fitting_core import keypoints as kp
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.clips.reading import read_clip
from fitting_core.detect.detectors import DETECTORS
from fitting_core.io.result_files import read_fit
from tcfit_app.cli.main import main, parse
from tcfit_app.cli.new_command import check_same_clip
from tcfit_app.cli.review_command import _take
from tcfit_app.options.clip_input import clip_of
from tcfit_app.options.fit import ReferenceOptions, ReviewOptions
from tcfit_app.project.project import Project
from tests.fitting_core.io.cameras.camera_files import own
from tests.samples.fake_detector import FakeDetector, known, one_person
from tests.samples.media import write_film, write_images
from tests.samples.project_samples import same_keypoints
from tests.tcfit_app.conftest import FRAMES, FinishedRun


def test_the_project_has_the_clip(
    clip_arguments: list[str], keypoint_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["new", *clip_arguments, "--out", str(tmp_path / "a.tcfit")]) == 0
    said = capsys.readouterr()
    assert said.out == f"Made the project {tmp_path / 'a.tcfit'}: {FRAMES} frames of wave\n"
    assert "Focal length 800.0 px" in said.err and "Give --frame-rate." in said.err
    clip = read_clip(
        None, keypoint_folder, clip=ClipOptions(image_size=(640, 480)), camera=CameraOptions(focal_length=800)
    )
    with Project.open(tmp_path / "a.tcfit") as project:
        assert same_keypoints(project.detections, clip.keypoints) and project.clip.camera == clip.camera
        assert project.clip.name == "wave" and len(project.clip) == FRAMES


def test_a_reference_is_stored_at_first_or_later(clip_arguments: list[str], tmp_path: Path):
    names = np.array(kp.NAMES)[kp.LIMBS]
    for name, size in (("first", 0.2), ("later", 0.3)):
        points = np.random.default_rng(0).normal(0, size, (FRAMES, len(names), 3))
        np.savez(tmp_path / f"{name}.npz", points=points, names=names)
    folder = tmp_path / "a.tcfit"
    assert main(["new", *clip_arguments, "--reference", str(tmp_path / "first.npz"), "--out", str(folder)]) == 0
    with Project.open(folder) as project:
        assert project.reference is not None and project.reference.name == "first.npz"
        _take(project, ReviewOptions(truth=ReferenceOptions(reference=tmp_path / "later.npz")))
    with Project.open(folder) as project:
        assert project.reference is not None and project.reference.name == "later.npz"


def test_images_are_linked_or_copied(keypoint_folder: Path, tmp_path: Path):
    images = write_images(tmp_path / "images", *(f"{number}.png" for number in range(FRAMES)), size=(640, 480))
    arguments = ["new", str(images), "--keypoints", str(keypoint_folder)]
    assert main([*arguments, "--out", str(tmp_path / "linked")]) == 0
    assert main([*arguments, "--out", str(tmp_path / "copied"), "--copy-video"]) == 0
    with Project.open(tmp_path / "linked") as linked, Project.open(tmp_path / "copied") as copied:
        assert linked.clip.source and linked.clip.source.samefile(images)
        assert copied.clip.source == tmp_path / "copied" / "media" / "images"
        assert len(list(copied.clip.source.iterdir())) == FRAMES  # pyright: ignore[reportOptionalMemberAccess]


def test_a_camera_file_stays_with_the_project(
    keypoint_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    size = (640, 480)
    matrix = np.diag([800.0, 800, 1]) + np.array([[0, 0, 320], [0, 0, 240], [0, 0, 0]])
    file = own(tmp_path / "camera.npz", K=matrix, size=size, dist=(-0.2, 0.05, 0, 0), up="z")
    plain = ["--keypoints", str(keypoint_folder), "--image-size", "640", "480"]
    monkeypatch.chdir(tmp_path)
    assert main(["new", *plain, "--camera", str(file), "--out", "lab.tcfit"]) == 0
    said = capsys.readouterr().err
    assert "camera file camera.npz" in said and "distortion is removed" in said and "z is up" in said
    straight = read_clip(None, keypoint_folder, clip=ClipOptions(image_size=size), camera=CameraOptions(camera=file))
    filmed = read_clip(None, keypoint_folder, clip=ClipOptions(image_size=size))
    assert not same_keypoints(straight.keypoints, filmed.keypoints)
    with Project.open(tmp_path / "lab.tcfit") as project:
        assert same_keypoints(project.detections, straight.keypoints) and project.clip.camera == straight.camera
    assert main(["export", "lab.tcfit", "--formats", "openpose", "--out", "out"]) == 0
    (folder,) = (tmp_path / "out").iterdir()
    again = read_clip(None, folder, clip=ClipOptions(image_size=size))
    np.testing.assert_allclose(again.keypoints.xy, filmed.keypoints.xy, atol=1e-6)
    # The keypoints as they were filmed are those of the project.
    check_same_clip(tmp_path / "lab.tcfit", filmed, [])
    for wrong in (["--camera-name", "left"], ["--camera", str(file), "--fov", "50"], ["--camera", "nowhere.toml"]):
        assert main(["new", *plain, *wrong, "--out", "b"]) == 2 and not (tmp_path / "b").exists()
    assert "camera_name" not in capsys.readouterr().err


def test_nothing_is_made_of_what_cannot_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "kp").mkdir()
    assert main(["new", "--keypoints", str(tmp_path / "kp"), "--out", str(tmp_path / "a" / "b")]) == 2
    assert "tcfit: " in capsys.readouterr().err and [p.name for p in tmp_path.iterdir()] == ["kp"]


# --- a video alone ---


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
    said = capsys.readouterr().err
    assert "No keypoints yet" in said and "Focal length estimated once there are keypoints" in said
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
