"""Exports of a path: their source and target files, for `tcfit export` and the list of clips."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.io.motion_files import stored_motion
from fitting_core.io.people_file import refuse_several
from fitting_core.io.result_files import FIT_NAME, SUMMARY_NAME, read_fit, video_of
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.exports.exporting import file_name
from tcfit_app.exports.source import ExportedFit, ExportSource
from tcfit_app.exports.table import DEFAULTS, REMOVED, exports
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.fits import FitChoice, Fits
from tcfit_app.options.export import ExportOptions
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import is_project
from tcfit_app.project.storage.run_record import BodyRecord, named


def formats_of(wished: tuple[str, ...]) -> tuple[str, ...]:
    """The names of the requested exports. Raises InputError if one is unknown."""
    known = exports()
    for name in wished:
        if instead := REMOVED.get(name):
            raise InputError(f"--formats {name}: was removed. {instead}")
    unknown = [name for name in wished if name not in known]
    if unknown:
        raise InputError(f"--formats {' '.join(unknown)}: not known; expected some of {', '.join(known)}.")
    return tuple(dict.fromkeys(wished or DEFAULTS))


@contextmanager
def source_of(path: Path, options: ExportOptions) -> Iterator[ExportSource]:
    """The project or result at a path, with the run, phase and body models of the options. Raises InputError if there
    is neither, or if it lacks what the options name."""
    if is_project(path):
        with Project.open(path, read_only=True) as project:
            yield _of_project(project, options)
    elif (path / FIT_NAME).is_file() or path.is_file():
        yield _of_result(path, options)
    else:
        refuse_several(path)
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
        views=options.view,
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
    return ExportSource(
        name=name,
        known_motion=motion,
        known_grounding=stored.grounding,
        axes=options.axes,
        known_video=video_of(path if path.is_dir() else path.parent),
        views=options.view,
        notes=stored.notes,
    )


def _clip_name(path: Path) -> str:
    """The clip's name from the summary, otherwise the folder's."""
    folder = path if path.is_dir() else path.parent
    try:
        name = msgspec.json.decode(regular_file(folder / SUMMARY_NAME).read_bytes())["clip"]
    except (OSError, KeyError, TypeError, ValueError):
        name = ""
    return name if isinstance(name, str) and name else folder.resolve().name


# --- frames and files ---


def frame_range(given: str, source: ExportSource) -> slice:
    """A frame range given by numbers in the video, both ends included."""
    begin, end = numbers_of(given)
    first, last = source.span
    begin, end = first if begin is None else begin, last if end is None else end
    if not first <= begin <= end <= last:
        raise InputError(f"--frames {given}: expected frames from {first} to {last}, the first not behind the last.")
    return slice(begin - first, end - first + 1)


def numbers_of(wished: str) -> tuple[int | None, int | None]:
    """The first and last frame; None if left out."""
    start, colon, stop = wished.partition(":")
    try:
        begin = int(start) if start else None
        return begin, ((int(stop) if stop else None) if colon else begin)
    except ValueError:
        raise InputError(f"--frames {wished}: expected FIRST:LAST, two numbers of frames.") from None


def target(name: str, source: ExportSource, options: ExportOptions) -> Path:
    """The target of an export. Raises InputError if it cannot be made or would replace something."""
    export = exports()[name]
    if source.known_motion is not None and export.needs != "motion":
        raise InputError(
            f"--formats {name}: {source.name} is a result of tcfit fit, which has neither keypoints nor video. Give a "
            "project instead: tcfit new makes one."
        )
    if reason := export.missing():
        raise InputError(f"--formats {name}: {reason}")
    if source.known_motion is None and export.needs != "keypoints":
        source.fit  # noqa: B018 - raises before anything is written
    path = options.out / file_name(export, source.name, zipped=False)
    if path.exists() and not options.overwrite:
        raise InputError(f"{path}: already exists. Give --overwrite to replace it, or another --out.")
    return path
