"""Paths that are no plain files, where the app reads what a user names: refused, or taken for nothing, at once."""

from collections.abc import Callable
from pathlib import Path

import pytest

from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from tcfit_app.batch.inputs import files_of
from tcfit_app.batch.manifest import ClipTask, Complaints, read_manifest
from tcfit_app.batch.outcome import done_before
from tcfit_app.options.batch import BatchOptions
from tcfit_app.options.fit import FitOptions
from tcfit_app.project.project import Project
from tcfit_app.project.storage.clip import DETECTIONS
from tests.samples.project_samples import sample_clip
from tests.samples.special_files import SPECIAL, pipe


def task(video: Path, keypoints: Path) -> ClipTask:
    fit = FitOptions(video=video, keypoints=keypoints, out=video.parent / "out")
    return ClipTask(line=2, name="out", fit=fit, config=FitConfig())


@pytest.mark.parametrize("make", SPECIAL)
def test_a_list_of_clips_that_is_no_plain_file_is_refused_at_once(tmp_path: Path, make: Callable[[Path], None]):
    path = tmp_path / "clips.csv"
    make(path)
    with pytest.raises(InputError, match=r"clips\.csv: is a (named pipe|device), expected a file"):
        read_manifest(BatchOptions(manifest=path), Complaints(path))


@pytest.mark.parametrize("make", SPECIAL)
def test_detections_of_a_project(tmp_path: Path, make: Callable[[Path], None]):
    Project.create(tmp_path / "p", sample_clip()).close()
    (tmp_path / "p" / DETECTIONS).unlink()
    make(tmp_path / "p" / DETECTIONS)
    with pytest.raises(InputError, match=r"is a (named pipe|device), expected a file"):
        Project.open(tmp_path / "p")


def test_pipe_in_place_of_a_summary_is_not_a_finished_clip(tmp_path: Path):
    clip = task(tmp_path, tmp_path)
    clip.out.mkdir()
    (clip.out / "fit.npz").touch()
    pipe(clip.out / "summary.json")
    assert done_before(clip) is None


def test_special_files_in_a_clips_folder_do_not_count(tmp_path: Path):
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "0.png").write_bytes(b"an image")
    before = files_of(task(tmp_path / "images", tmp_path / "images"))
    pipe(tmp_path / "images" / "pipe")
    assert files_of(task(tmp_path / "images", tmp_path / "images")) == before
