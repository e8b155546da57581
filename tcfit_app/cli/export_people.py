"""`tcfit export` of a folder of several people: each person's files beside each other, and all in one GLB."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import torch

from fitting_core.errors import InputError
from fitting_core.io.people_file import PEOPLE_NAME, People, read_people
from tcfit_app.cli.export_command import bar, formats_of, numbers_of, source_of, target, write_one
from tcfit_app.cli.json_lines import Step, StepDone, emit, emit_wrote, told
from tcfit_app.exports.exporting import file_name
from tcfit_app.exports.motions import write_everybody
from tcfit_app.exports.source import ExportSource
from tcfit_app.exports.table import exports
from tcfit_app.options.export import ExportOptions

_TOGETHER = "glb"
"""The format that holds several people."""


def run_export_people(folder: Path, options: ExportOptions) -> None:
    """Write what the options ask for of everybody, and say on the standard output what was written.

    Args:
        folder: With people.json, of results or of projects.
        options: The command line.

    Raises:
        InputError: As of `run_export`; or nobody is there in the frames that are asked for.
    """
    torch.set_num_threads(1)
    formats = formats_of(options.formats)
    people = read_people(folder)
    with ExitStack() as stack:
        sources = _sources(folder, people, options, stack)
        apart = [name for name in formats if name != _TOGETHER]
        targets = [(name, source, target(name, source, options)) for source in sources for name in apart]
        _refuse_same([path for _, _, path in targets], folder)
        together = _together(people, sources, options) if _TOGETHER in formats else None
        for name, source, path in targets:
            write_one(name, source, path, zipped=options.zip)
        if together is not None:
            _write_glb(together, people, sources)


def _refuse_same(paths: Sequence[Path], folder: Path) -> None:
    """Raise InputError where one person's file would replace another's: names in files have fewer characters."""
    names = [path.name.casefold() for path in paths]
    if twice := next((path for path in paths if names.count(path.name.casefold()) > 1), None):
        raise InputError(f"{twice}: would be the file of two people. Give them other names in {folder / PEOPLE_NAME}.")


def _sources(folder: Path, people: People, options: ExportOptions, stack: ExitStack) -> list[ExportSource]:
    """What there is of each person in the wished frames; who is not there then is left out."""
    begin, end = (None, None) if options.frames is None else numbers_of(options.frames)
    found: list[ExportSource] = []
    for person in people.people:
        if not (folder / person.folder).is_dir():
            raise InputError(
                f"{folder / person.folder}: is not there. Put it back, or take {person.name} out of {PEOPLE_NAME}."
            )
        source = stack.enter_context(source_of(folder / person.folder, options))
        if (part := source.between(begin, end)) is not None:
            found.append(replace(part, name=f"{people.name} {person.name}"))
    if not found:
        first = min(person.frames[0] for person in people.people)
        last = max(person.frames[1] for person in people.people)
        raise InputError(
            f"--frames {options.frames}: nobody is there; expected frames from {first} to {last}, the first not behind "
            "the last."
        )
    return found


def _together(people: People, sources: Sequence[ExportSource], options: ExportOptions) -> Path:
    """Where everybody goes; what can be found wrong is found now."""
    for source in sources:
        target(_TOGETHER, source, options)
    path = options.out / file_name(exports()[_TOGETHER], people.name, zipped=options.zip)
    if path.exists() and not options.overwrite:
        raise InputError(f"{path}: is there already. Give --overwrite to replace it, or another --out.")
    return path


def _write_glb(path: Path, people: People, sources: Sequence[ExportSource]) -> None:
    title = exports()[_TOGETHER].title
    emit(Step(step=_TOGETHER, title=title))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with bar(title, told(_TOGETHER)) as progress:
            note = write_everybody(sources, path, progress, name=people.name)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}). Free space, or choose another --out."
        ) from error
    emit(StepDone(step=_TOGETHER))
    emit_wrote(path, kind=_TOGETHER)
    print(f"Wrote {path}: {note}", flush=True)
