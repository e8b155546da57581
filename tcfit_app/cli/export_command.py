"""`tcfit export`: a project's run, or a result, as files for other programs."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import torch
from tqdm import tqdm

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.io.motion.fitted_motion import Progress
from fitting_core.io.motion_files import stored_motion
from fitting_core.io.result_files import FIT_NAME, SUMMARY_NAME, read_fit
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.cli.json_lines import Step, StepDone, emit, emit_wrote, told
from tcfit_app.exports.exporting import file_name, write_export
from tcfit_app.exports.source import ExportedFit, ExportSource
from tcfit_app.exports.table import DEFAULTS, Export, exports
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.fits import FitChoice, Fits
from tcfit_app.options.export import ExportOptions
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import is_project
from tcfit_app.project.storage.run_record import BodyRecord, named

_LIST = "list"


def run_export(options: ExportOptions) -> None:
    """Write what the options ask for, and say on the standard output what was written.

    Raises:
        InputError: The options name something that is not there, or that cannot be written.
        KeyboardInterrupt: Cancelled; files that were whole by then stay.
    """
    if options.formats == (_LIST,):
        print(listed())
        return
    torch.set_num_threads(1)
    formats = _formats(options.formats)
    if options.path is None:
        raise InputError("tcfit export: no path given; expected a project's folder, or a result of tcfit fit.")
    with source_of(options.path, options) as source:
        whole = source if options.frames is None else source[frames_of(options.frames, source)]
        targets = {name: _target(name, whole, options) for name in formats}
        for name, path in targets.items():
            emit(Step(step=name, title=exports()[name].title))
            _write(exports()[name], whole, path, told(name), zipped=options.zip)
            emit(StepDone(step=name))
            emit_wrote(path, kind=name)


def listed() -> str:
    """All formats, for the user."""
    lines = [f"{'format':14}{'':8}what"]
    for name, export in exports().items():
        lines.append(f"{name:14}{'folder' if export.many else '':8}{export.title}: {export.hint}")
    return "\n".join(lines)


def _formats(wished: tuple[str, ...]) -> tuple[str, ...]:
    known = exports()
    unknown = [name for name in wished if name not in known]
    if unknown:
        raise InputError(f"--formats {' '.join(unknown)}: not known; expected some of {', '.join(known)}.")
    return tuple(dict.fromkeys(wished or DEFAULTS))


@contextmanager
def source_of(path: Path, options: ExportOptions) -> Iterator[ExportSource]:
    """What there is to export at a path, with the run, the phase and the body models of the options.

    Raises:
        InputError: There is neither a project nor a result, or it lacks what the options name.
    """
    if is_project(path):
        with Project.open(path, read_only=True) as project:
            yield _of_project(project, options)
    elif (path / FIT_NAME).is_file() or path.is_file():
        yield _of_result(path, options)
    else:
        raise InputError(
            f"{path}: is neither a project nor a result: it has no project.sqlite and no {FIT_NAME}. "
            "Give the folder that tcfit new or tcfit fit made."
        )


# --- a project ---


def _of_project(project: Project, options: ExportOptions) -> ExportSource:
    clip, bodies, fits = project.clip, Bodies(options.models), Fits(project)
    chosen = _exported(fits, bodies, options.run, options.phase)
    if chosen is None and (options.run or options.phase):
        raise InputError(f"{project.folder}: has no run with a result yet. Fit it first: tcfit review {project.folder}")
    other = None
    if chosen is not None:
        other = _exported(fits, bodies, options.against or str(chosen.shown.run.id), None if options.against else 1)
    return ExportSource(
        name=clip.name,
        chosen=chosen,
        compared=[fit for fit in (other, chosen) if fit is not None],
        known_clip=clip,
        project=project.folder,
        axes=options.axes,
    )


def _exported(fits: Fits, bodies: Bodies, name: str | None, phase: int | None) -> ExportedFit | None:
    run = None if name is None else named(fits.showable(), name)
    shown = fits.show(FitChoice(run=None if run is None else run.id, phase=phase))
    if shown is None:
        return None
    if phase is not None and shown.phase != phase:
        there = ", ".join(map(str, fits.phases(shown.run)))
        raise InputError(f"--phase {phase}: {shown.run.name} has none; it has {there}.")
    return ExportedFit(shown=shown, fit=fits.fit(shown.run), meshes=Meshes(bodies.of(shown.run.body)))


# --- a result of tcfit fit ---


def _of_result(path: Path, options: ExportOptions) -> ExportSource:
    if options.run is not None or options.against is not None:
        raise InputError(f"{path}: is a result of one fit and not a project: leave out --run and --against.")
    stored = read_fit(path)
    name = _clip_name(path)
    body = Bodies(options.models).of(BodyRecord(kind=stored.body_kind, gender=stored.gender, hash=stored.body_hash))
    motion = stored_motion(stored, body, name=name, phase=options.phase)
    return ExportSource(name=name, known_motion=motion, axes=options.axes)


def _clip_name(path: Path) -> str:
    """The clip's, which the summary knows; else the folder's."""
    folder = path if path.is_dir() else path.parent
    try:
        name = msgspec.json.decode(regular_file(folder / SUMMARY_NAME).read_bytes())["clip"]
    except (OSError, KeyError, TypeError, ValueError):
        name = ""
    return name if isinstance(name, str) and name else folder.resolve().name


# --- frames and files ---


def frames_of(wished: str, source: ExportSource) -> slice:
    """Frames by their numbers in the video, both ends included."""
    motion = source.known_motion
    first = motion.first_frame if motion is not None else source.clip.first_frame
    count = len(motion) if motion is not None else len(source.clip)
    last = first + count - 1
    start, colon, stop = wished.partition(":")
    try:
        begin = int(start) if start else first
        end = (int(stop) if stop else last) if colon else begin
    except ValueError:
        raise InputError(f"--frames {wished}: expected FIRST:LAST, two numbers of frames.") from None
    if not first <= begin <= end <= last:
        raise InputError(f"--frames {wished}: expected frames from {first} to {last}, the first not behind the last.")
    return slice(begin - first, end - first + 1)


def _target(name: str, source: ExportSource, options: ExportOptions) -> Path:
    """Where an export goes; raises InputError where it cannot be made or would replace something."""
    export = exports()[name]
    if source.known_motion is not None and export.needs != "motion":
        raise InputError(
            f"--formats {name}: {source.name} is a result of tcfit fit, which has neither keypoints nor video. Give a "
            "project instead: tcfit new makes one."
        )
    if source.known_motion is None and export.needs != "keypoints":
        source.fit  # noqa: B018 - told before anything is written
    path = options.out / file_name(export, source.name, zipped=options.zip)
    if path.exists() and not options.overwrite:
        raise InputError(f"{path}: is there already. Give --overwrite to replace it, or another --out.")
    return path


def _write(export: Export, source: ExportSource, path: Path, tell: Progress, *, zipped: bool) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with bar(export.title, tell) as progress:
            write_export(export, source, path, progress, zipped=zipped)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}). Free space, or choose another --out."
        ) from error
    print(f"Wrote {path}", flush=True)


@contextmanager
def bar(title: str, tell: Progress) -> Iterator[Progress]:
    """A bar on a terminal; what it yields takes shares, moves the bar, and hands them to `tell`."""
    form = "{desc} {percentage:3.0f} % |{bar}| {elapsed} < {remaining}"
    with tqdm(total=1.0, desc=f"{title:26}", bar_format=form, file=sys.stderr, disable=None, leave=False) as shown:

        def advance(share: float) -> None:
            shown.update(share - shown.n)
            tell(share)

        yield advance
