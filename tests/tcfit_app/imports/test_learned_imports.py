"""Results of learned systems as runs of a project: their cameras, their people, and uploads of their files."""

import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.errors import InputError
from fitting_core.io import read_motion
from tcfit_app.imports.results import ImportChoices, import_run
from tcfit_app.imports.uploads import upload
from tcfit_app.project.project import Project
from tests.fitting_core.io.motion.learned_files import (
    gvhmr,
    joblib_bytes,
    torch_bytes,
    truth,
    wham,
    written,
)
from tests.samples.project_samples import CAMERA, FRAMES
from tests.samples.sessions import OneBody


class AnyKind(OneBody):
    """Has a body of every kind."""

    def check(self, *, kind: str, gender: str) -> None:
        pass


def smpl(body: BodyModel) -> Any:
    """Bodies whose SMPL is this one."""
    return AnyKind(replace(body, kind="smpl"))


def test_whams_camera_is_of_the_clips_size(project: Project, tmp_path: Path, tiny_body: BodyModel):
    params = truth(frames=FRAMES)
    path = written(tmp_path / "wham_output.pkl", joblib_bytes(wham({3: (params, np.arange(FRAMES))})))
    run = import_run(project, smpl(tiny_body), path)
    fit = project.runs.load(run.id)
    width, height = CAMERA.size
    assert fit.camera.focal == (np.hypot(width, height),) * 2 and fit.camera.size == CAMERA.size
    assert fit.camera.source == "WHAM's, the image's diagonal"
    assert run.summary["format"] == "WHAM result"
    assert np.abs(joints_in_space(tiny_body, fit.last.params) - joints_in_space(tiny_body, params)).max() < 1e-3


def test_the_person_is_chosen(project: Project, tmp_path: Path, tiny_body: BodyModel):
    frames, params = np.arange(FRAMES), [truth(seed, FRAMES) for seed in (1, 2)]
    people = {4: (params[0], frames), 9: (params[1], frames)}
    path = written(tmp_path / "wham_output.pkl", joblib_bytes(wham(people)))
    for choices, expected in ((ImportChoices(), params[0]), (ImportChoices(person=9), params[1])):
        fit = project.runs.load(import_run(project, smpl(tiny_body), path, choices).id)
        assert torch.allclose(fit.last.params.body_pose, expected.body_pose, atol=1e-5)
    assert fit.last.notes[1] == f"It has 2 people: 4 ({FRAMES} frames), 9 ({FRAMES} frames). Number 9 was taken."


def test_a_person_who_is_not_in_the_whole_clip_is_refused(project: Project, tmp_path: Path, tiny_body: BodyModel):
    path = written(tmp_path / "w.pkl", joblib_bytes(wham({0: (truth(frames=2), np.array([1, 2]))})))
    with pytest.raises(InputError, match="has 2 frames, for the video's frames"):
        import_run(project, smpl(tiny_body), path)


@pytest.mark.parametrize(
    "data",
    [
        torch_bytes(gvhmr(truth())),
        torch_bytes(gvhmr(truth()), _use_new_zipfile_serialization=False),
        joblib_bytes(wham({0: (truth(), np.arange(5))})),
        zlib.compress(joblib_bytes(wham({0: (truth(), np.arange(5))}))),
    ],
    ids=["torch", "torch before 1.6", "joblib", "packed"],
)
def test_uploads(data: bytes):
    with upload("../a result\n.bin", data) as path:
        assert torch.allclose(read_motion(path).params.body_pose, truth().body_pose, atol=1e-5)
