"""The fits that `tcfit evaluate` measures: a run of a project, a result of tcfit, or another program's."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.files.npz import npz_names
from fitting_core.io import read_motion
from fitting_core.io.result_files import FIT_NAME, read_fit
from fitting_core.measure.pairing import PosedMotion
from fitting_core.measure.references.bodies import body_of
from fitting_core.measure.references.reference import BodyOf, Reference
from fitting_core.results.fit_result import FitResult
from fitting_core.video.frame_names import spans
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.imports.results import ImportChoices, posed_body, vposer_decoder
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import is_project
from tcfit_app.project.storage.run_record import Run, named, newest

FIRST, FINAL = "phase 1", "final"
"""What the two fits of one result are called."""
_USUAL_RATE, _HIGHEST_RATE = 30.0, 2000.0
"""Frames per second."""
_MOST_FRAMES = 10**6
ANY_CAMERA = Camera(focal=(1000.0, 1000.0), center=(500.0, 500.0), size=(1000, 1000))
"""Shows a body whose own camera is not known; a body without one is placed in front of it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluatedFit:
    """A fit to be measured."""

    name: str
    source: str
    """Where it was found, for the user."""
    body: BodyModel
    phases: dict[str, tuple[BodyParams, float]]
    """By name: parameters, and the seconds up to there."""
    camera: Camera | None
    """None: another program's result that does not have it."""
    frame_rate: float
    rate_known: bool = True
    """Whether the frame rate was given; else it is the usual one."""
    first_frame: int
    clip: Clip | None
    """With its keypoints, where they are known."""
    reference: Reference | None = None
    """The project's own."""
    placed: bool = True
    """Whether it is known where it stands before a camera."""
    notes: tuple[str, ...] = ()
    """What a user should know of how it was read."""

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

    def beside(self, reference: Reference | None) -> "EvaluatedFit":
        """The same with the reference's frame rate where its own is not known."""
        if self.rate_known or reference is None or reference.frame_rate is None:
            return self
        rate = reference.frame_rate
        note = f"It does not give its frame rate, which is taken to be the reference's, {rate:g} per second."
        return replace(self, frame_rate=rate, rate_known=True, notes=(*self.notes, note))


def evaluated_fit(
    path: Path,
    *,
    run: str | None = None,
    models: Path | None = None,
    person: int | None = None,
    body_model: str | None = None,
    frame_rate: float | None = None,
) -> EvaluatedFit:
    """Read a fit. Raises InputError if there is no such fit, or its body model is not there.

    Args:
        path: A project, a folder or file of a result, or what `fitting_core.io.read_motion` reads.
        run: Name or number of one of a project's runs; None: the latest of our own that has a result.
        models: Folder with body models that alone is searched.
        person, body_model, frame_rate: What another program's result does not tell, or what to take instead.
    """
    choices = {"--person": person, "--body-model": body_model, "--frame-rate": frame_rate}
    given = [name for name, value in choices.items() if value is not None]
    if given and (is_project(path) or _is_ours(path)):
        raise InputError(f"{', '.join(given)}: {path} is a result of tcfit, which has this itself. Leave it out.")
    if is_project(path):
        with Project.open(path, read_only=True) as project:
            return _of_project(project, _chosen(project, run), models)
    if run is not None:
        raise InputError(f"--run {run}: {path} is not a project, and only projects have several runs. Leave out --run.")
    if not path.exists():
        raise InputError(f"{path}: does not exist; expected a project or a result, which `tcfit fit` makes.")
    if _is_ours(path):
        return _of_ours(path, models)
    return _of_others(path, models, ImportChoices(person=person, body_model=body_model), frame_rate)


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


def _of_others(path: Path, models: Path | None, choices: ImportChoices, frame_rate: float | None) -> EvaluatedFit:
    """Another program's result, on the body that it belongs to."""
    if frame_rate is not None and not 0 < frame_rate <= _HIGHEST_RATE:
        raise InputError(f"--frame-rate is {frame_rate:g}; expected frames per second, above 0.")
    motion = read_motion(path, person=choices.person, decode=vposer_decoder())
    body, motion = posed_body(motion, Bodies(models), choices)
    rate = frame_rate or motion.frame_rate
    places, missing = _without_gaps(motion.numbers)
    notes = (f"Read as {motion.format}.", *motion.notes, *_standing_in(missing))
    params = motion.on(body, motion.camera or ANY_CAMERA)
    return EvaluatedFit(
        name=path.resolve().name if path.is_dir() else path.stem,
        source=str(path),
        body=body,
        phases={motion.format: (params[places], 0.0)},
        camera=motion.camera,
        frame_rate=rate or _USUAL_RATE,
        rate_known=rate is not None,
        first_frame=motion.numbers[0] if motion.numbered else 0,
        clip=None,
        placed=motion.placed,
        notes=notes,
    )


def _standing_in(missing: list[int]) -> tuple[str, ...]:
    """A note on frames without a result."""
    if not missing:
        return ()
    return (f"It has no result for {len(missing)} frames ({spans(missing)}); the nearest frames stand in for them.",)


def _without_gaps(numbers: Sequence[int]) -> tuple[list[int], list[int]]:
    """For each frame from the first to the last, the place of the nearest that exists; and which frames are missing."""
    there = np.array(numbers)
    if there[-1] - there[0] >= _MOST_FRAMES:
        raise InputError(
            f"has frames {there[0]} to {there[-1]}; expected those of one clip, fewer than {_MOST_FRAMES}."
        )
    wanted = np.arange(there[0], there[-1] + 1)
    after = np.searchsorted(there, wanted).clip(1, len(there) - 1) if len(there) > 1 else np.zeros(len(wanted), int)
    nearer = np.abs(there[after] - wanted) < np.abs(there[after - 1] - wanted)
    return np.where(nearer, after, (after - 1).clip(0)).tolist(), wanted[~np.isin(wanted, there)].tolist()


def _chosen(project: Project, wanted: str | None) -> Run:
    runs = [run for run in project.runs.all() if run.stored]
    if not runs:
        raise InputError(f"{project.folder}: has no fit yet. Fit it with `tcfit review`.")
    return newest(runs) if wanted is None else named(runs, wanted)


def _of_project(project: Project, run: Run, models: Path | None) -> EvaluatedFit:
    fit, body = project.runs.load(run.id), Bodies(models).of(run.body)
    found = of_run(fit, project.clip, body, name=run.name, folder=project.folder, reference=project.reference)
    missing = np.flatnonzero(~fit.observed.any(1)).tolist() if run.kind == "imported" else []
    return replace(found, notes=(*found.notes, *_standing_in([project.clip.first_frame + t for t in missing])))


def of_run(
    fit: FitResult, clip: Clip, body: BodyModel, *, name: str, folder: Path, reference: Reference | None
) -> EvaluatedFit:
    """A run of a project, with its first and its last phase."""
    seconds = [sum(p.seconds for p in fit.phases if p.phase <= phase.phase) for phase in fit.phases]
    phases = {FIRST: (fit.phases[0].params, seconds[0])} if fit.phases[0].phase == 1 else {}
    if fit.last.phase > 1:
        phases[FINAL] = (fit.last.params, seconds[-1])
    return EvaluatedFit(
        name=f"{clip.name}, {name}",
        source=f"{folder}, {name}",
        body=body,
        phases=phases,
        camera=fit.camera,
        frame_rate=clip.frame_rate,
        first_frame=clip.first_frame,
        clip=clip,
        reference=reference,
    )
