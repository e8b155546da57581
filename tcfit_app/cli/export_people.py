"""`tcfit export` of a folder of several people: each person's files beside each other, and all in one GLB."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

from fitting_core.errors import InputError
from fitting_core.io.people_file import PEOPLE_NAME, People, read_people_file
from tcfit_app.cli.export_command import opened, write_one
from tcfit_app.exports.exporting import write_export
from tcfit_app.exports.from_path import formats_of, numbers_of, target
from tcfit_app.exports.motions import write_everybody
from tcfit_app.exports.source import ExportSource
from tcfit_app.exports.table import exports
from tcfit_app.options.export import ExportOptions

_TOGETHER = "glb"
"""The format that holds several people."""


def run_export_people(folder: Path, options: ExportOptions) -> None:
    """Write the selected exports of all people, and list the files on standard output. Raises InputError as
    `run_export` does, or if no person is in the selected frames."""
    torch.set_num_threads(1)
    formats = formats_of(options.formats)
    people = read_people_file(folder)
    with ExitStack() as stack:
        sources = _sources(folder, people, options, stack)
        apart = [name for name in formats if name != _TOGETHER]
        targets = [(name, source, target(name, source, options)) for source in sources for name in apart]
        _refuse_same([path for _, _, path in targets], folder)
        # One file, whose name is the clip's; what can be found wrong with anybody is found now.
        checked = sources if _TOGETHER in formats else []
        together = [target(_TOGETHER, replace(source, name=people.name), options) for source in checked]
        for name, source, path in targets:
            write_one(name, path, partial(write_export, exports()[name], source, path, zipped=options.zip))
        if together:
            write_one(_TOGETHER, together[0], partial(write_everybody, sources, together[0], name=people.name))


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
        source = stack.enter_context(opened(folder / person.folder, options))
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
