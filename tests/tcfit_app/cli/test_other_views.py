"""Other views on the command line: fit with one, open the result, fit again, go elsewhere; wrong options."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.fit.fitting import fit_clip
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.io.result_files import read_fit
from tcfit_app.cli.main import main, parse
from tcfit_app.cli.review_command import _take
from tcfit_app.imports.results import project_of_result
from tcfit_app.project.project import Project
from tests.samples.media import write_film
from tests.samples.two_views import CAMERA, seen_from

SCALE = 0.25
"""Of the films, so that they are small."""
FOCAL = str(SCALE * CAMERA.focal[0])
Films = Callable[..., list[str]]


@pytest.fixture
def film(tmp_path: Path) -> Films:
    """film(name, azimuth, frames): a film, and its keypoints in the folder of the same name."""

    def make(name: str, azimuth: float, frames: slice = slice(None), window: str = "05_02_1") -> list[str]:
        clip = seen_from(azimuth, seed=round(azimuth), frames=frames, window=window)
        width, height = (round(SCALE * side) for side in CAMERA.size)
        grey = np.full((height, width, 3), 90 + round(azimuth), np.uint8)
        path = write_film(tmp_path / f"{name}.mp4", [grey] * len(clip), frame_rate=clip.frame_rate)
        points = clip.keypoints
        write_openpose(tmp_path / name, type(points)(xy=SCALE * points.xy, confidence=points.confidence), name=name)
        return [str(path), str(tmp_path / name)]

    return make


def test_fit_open_fit_again_remove_undo_export(
    film: Films, tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture[str]
):
    (a, points_a), (b, points_b) = film("a", 10), film("b", 80, slice(9, None, 2))
    first = [a, "--keypoints", points_a, "--focal-length", FOCAL]
    other = ["--other-view", b, "--other-keypoints", points_b, "--other-focal-length", FOCAL]
    quick = ["--set", "last_phase=1", "--set", "relay_rounds=0", "--no-overlay"]
    assert main(["fit", *first, *other, *quick, "--out", str(tmp_path / "fit")]) == 0
    said = capsys.readouterr().err
    assert said.count("b is another view, ") == 1 and "it starts 0.3" in said and "s later" in said
    (stored,) = read_fit(tmp_path / "fit").views
    assert stored.clip.name == "b" and stored.clip.frame_rate == pytest.approx(15)

    project_of_result(tmp_path / "fit", tmp_path / "a.tcfit")
    with Project.open(tmp_path / "a.tcfit") as project:
        (view,) = project.clip.views
        assert view.relation == stored.relation and view.clip.source == Path(b)
        again = fit_clip(project.clip, free_body, project.runs.load(1).config)
        assert view.sentence() in again.warnings
        project.append(project.removal_of_view(project.views[0].id))
        assert not project.clip.views
        project.undo()
        review = parse(["review", str(tmp_path / "a.tcfit"), *other])
        _take(project, review)  # is there already
        assert len(project.views) == 1
        project.append(project.removal_of_view(project.views[0].id))
        _take(project, review)
        assert len(project.views) == 1
        project_view = project.clip.views[0]

    out = tmp_path / "exported"
    assert main(["export", str(tmp_path / "a.tcfit"), "--formats", "npz", "fit", "--out", str(out)]) == 0
    (exported,) = out.glob("*.fit.npz")
    assert [view.relation for view in read_fit(exported).views] == [project_view.relation]


WRONG = {
    "a person who is not there": (["--other-person", "3"], r"--other-view \S+b\.mp4: person=3, but no frame"),
    "more focal lengths than views": (
        ["--other-focal-length", "auto"],
        "--other-focal-length is given 2 times, but --other-view once",
    ),
    "a file that is not there": (
        ["--other-view", "c.mp4", "--other-keypoints", "auto", "--other-focal-length", "auto"],
        "c.mp4 does not exist; expected a video",
    ),
    "a frame that is not there": (["--other-first-frame", "500"], r"\(--other-first-frame, last frame\)"),
    "all people": (["--people", "all"], "--people all cannot be combined with --other-view"),
}


@pytest.mark.parametrize(("options", "message"), WRONG.values(), ids=WRONG)
def test_wrong_options_are_explained(
    options: list[str], message: str, film: Films, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (a, points_a), (b, points_b) = film("a", 10, slice(0, 30)), film("b", 80, slice(0, 30))
    first = [a, "--keypoints", points_a, "--focal-length", FOCAL]
    other = ["--other-view", b, "--other-keypoints", points_b, "--other-focal-length", FOCAL]
    assert main(["fit", *first, *other, *options, "--out", str(tmp_path / "fit")]) == 2
    assert re.search(message, " ".join(capsys.readouterr().err.split()))
    assert not (tmp_path / "fit").exists()


def test_a_video_is_no_view_of_itself(film: Films, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (a, points_a), (b, points_b) = film("a", 10), film("b", 80)
    first = ["fit", a, "--keypoints", points_a, "--focal-length", FOCAL, "--out", str(tmp_path / "fit")]
    for name, *views in (("a", (a, points_a)), ("b", (b, points_b), (b, points_b))):
        others = [
            option
            for video, points in views
            for option in ("--other-view", video, "--other-keypoints", points, "--other-focal-length", FOCAL)
        ]
        assert main([*first, *others]) == 2
        assert f"{name}.mp4: This is the video of {name}; expected" in " ".join(capsys.readouterr().err.split())


def test_a_view_of_another_person_is_refused(film: Films, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (a, points_a), (b, points_b) = film("a", 10), film("b", 80, window="13_26_1")
    first = [a, "--keypoints", points_a, "--focal-length", FOCAL]
    other = ["--other-view", b, "--other-keypoints", points_b, "--other-focal-length", FOCAL]
    for command in (["new"], ["fit", "--no-overlay"]):
        assert main([*command, *first, *other, "--out", str(tmp_path / "out")]) == 2
        assert "b as another view of a: " in capsys.readouterr().err and not (tmp_path / "out").exists()
