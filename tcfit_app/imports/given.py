"""What a fit is given besides its clip, read from the user's choice: a start, a shape."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fitting_core.body.files.former import same_shapes
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.io.known_shape import read_known_shape
from fitting_core.results.fit_result import FitResult
from fitting_core.results.given_start import GivenStart, KnownShape
from fitting_core.starts.reading import read_start, start_from_fit
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.imports.results import vposer_decoder
from tcfit_app.options.fit import StartOptions
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import is_project
from tcfit_app.project.storage.run_record import Given, Run, Source, newest


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownInputs:
    """What was read."""

    given: Given = field(default_factory=Given)
    """What was chosen."""
    start: GivenStart | None = None
    shape: KnownShape | None = None


NOTHING = KnownInputs()
"""For a fit that is given only its clip."""


def read_given(given: Given, project: Project, clip: Clip, body: BodyModel, bodies: Bodies) -> KnownInputs:
    """Read the user's choice for a fit of `clip` with `body`. Slow. Raises InputError if something is missing, cannot
    be read, or does not suit this clip and body."""
    start = None if given.start is None else _start(given.start, project, clip, body, bodies)
    shape = None if given.shape is None else _shape(given.shape, project, body)
    return KnownInputs(given=given, start=start, shape=shape)


def _start(source: Source, project: Project, clip: Clip, body: BodyModel, bodies: Bodies) -> GivenStart:
    if source.run is None:
        options = StartOptions(
            start=Path(source.path), start_person=source.person, start_first_frame=source.first_frame
        )
        found = start_of(options, clip, body, bodies)
        assert found is not None
        return found
    run, fit = _loaded(project, source.run)
    imported = run.kind == "imported"
    return start_from_fit(
        fit.last.params,
        bodies.of(run.body),
        fit.camera,
        clip,
        body,
        name=run.name,
        format=fit.pose_prior if imported else "a fit of tcfit",
        there=np.asarray(fit.observed.any(1)) if imported else None,
        placed=run.summary.get("placed", True),
    )


def _shape(source: Source, project: Project, body: BodyModel) -> KnownShape:
    if source.run is None:
        return read_shape(Path(source.path), body)
    run, fit = _loaded(project, source.run)
    return KnownShape(betas=_betas(run, fit, body), source=run.name)


def start_of(options: StartOptions, clip: Clip, body: BodyModel, bodies: Bodies) -> GivenStart | None:
    """The start selected by the options, if any. The result's own body may be among `bodies`. Raises
    InputError if it cannot be read, has nothing for this clip, or no person in it matches the keypoints; or there are
    other start options without a start."""
    if options.start is None:
        said = {"--start-person": options.start_person, "--start-first-frame": options.start_first_frame}
        if named := [name for name, value in said.items() if value is not None]:
            raise InputError(f"{' and '.join(named)} without --start: name the result with --start.")
        return None

    def found(kind: str, gender: str) -> BodyModel | None:
        try:
            return bodies.find(kind=kind, gender=gender)
        except InputError:  # without it, the fitted body's joints are used
            return None

    return read_start(
        options.start,
        clip,
        body,
        person=options.start_person,
        first_frame=options.start_first_frame,
        find_body=found,
        decode=vposer_decoder(),
    )


def read_shape(path: Path, body: BodyModel) -> KnownShape:
    """A person's shape from a project's newest fit, or from what `read_known_shape` reads. Raises InputError if it does
    not exist, has no shape, or one for another body."""
    if not is_project(path):
        return read_known_shape(path, body_hash=body.hash)
    with Project.open(path, read_only=True) as project:
        runs = [run for run in project.runs.all() if run.stored]
        if not runs:
            raise InputError(f"{path}: has no fit yet, and so no shape. Fit it first, or choose another.")
        run = newest(runs)
        try:
            return KnownShape(betas=_betas(run, project.runs.load(run.id), body), source=path.name)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


def _loaded(project: Project, number: int) -> tuple[Run, FitResult]:
    run = project.runs.get(number)
    if not run.stored:
        raise InputError(f"{run.name} has no result yet: wait for it, or choose another run.")
    return run, project.runs.load(number)


def _betas(run: Run, fit: FitResult, body: BodyModel) -> Float[np.ndarray, "10"]:
    if not same_shapes(run.body.hash, body.hash):
        raise InputError(
            f"{run.name} uses another body model ({run.body.kind}, {run.body.gender}), for which betas mean another "
            "shape. Choose that body model for this fit too, or another run."
        )
    if run.kind != "imported" and fit.last.phase < 2:
        raise InputError(f"{run.name} has no shape for the whole clip yet: wait until its first pass has finished.")
    known = fit.observed.any(1) if run.kind == "imported" else np.ones(len(fit.observed), bool)
    betas = np.median(fit.last.params.betas.double().numpy()[known], axis=0) if known.any() else np.zeros(1)
    if not betas.any():
        raise InputError(f"{run.name} has no shape: its betas are all zero, the mean person's. Choose another.")
    return betas
