"""`tcfit export`: a project's run, a result, or a folder of several people, as files for other programs."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

from fitting_core.body.markers.marker_set import STANDARD, read_marker_set
from fitting_core.errors import InputError, printable
from fitting_core.io.people_file import PEOPLE_NAME, People, holds_people, read_people_file
from fitting_core.motion import Progress
from tcfit_app.cli.json_lines import Note, Step, StepDone, emit, emit_wrote
from tcfit_app.cli.progress import bar
from tcfit_app.exports.exporting import write_export
from tcfit_app.exports.from_path import formats_of, frame_range, numbers_of, source_of, target
from tcfit_app.exports.motions import write_all_people
from tcfit_app.exports.source import ExportSource
from tcfit_app.exports.table import exports
from tcfit_app.options.export import LIST, ExportOptions


def run_export(options: ExportOptions) -> None:
    """Write the requested files, and list them on standard output.

    Raises:
        InputError: Something that the options name is missing, or cannot be written.
        KeyboardInterrupt: Cancelled; completed files stay.
    """
    if options.formats == (LIST,):
        print(_listed())
        return
    torch.set_num_threads(1)
    formats = formats_of(options.formats)
    if options.path is None:
        raise InputError("tcfit export: no path given; expected a project's folder, or a result of tcfit fit.")
    if holds_people(options.path):
        _export_people(options.path, formats, options)
        return
    markers = STANDARD if options.markers is None else read_marker_set(options.markers)
    with _opened(options.path, options) as found:
        source = replace(found, markers=markers)
        whole = source if options.frames is None else source[frame_range(options.frames, source)]
        targets = {name: target(name, whole, options) for name in formats}
        for name, path in targets.items():
            _write_one(name, path, partial(write_export, exports()[name], whole, path, zipped=False))


@contextmanager
def _opened(path: Path, options: ExportOptions) -> Iterator[ExportSource]:
    """The source at a path, as of `source_of`; print its notes."""
    with source_of(path, options) as source:
        for note in source.notes:
            emit(Note(text=note))
            print(printable(f"Note: {note}"), file=sys.stderr, flush=True)
        yield source


def _write_one(name: str, path: Path, write: Callable[[Progress], str | None]) -> None:
    """Write one export, and report it.

    Args:
        name: Of EXPORTS.
        path: The target; its folder is made.
        write: Writes it, and returns a note for the user.
    """
    emit(Step(step=name, title=exports()[name].title))
    folder = path.parent.absolute()
    new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with bar(exports()[name].title, name) as progress:
            note = write(progress)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}). Free space, or choose another --out."
        ) from error
    finally:
        if new:
            with suppress(OSError):  # it holds what was written
                folder.rmdir()
    print(printable(f"Wrote {path}" + (f": {note}" if note else "")), flush=True)
    if note:
        emit(Note(text=f"{path.name}: {note}"))
    emit(StepDone(step=name))
    emit_wrote(path, kind=name)


def _listed() -> str:
    """All formats, for the user."""
    lines = [f"{'format':14}{'':8}what"]
    for name, export in exports().items():
        lines.append(f"{name:14}{'folder' if export.many else '':8}{export.title}: {export.hint}")
    return "\n".join(lines)


# --- a folder of several people ---

_TOGETHER = "glb"
"""The format that holds several people."""


def _export_people(folder: Path, formats: Sequence[str], options: ExportOptions) -> None:
    """Write each person's files beside each other, and all people in one GLB. Raises InputError if no person is in the
    selected frames."""
    people = read_people_file(folder)
    with ExitStack() as stack:
        sources = _sources(folder, people, options, stack)
        apart = [name for name in formats if name != _TOGETHER]
        targets = [(name, source, target(name, source, options)) for source in sources for name in apart]
        _refuse_same([path for _, _, path in targets], folder)
        # One file, named after the clip; every person is checked before anything is written.
        checked = sources if _TOGETHER in formats else []
        together = [target(_TOGETHER, replace(source, name=people.name), options) for source in checked]
        for name, source, path in targets:
            _write_one(name, path, partial(write_export, exports()[name], source, path, zipped=False))
        if together:
            _write_one(_TOGETHER, together[0], partial(write_all_people, sources, together[0], name=people.name))


def _refuse_same(paths: Sequence[Path], folder: Path) -> None:
    """Raise InputError if two people's files would have the same name: file names allow fewer characters."""
    names = [path.name.casefold() for path in paths]
    if twice := next((path for path in paths if names.count(path.name.casefold()) > 1), None):
        raise InputError(f"{twice}: would be the file of two people. Give them other names in {folder / PEOPLE_NAME}.")


def _sources(folder: Path, people: People, options: ExportOptions, stack: ExitStack) -> list[ExportSource]:
    """The sources of all people in the requested frames; absent people are left out."""
    begin, end = (None, None) if options.frames is None else numbers_of(options.frames)
    found: list[ExportSource] = []
    for person in people.people:
        if not (folder / person.folder).is_dir():
            raise InputError(
                f"{folder / person.folder}: is missing. Restore it, or remove {person.name} from {PEOPLE_NAME}."
            )
        source = stack.enter_context(_opened(folder / person.folder, options))
        if (part := source.between(begin, end)) is not None:
            found.append(replace(part, name=f"{people.name} {person.name}"))
    if not found:
        first = min(person.frames[0] for person in people.people)
        last = max(person.frames[1] for person in people.people)
        raise InputError(
            f"--frames {options.frames}: no person is visible; expected frames from {first} to {last}, the first not "
            "behind the last."
        )
    return found
