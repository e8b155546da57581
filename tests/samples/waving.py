"""A project of the free body with two runs that are known, without fitting anything."""

from pathlib import Path

import numpy as np

from fitting_core.body.model import BodyModel
from fitting_core.results.fit_result import FitResult, PhaseResult
from tcfit_app.fitting.bodies import record_of
from tcfit_app.project.project import Project
from tests.samples.project_samples import CONFIG, sample_clip
from tests.tcfit_app.conftest import FRAMES, motion


def waving_fit(shift: float) -> FitResult:
    """Three phases, each at another depth: 4.5 m + shift + a tenth of the phase's number."""
    phases = []
    for number in (1, 2, 3):
        params = motion()
        params.camera_translation[:, 2] += shift + 0.1 * number
        costs = np.zeros(FRAMES)
        phases.append(PhaseResult(phase=number, params=params, objective={"total": 0.0}, frame_cost=costs, seconds=1.0))
    observed = np.ones((FRAMES, 55), bool)
    return FitResult(phases=tuple(phases), camera=sample_clip().camera, config=CONFIG, observed=observed)


def waving_project(folder: Path, body: BodyModel) -> Path:
    """A project with the runs "near", shifted by 0, and "far", shifted by 2 m."""
    with Project.create(folder, sample_clip(FRAMES)) as made:
        for name, shift in (("near", 0.0), ("far", 2.0)):
            run = made.runs.start(CONFIG, body=record_of(body), edits_seen=0, name=name)
            made.runs.finish(run.id, waving_fit(shift))
    return folder
