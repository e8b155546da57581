"""`tcfit review` where a project lies already: it opens that of the same clip, and says why it opens no other."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting_core.errors import InputError
from fitting_core.io.keypoints.openpose import write_openpose
from tcfit_app.cli.main import main, parse
from tcfit_app.cli.review_command import opened
from tcfit_app.project.project import Project
from tests.samples.media import write_images
from tests.samples.project_samples import FRAMES, same_keypoints, sample_keypoints


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def images(folder: str, seed: int = 0) -> Path:
    """A clip "walk"."""
    names = (f"{number:06}.png" for number in range(FRAMES))
    return write_images(Path(folder, "walk"), *names, seed=seed, size=(480, 480))


def keypoints(folder: str, seed: int = 0) -> Path:
    write_openpose(Path(folder), sample_keypoints(seed=seed), name="walk")
    return Path(folder)


def review(*arguments: Any) -> Project:
    """What `tcfit review` opens; closed again."""
    with opened(parse(["review", *map(str, arguments)])) as project:
        return project


OPTIONS = {
    "--fov": ["90"],
    "--center": ["100", "200"],
    "--first-frame": ["1"],
    "--last-frame": ["2"],
    "--frame-rate": ["12"],
}


def test_the_clip_of_another_folder_is_not_taken_for_this_one(capsys: pytest.CaptureFixture[str]):
    review(images("one"))
    with pytest.raises(InputError, match=r"walk.tcfit: is the project of another clip than .*two/walk. Give --out"):
        review(images("two", seed=1))
    assert "Opening" not in capsys.readouterr().err
    assert review("two/walk", "--out", "second.tcfit").folder.name == "second.tcfit"
    shutil.copytree("one/walk", "moved/walk")
    assert review("moved/walk").folder.name == "walk.tcfit", "the same images"


@pytest.mark.parametrize("with_keypoints", [False, True])
def test_options_that_would_have_made_another_clip_are_refused(with_keypoints: bool):
    video, points = images("one"), keypoints("points")
    arguments = [video, "--keypoints", points] if with_keypoints else [video]
    review(*arguments)
    for option, value in OPTIONS.items():
        with pytest.raises(InputError, match=rf"already exists for other frames.* {option} can only be given"):
            review(*arguments, option, *value)


@pytest.mark.parametrize("with_keypoints", [False, True])
def test_the_command_that_made_a_project_opens_it_again(with_keypoints: bool, capsys: pytest.CaptureFixture[str]):
    video, points = images("one"), keypoints("points")
    options = [text for option, value in OPTIONS.items() for text in (option, *value)]
    arguments = [video, *(["--keypoints", points] if with_keypoints else []), "--copy-video", *options]
    first, again = review(*arguments), review(*arguments)
    assert again.folder == first.folder and len(again.clip) == 2 and again.has_detections == with_keypoints
    assert capsys.readouterr().err.endswith("Opening the existing project walk.tcfit.\n")
    assert review(video).clip.camera == first.clip.camera, "without options it is opened as it is"


def test_a_camera_that_nobody_asked_for_is_not_compared():
    video = images("one")
    made = review(video, "--fov", "90", "--center", "100", "200").clip.camera
    assert review(video, "--last-frame", str(FRAMES - 1)).clip.camera == made
    assert review(video, "--fov", "90").clip.camera == made == review(video, "--center", "100", "200").clip.camera
    for option, value in {"--focal-length": ["diagonal"], "--center": ["100", "201"]}.items():
        with pytest.raises(InputError, match=f"{option} can only be given for a new project"):
            review(video, option, *value)


def test_a_calibration_is_compared_where_one_is_given(tmp_path: Path):
    """Its principal point, told from the middle of the first pixel, is nobody's middle of an image: the clip without it
    is the project's all the same."""
    file, other = tmp_path / "camera.npz", tmp_path / "other.npz"
    matrix = np.array([[800.0, 0, 250], [0, 800, 230], [0, 0, 1]])
    for path, distortion in ((file, -0.2), (other, -0.1)):
        np.savez(path, K=matrix, size=(480, 480), dist=(distortion, 0.05, 0, 0))
    video = images("one")
    made = review(video, "--camera", file).clip.camera
    assert made.center == (250.5, 230.5) and made.lens is not None
    assert (
        review(video, "--last-frame", str(FRAMES - 1)).clip.camera
        == made
        == review(video, "--camera", file).clip.camera
    )
    for options in (["--camera", other], ["--center", "240", "240"], ["--fov", "90"], ["--first-frame", "1"]):
        with pytest.raises(InputError, match="can only be given for a new project"):
            review(video, *options)


def test_other_keypoints_are_refused():
    video, points = images("one"), keypoints("points")
    review(video, "--keypoints", points)
    with pytest.raises(InputError, match=r"walk.tcfit: already exists with keypoints of.* Give --out"):
        review(video, "--keypoints", keypoints("others", seed=1))
    assert review(video).has_detections, "a video alone says nothing of keypoints"


def test_another_person_is_refused():
    video, points = images("one"), keypoints("points")
    for mine, other in zip(sorted(points.iterdir()), sorted(keypoints("others", seed=1).iterdir()), strict=True):
        both = [person for file in (mine, other) for person in json.loads(file.read_text())["people"]]
        mine.write_text(json.dumps({"people": both}))
    arguments = [video, "--keypoints", points, "--person"]
    review(*arguments, "0")
    with pytest.raises(InputError, match="of another person"):
        review(*arguments, "1")
    assert same_keypoints(review(*arguments, "0").detections, review(video).detections)


def test_a_project_of_a_video_alone_says_how_it_gets_its_keypoints():
    video, points = images("one"), keypoints("points")
    assert not review(video).has_detections
    with pytest.raises(InputError, match=r"already exists without keypoints.*tcfit review walk.tcfit.*panel Start"):
        review(video, "--keypoints", points)
    found = review(video, "--keypoints", points, "--out", "other").detections
    with Project.open(Path("walk.tcfit")) as project:
        project.take_detections(found)
    assert same_keypoints(review(video, "--keypoints", points).detections, found)


def test_a_project_without_a_video_is_told_by_its_keypoints():
    points = keypoints("walk")
    review("--keypoints", points)
    assert review("--keypoints", points).folder.name == "walk.tcfit"
    with pytest.raises(InputError, match="keypoints of another person"):
        review("--keypoints", keypoints("new/walk", seed=1))
    with pytest.raises(InputError, match="another clip than"):
        review(images("one"), "--keypoints", points)


def test_options_of_a_clip_are_refused_for_a_project(capsys: pytest.CaptureFixture[str]):
    review(images("one"))
    assert main(["review", "walk.tcfit", "--out", "x.tcfit", "--fov", "90", "--person", "2"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "walk.tcfit: is already a project. --fov, --person can only be given for a new project" in said
    assert not Path("x.tcfit").exists()


@pytest.mark.parametrize("command", ["review", "new"])
def test_a_project_that_was_packed_is_to_be_unpacked(command: str, capsys: pytest.CaptureFixture[str]):
    Path("walk.tcfit.zip").touch()
    assert main([command, "walk.tcfit.zip"]) == 2
    assert "unpack it with any archiver into a folder NAME.tcfit" in " ".join(capsys.readouterr().err.split())
