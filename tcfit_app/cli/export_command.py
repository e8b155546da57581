"""`tcfit export`: a project's run, or a result, as files for other programs."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch
from tqdm import tqdm

from fitting_core.body.markers.files import read_marker_set
from fitting_core.body.markers.marker_set import STANDARD
from fitting_core.errors import InputError, printable
from fitting_core.motion import Progress
from tcfit_app.cli.json_lines import Note, Step, StepDone, emit, emit_wrote, told
from tcfit_app.exports.exporting import write_export
from tcfit_app.exports.from_path import formats_of, source_of, target, wished_frames
from tcfit_app.exports.source import ExportSource
from tcfit_app.exports.table import exports
from tcfit_app.options.export import LIST, ExportOptions


def run_export(options: ExportOptions) -> None:
    """Write what the options ask for, and say on the standard output what was written.

    Raises:
        InputError: The options name something that is not there, or that cannot be written.
        KeyboardInterrupt: Cancelled; files that were whole by then stay.
    """
    if options.formats == (LIST,):
        print(listed())
        return
    torch.set_num_threads(1)
    formats = formats_of(options.formats)
    if options.path is None:
        raise InputError("tcfit export: no path given; expected a project's folder, or a result of tcfit fit.")
    markers = STANDARD if options.markers is None else read_marker_set(options.markers)
    with opened(options.path, options) as found:
        source = replace(found, markers=markers)
        whole = source if options.frames is None else source[wished_frames(options.frames, source)]
        targets = {name: target(name, whole, options) for name in formats}
        for name, path in targets.items():
            write_one(name, path, partial(write_export, exports()[name], whole, path, zipped=options.zip))


@contextmanager
def opened(path: Path, options: ExportOptions) -> Iterator[ExportSource]:
    """What there is to export, as `source_of`; what its user should know of it is said."""
    with source_of(path, options) as source:
        for note in source.notes:
            emit(Note(text=note))
            print(printable(f"Note: {note}"), file=sys.stderr, flush=True)
        yield source


def write_one(name: str, path: Path, write: Callable[[Progress], str | None]) -> None:
    """Write one export, and say so.

    Args:
        name: Of EXPORTS.
        path: Where to; its folder is made.
        write: Writes it, and returns what a person should know of it.
    """
    emit(Step(step=name, title=exports()[name].title))
    folder = path.parent.absolute()
    new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with bar(exports()[name].title, told(name)) as progress:
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


def listed() -> str:
    """All formats, for the user."""
    lines = [f"{'format':14}{'':8}what"]
    for name, export in exports().items():
        lines.append(f"{name:14}{'folder' if export.many else '':8}{export.title}: {export.hint}")
    return "\n".join(lines)


@contextmanager
def bar(title: str, tell: Progress) -> Iterator[Progress]:
    """A bar on a terminal; what it yields takes shares, moves the bar, and hands them to `tell`."""
    form = "{desc} {percentage:3.0f} % |{bar}| {elapsed} < {remaining}"
    with tqdm(total=1.0, desc=f"{title:26}", bar_format=form, file=sys.stderr, disable=None, leave=False) as shown:

        def advance(share: float) -> None:
            shown.update(share - shown.n)
            tell(share)

        yield advance
