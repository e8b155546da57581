"""What a fit is told that its clip does not say: a start and a shape from runs, projects and files."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from fitting_core.body import rotations
from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.results.fit_result import FitResult, PhaseResult
from tcfit_app.fitting.bodies import record_of
from tcfit_app.imports.given import KnownInputs, read_given, read_shape
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Given, Run, Source
from tests.samples.scenes import arms_in_motion
from tests.samples.sessions import FRAMES, QUICK, OneBody, small_clip

SHAPE = torch.linspace(-1.0, 1.0, 10)


@pytest.fixture
def project(tmp_path: Path, tiny_body: BodyModel) -> Iterator[Project]:
    with Project.create(tmp_path / "walk.tcfit", small_clip(tiny_body)) as made:
        yield made


def run_of(project: Project, body: BodyModel, *, kind: Any = "fit", phase: int = 3, **summary: Any) -> Run:
    """A finished run that has the clip's motion; of an imported one the first two frames are missing."""
    params = arms_in_motion(FRAMES)
    params = replace(params, betas=SHAPE.expand(FRAMES, -1))
    observed = np.ones((FRAMES, 55), bool)
    observed[:2] = kind != "imported"
    found = PhaseResult(phase=phase, params=params, objective={}, frame_cost=np.zeros(FRAMES), seconds=0.0)
    fit = FitResult(
        phases=(found,), camera=project.clip.camera, config=QUICK, observed=observed, pose_prior="GVHMR result"
    )
    run = project.runs.start(QUICK, body=record_of(body), edits_seen=0, kind=kind, name=f"{kind} {phase}")
    return project.runs.finish(run.id, fit, summary=summary or None)


def read(project: Project, body: BodyModel, **given: Source) -> KnownInputs:
    return read_given(Given(**given), project, project.clip, body, OneBody(body))  # pyright: ignore


def test_a_fit_begins_with_a_run(project: Project, tiny_body: BodyModel):
    run = run_of(project, tiny_body)
    known = read(project, tiny_body, start=Source(run=run.id))
    assert known.start is not None and known.start.there.all() and known.shape is None
    truth = arms_in_motion(FRAMES)
    assert torch.allclose(known.start.params.body_pose.float(), truth.body_pose.float(), atol=1e-5)
    about = known.start.about
    assert (about.source, about.format, about.frames) == (run.name, "a fit of tcfit", FRAMES)


def test_a_fit_begins_with_the_frames_that_an_imported_run_has(project: Project, tiny_body: BodyModel):
    run = run_of(project, tiny_body, kind="imported", phase=1, placed=True)
    known = read(project, tiny_body, start=Source(run=run.id))
    assert known.start is not None and known.start.there.tolist() == [False] * 2 + [True] * (FRAMES - 2)
    assert known.start.about.format == "GVHMR result"


def test_a_motion_that_no_camera_saw_is_turned_to_the_clip(project: Project, tiny_body: BodyModel):
    """One that a camera saw stays as that saw it."""
    params = arms_in_motion(FRAMES)
    run = run_of(project, tiny_body, kind="imported", phase=1, placed=False)
    fit = project.runs.load(run.id)
    half = torch.tensor([0.0, 0.0, torch.pi]).expand(FRAMES, 3)  # upright is half a turn about x: together about y
    away = replace(fit.last.params, global_orient=half.to(params.global_orient))
    fit = replace(fit, phases=(replace(fit.last, params=away),), observed=np.ones((FRAMES, 55), bool))
    true = rotations.exp(params.global_orient.double())
    for placed in (False, True):
        made = project.runs.start(QUICK, body=run.body, edits_seen=0, kind="imported")
        project.runs.finish(made.id, fit, summary={"placed": placed})
        start = read(project, tiny_body, start=Source(run=made.id)).start
        assert start is not None
        found = rotations.exp(start.params.global_orient.double())
        assert torch.allclose(found, true, atol=1e-3) is not placed


def test_a_shape_comes_from_a_run_or_a_project(project: Project, tiny_body: BodyModel, tmp_path: Path):
    run = run_of(project, tiny_body)
    known = read(project, tiny_body, shape=Source(run=run.id))
    assert known.shape is not None and np.allclose(known.shape.betas, SHAPE) and known.shape.source == run.name
    assert np.allclose(read_shape(project.folder, tiny_body).betas, SHAPE), "of a project that is open elsewhere, too"
    known = read(project, tiny_body, shape=Source(path=str(project.folder)))
    assert known.shape is not None and known.shape.source == "walk.tcfit"
    imported = run_of(project, tiny_body, kind="imported", phase=1)
    known = read(project, tiny_body, shape=Source(run=imported.id))
    assert known.shape is not None and np.allclose(known.shape.betas, SHAPE)


def test_what_is_of_no_use_is_told(project: Project, tiny_body: BodyModel, tmp_path: Path):
    with pytest.raises(InputError, match="has no fit yet"):
        read_shape(project.folder, tiny_body)
    first, whole = run_of(project, tiny_body, phase=1), run_of(project, tiny_body)
    with pytest.raises(InputError, match="no shape for the whole clip yet"):
        read(project, tiny_body, shape=Source(run=first.id))
    other = replace(tiny_body, hash="another")
    with pytest.raises(InputError, match="uses another body model"):
        read(project, other, shape=Source(run=whole.id))
    with pytest.raises(InputError, match=r"walk\.tcfit: .* uses another body model"):
        read_shape(project.folder, other)
    begun = project.runs.start(QUICK, body=whole.body, edits_seen=0)
    with pytest.raises(InputError, match="has no result yet"):
        read(project, tiny_body, start=Source(run=begun.id))
    with pytest.raises(InputError, match="There is no run 99"):
        read(project, tiny_body, start=Source(run=99))
    with pytest.raises(InputError, match="nowhere"):
        read(project, tiny_body, start=Source(path=str(tmp_path / "nowhere.npz")))


def test_what_was_chosen_stays_with_the_run(project: Project, tiny_body: BodyModel):
    given = Given(start=Source(path="/x/wham.pkl", person=2, first_frame=7), shape=Source(run=1))
    run = project.runs.start(QUICK, body=record_of(tiny_body), edits_seen=0, given=given)
    assert run.given == given and project.runs.get(run.id).given == given
    assert project.runs.start(QUICK, body=record_of(tiny_body), edits_seen=0).given == Given()
    with project._database.transaction() as connection:
        connection.execute("UPDATE runs SET given = '{\"start\": 3}' WHERE id = ?", (run.id,))
    with pytest.raises(InputError, match="There is no run"):
        project.runs.get(run.id)
    assert any("its given cannot be read" in d for d in project.damage)
