"""What a fit in the background leaves in the project."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.io.keypoints.openpose import write_openpose
from tcfit_app.fitting.process_queue import Work
from tcfit_app.home import fitting
from tcfit_app.home.catalogue import Catalogue
from tcfit_app.home.fitting import fit_project, make_project
from tcfit_app.home.found import Found, find
from tcfit_app.imports.keypoint_jobs import FoundKeypoints
from tcfit_app.project.glance import glance
from tcfit_app.project.project import Project
from tcfit_app.project.storage.lock import ProjectLocked
from tests.samples.media import write_images, write_video
from tests.samples.project_samples import sample_keypoints
from tests.samples.sessions import FRAMES, QUICK, small_clip


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch, tiny_body: BodyModel) -> None:
    monkeypatch.setattr(fitting, "load_body", lambda path: tiny_body)
    monkeypatch.setattr(fitting, "compile_kernels", lambda config: None)


def test_a_fit_and_its_worst_place(tmp_path: Path, tiny_body: BodyModel):
    folder, told = tmp_path / "walk.tcfit", list[Work]()
    Project.create(folder, small_clip(tiny_body)).close()
    fit_project(folder, told.append, config=QUICK)
    seen = glance(folder)
    assert (
        (seen.state, seen.fit) == ("fitted", 1) and set(seen.off) <= {"body", "hands", "face"} and seen.off["body"] > 0
    )
    assert seen.review.worst is not None and seen.review.worst.run == 1
    steps = [work.step.partition(",")[0] for work in told if work.share is not None]
    expected = ["Preparing the fit", "First pass", "One shape", "Final fit", "Looking for suspicious frames"]
    assert list(dict.fromkeys(steps)) == expected
    shares = [work.share for work in told if work.share is not None]
    assert shares == sorted(shares)
    fit_project(folder, told.append, config=QUICK)
    assert glance(folder).fit == 2


def test_a_project_that_somebody_has_open_is_left_alone(tmp_path: Path, tiny_body: BodyModel):
    folder = tmp_path / "walk.tcfit"
    with Project.create(folder, small_clip(tiny_body)) as project, pytest.raises(ProjectLocked):
        fit_project(folder, lambda work: None, config=QUICK)
    assert project.runs is not None and glance(folder).fit is None


def test_a_video_gets_a_project_and_its_keypoints(
    tmp_path: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    class Detected:
        def __init__(self, **options: Any) -> None: ...

        def run(self, clip: Clip, report: Any) -> FoundKeypoints:
            report("3 of 8 frames", 0.4)
            return FoundKeypoints(keypoints=sample_keypoints(len(clip)), notes=("found",), detector="mediapipe")

    def stop(*arguments: object, **options: object) -> None:
        raise InputError("far enough")

    monkeypatch.setattr(fitting, "Detect", Detected)
    monkeypatch.setattr(fitting, "fit_clip", stop)
    video, folder, told = write_video(tmp_path / "walk.mp4", frames=FRAMES), tmp_path / "walk.tcfit", list[Work]()
    make_project(Found(key="0" * 12, path=video, place="walk.mp4", kind="video"))
    assert glance(folder).state == "new"
    with pytest.raises(InputError, match="far enough"):
        fit_project(folder, told.append)
    with Project.open(folder) as project:
        assert project.has_detections and project.media.path is not None and project.media.path.samefile(video)
        assert [run.state for run in project.runs.all()] == ["failed"]
    assert any(work.step == "Finding keypoints" and work.share == pytest.approx(0.3) for work in told)


def test_a_project_that_is_there_is_not_touched(tmp_path: Path, tiny_body: BodyModel):
    video = write_video(tmp_path / "walk.mp4", frames=FRAMES)
    Project.create(tmp_path / "walk.tcfit", small_clip(tiny_body)).close()
    made = make_project(Found(key="0" * 12, path=video, place="walk.mp4", kind="video"))
    assert made != tmp_path / "walk.tcfit" and glance(made).state == "new"
    with Project.open(tmp_path / "walk.tcfit") as project:
        assert np.array_equal(project.detections.xy, small_clip(tiny_body).keypoints.xy)


def test_images_in_smplify_xs_layout_bring_their_keypoints(tmp_path: Path):
    keypoints = sample_keypoints(12)
    write_openpose(tmp_path / "walk" / "keypoints", keypoints, name="walk")
    names = sorted(path.stem.removesuffix("_keypoints") for path in (tmp_path / "walk" / "keypoints").iterdir())
    write_images(tmp_path / "walk" / "images", *(f"{name}.png" for name in names), size=(640, 480))
    (found,) = find(tmp_path)
    make_project(found)
    with Project.open(tmp_path / "walk.tcfit") as project:
        assert project.has_detections and len(project.clip) == 12
        assert project.media.path is not None and project.media.path.samefile(tmp_path / "walk" / "images")
    catalogue = Catalogue(tmp_path)
    assert [(row.name, row.kind) for row in catalogue.refresh()[0]] == [("walk", "project")]
