"""The fits that `tcfit evaluate` measures: a run of a project, or a result of tcfit."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.files.npz import npz_names
from fitting_core.io.result_files import FIT_NAME, read_fit
from fitting_core.measure.pairing import PosedMotion
from fitting_core.measure.references.bodies import body_of
from fitting_core.measure.references.reference import BodyOf, Reference
from fitting_core.video.frame_names import spans
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import is_project
from tcfit_app.project.storage.run_record import Run, named, newest

FIRST, FINAL = "phase 1", "final"
"""Names of the two fits of one result."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluatedFit:
    """A fit to be measured."""

    name: str
    source: str
    """Its path, for the user."""
    body: BodyModel
    phases: dict[str, tuple[BodyParams, float]]
    """By name: parameters, and the seconds up to there."""
    camera: Camera
    frame_rate: float
    first_frame: int
    clip: Clip | None
    """With its keypoints, if known."""
    reference: Reference | None = None
    """The project's own."""
    notes: tuple[str, ...] = ()
    """On how it was read, for the user."""

    def __len__(self) -> int:
        """Frames, the same in all phases."""
        return len(next(iter(self.phases.values()))[0])

    def estimate(self, phase: str) -> PosedMotion:
        """One phase, to be compared."""
        return PosedMotion(
            body=self.body,
            params=self.phases[phase][0],
            camera=self.camera,
            frame_rate=self.frame_rate,
            first_frame=self.first_frame,
            clip=self.clip,
        )


def evaluated_fit(path: Path, *, run: str | None = None, models: Path | None = None) -> EvaluatedFit:
    """Read a fit. Raises InputError if there is no such fit, or its body model is missing.

    Args:
        path: A project, or a folder or file of a result.
        run: Name or number of one of a project's runs; None: the latest of our own that has a result.
        models: Folder with body models that alone is searched.
    """
    if is_project(path):
        with Project.open(path, read_only=True) as project:
            return _of_project(project, _chosen(project, run), models)
    if run is not None:
        raise InputError(f"--run {run}: {path} is not a project, and only projects have several runs. Leave out --run.")
    if not path.exists():
        raise InputError(f"{path}: does not exist; expected a project or a result, which `tcfit fit` makes.")
    if not _is_ours(path):
        raise InputError(
            f"{path}: is neither a project nor a result of tcfit. Import another program's result into a project "
            f"(tcfit import PROJECT {path.name}), and evaluate that."
        )
    return _of_ours(path, models)


def _is_ours(path: Path) -> bool:
    """Whether it is a result of tcfit's: a folder with one, or the file."""
    file = path / FIT_NAME if path.is_dir() else path
    try:
        return file.is_file() and {"format", "phase1_body_pose"} <= set(npz_names(file))
    except (OSError, ValueError):
        return file.name == FIT_NAME


def _of_ours(path: Path, models: Path | None) -> EvaluatedFit:
    fit = read_fit(path)
    body = body_of(BodyOf(kind=fit.body_kind, gender=fit.gender, hash=fit.body_hash), search=models)
    phases = {FIRST: (fit.phase1, 0.0)} | ({} if fit.last_phase == 1 else {FINAL: (fit.params, 0.0)})
    return EvaluatedFit(
        name=path.resolve().name if path.is_dir() else path.stem,
        source=str(path),
        body=body,
        phases=phases,
        camera=fit.camera,
        frame_rate=fit.frame_rate,
        first_frame=fit.first_frame,
        clip=None,
        notes=fit.notes,
    )


def _chosen(project: Project, wanted: str | None) -> Run:
    runs = [run for run in project.runs.all() if run.stored]
    if not runs:
        raise InputError(f"{project.folder}: has no fit yet. Fit it with `tcfit review`.")
    return newest(runs) if wanted is None else named(runs, wanted)


def _of_project(project: Project, run: Run, models: Path | None) -> EvaluatedFit:
    """The first and the last phase of a run."""
    fit, clip = project.runs.load(run.id), project.clip
    seconds = [sum(p.seconds for p in fit.phases if p.phase <= phase.phase) for phase in fit.phases]
    phases = {FIRST: (fit.phases[0].params, seconds[0])} if fit.phases[0].phase == 1 else {}
    if fit.last.phase > 1:
        phases[FINAL] = (fit.last.params, seconds[-1])
    notes: tuple[str, ...] = ()
    if run.kind == "imported" and (missing := (clip.first_frame + np.flatnonzero(~fit.observed.any(1))).tolist()):
        frames = spans(missing)
        notes = (f"It has no result for {len(missing)} frames ({frames}); the nearest frames are used instead.",)
    return EvaluatedFit(
        name=f"{clip.name}, {run.name}",
        source=f"{project.folder}, {run.name}",
        body=Bodies(models).of(run.body),
        phases=phases,
        camera=fit.camera,
        frame_rate=clip.frame_rate,
        first_frame=clip.first_frame,
        clip=clip,
        reference=project.reference,
        notes=notes,
    )
