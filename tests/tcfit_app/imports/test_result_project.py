"""A result becomes a project: with the keypoints, the fit, and the video that it was made of."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz
from fitting_core.fit.events import Finished
from fitting_core.io.result_files import FIT_NAME, SUMMARY_NAME, video_of, write_result
from fitting_core.io.whole_result import read_whole_result
from tcfit_app.imports.results import project_of_result
from tcfit_app.project.glance import glance
from tcfit_app.project.project import Project
from tests.samples.media import write_video
from tests.samples.project_samples import sample_error_bars
from tests.samples.waving import waving_fit, waving_project
from tests.tcfit_app.conftest import FRAMES, FinishedRun


def test_what_a_command_has_fitted_is_the_projects_first_run(tmp_path: Path, finished: FinishedRun):
    project_of_result(finished.folder, tmp_path / "wave.tcfit")
    seen = glance(tmp_path / "wave.tcfit")
    assert (seen.state, seen.fit, seen.name) == ("fitted", 1, "wave")
    with Project.open(tmp_path / "wave.tcfit") as project:
        (run,) = project.runs.all()
        fit, told = project.runs.load(run.id), json.loads((finished.folder / SUMMARY_NAME).read_text())
        assert (run.kind, run.state) == ("fit", "finished")
        assert seen.off["body"] == told["reprojection_px"]["phase3"]["body_p95"]
        assert [phase.phase for phase in fit.phases] == [1, 3] and fit.last.objective == told["objective"]["phase3"]
        (made,) = (event.result for event in finished.events if isinstance(event, Finished))
        assert np.array_equal(fit.last.params.body_pose, made.last.params.body_pose)
        assert np.array_equal(fit.last.frame_cost, made.last.frame_cost) and run.config == made.config
        assert np.array_equal(fit.phases[0].frame_cost, made.phases[0].frame_cost)
        assert project.detections.confidence.max() == pytest.approx(0.9) and project.clip.camera.focal == (800.0, 800.0)


@pytest.fixture
def result(tmp_path: Path, free_body: BodyModel) -> Path:
    """Of a video that is there."""
    waving_project(tmp_path / "p.tcfit", free_body)
    with Project.open(tmp_path / "p.tcfit") as project:
        clip = project.clip
    shutil.rmtree(tmp_path / "p.tcfit")
    fit = waving_fit(0.0)
    fit = replace(fit, phases=(*fit.phases[:-1], replace(fit.last, error_bars=sample_error_bars(0, len(clip)))))
    video = write_video(tmp_path / "walk.mp4", frames=clip.first_frame + len(clip))
    write_result(tmp_path / "fits" / "walk", fit, replace(clip, source=video), free_body)
    return tmp_path / "fits" / "walk"


def test_its_video_comes_along(tmp_path: Path, result: Path):
    project_of_result(result, tmp_path / "walk.tcfit")
    with Project.open(tmp_path / "walk.tcfit") as project:
        assert project.media.path is not None and project.media.path.samefile(tmp_path / "walk.mp4")
        assert project.clip.first_frame == 7
        bars = project.runs.load(1).last.error_bars
        assert bars is not None and np.array_equal(bars.joints, sample_error_bars(0, FRAMES).joints, equal_nan=True)


def test_a_video_that_is_gone_is_told_of_and_nothing_is_made(tmp_path: Path, result: Path):
    (tmp_path / "walk.mp4").rename(tmp_path / "moved.mp4")
    with pytest.raises(InputError, match=r"walk\.mp4: is not there.*Move it back"):
        project_of_result(result, tmp_path / "walk.tcfit")
    assert not (tmp_path / "walk.tcfit").exists()
    content = json.loads((result / SUMMARY_NAME).read_text())
    (result / SUMMARY_NAME).write_text(json.dumps(content | {"video": "../../moved.mp4"}))
    assert read_whole_result(result).clip.source == (tmp_path / "moved.mp4").resolve()


@pytest.mark.parametrize("video", ["walk\0.mp4", "x" * 100_000, "/".join(["y" * 100] * 1000)])
def test_a_video_that_is_not_a_path_is_explained(video: str, tmp_path: Path, result: Path):
    content = json.loads((result / SUMMARY_NAME).read_text())
    (result / SUMMARY_NAME).write_text(json.dumps(content | {"video": video}))
    with pytest.raises(InputError, match=r"summary\.json: the path of a video is not a path of this computer"):
        project_of_result(result, tmp_path / "walk.tcfit")
    assert video_of(result) is None and not (tmp_path / "walk.tcfit").exists()


def test_a_result_of_an_earlier_version_says_what_to_do(tmp_path: Path, result: Path):
    arrays = read_npz(result / FIT_NAME)
    del arrays["keypoints"]
    np.savez(result / FIT_NAME, allow_pickle=False, **arrays)
    with pytest.raises(InputError, match=r"earlier version.*tcfit import PROJECT"):
        project_of_result(result, tmp_path / "walk.tcfit")


@pytest.mark.parametrize("content", [b"{", b"[]", b'{"config": {"solver": "magic"}}', b'{"clip": "x"}'])
def test_a_damaged_summary_is_no_project(content: bytes, tmp_path: Path, result: Path):
    (result / SUMMARY_NAME).write_bytes(content)
    with pytest.raises(InputError, match="cannot be read"):
        project_of_result(result, tmp_path / "walk.tcfit")
    assert not (tmp_path / "walk.tcfit").exists()


def test_a_keypoint_that_is_none_is_damage(result: Path):
    arrays = read_npz(result / FIT_NAME)
    arrays["keypoints"][2, 3, 0] = np.nan
    np.savez(result / FIT_NAME, allow_pickle=False, **arrays)
    with pytest.raises(InputError, match="is damaged"):
        read_whole_result(result)


def test_a_project_that_cannot_take_the_fit_is_not_left_behind(
    tmp_path: Path, result: Path, monkeypatch: pytest.MonkeyPatch
):
    def full(*arguments: object) -> None:
        raise InputError("no space left")

    monkeypatch.setattr("tcfit_app.project.storage.runs.write_run", full)
    with pytest.raises(InputError, match="no space left"):
        project_of_result(result, tmp_path / "walk.tcfit")
    assert not (tmp_path / "walk.tcfit").exists()
