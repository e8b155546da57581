"""Writing exports: files that appear whole or not at all."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.files.atomic import drafting, put_folder, replacing, scratch_folder
from fitting_core.motion import Progress
from tcfit_app.exports.source import ExportSource
from tcfit_app.exports.table import Export
from tcfit_app.project.storage import names

_ZIPPING = 0.15
"""Share of the whole time that packing takes."""


def file_name(export: Export, name: str, *, zipped: bool) -> str:
    """The file name of a clip's export; `zipped` makes a folder one file."""
    return names.file_name(name, export.suffix + ".zip" * (export.many and zipped))


def write_export(export: Export, source: ExportSource, path: Path, progress: Progress, *, zipped: bool) -> str | None:
    """Write an export, atomically; return a note for the user.

    The file or folder is replaced; `zipped` packs a folder into one file.

    Raises:
        InputError: There is nothing to export, a requirement is missing, or the folder holds files that would be lost.
        OSError: It cannot be written.
    """
    path = path.absolute()  # a plugin may go to another folder
    progress(0.0)
    if not export.many:
        with replacing(path) as draft:
            note = export.write(source, draft, progress)
    elif not zipped:
        with _replacing_folder(path) as folder:
            note = export.write(source, folder, progress)
    else:
        with replacing(path) as draft:
            folder = draft.with_name(f"{draft.name}.files")
            folder.mkdir()
            note = export.write(source, folder, lambda share: progress((1 - _ZIPPING) * share))
            _zip(folder, draft, lambda share: progress(1 - _ZIPPING + _ZIPPING * share))
    progress(1.0)
    return note


@contextmanager
def _replacing_folder(path: Path) -> Iterator[Path]:
    """A new folder beside `path`, which replaces it if the block succeeds and vanishes if it fails. Raises InputError
    if what is at `path` is a file, or holds files that the new folder does not."""
    path = path.resolve()  # where a link leads
    with drafting(path) as draft:
        draft.mkdir()
        yield draft
        if path.exists():
            _check_replaced(path, draft)
        put_folder(draft, path)


def _check_replaced(path: Path, draft: Path) -> None:
    if not path.is_dir():
        raise InputError(f"{path}: is a file; expected a folder, or nothing there. Remove it, or give another --out.")
    new, there = ({file.relative_to(folder) for file in folder.rglob("*")} for folder in (draft, path))
    if others := sorted(there - new):
        raise InputError(
            f"{path}: holds {len(others)} files that this export does not replace, such as {others[0]}; expected files "
            "of the same names only. Move or remove them, or give another --out."
        )


def _zip(folder: Path, path: Path, progress: Progress) -> None:
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=3) as archive:
        for done, file in enumerate(files, 1):
            archive.write(file, file.relative_to(folder).as_posix())
            progress(done / len(files))


def content_of(export: Export, source: ExportSource, progress: Progress) -> tuple[bytes, str | None]:
    """The content of an export as one file, which is not kept on disk, and a note for the user.

    As `write_export`.
    """
    with scratch_folder() as folder:
        path = folder / f"export{export.suffix}"
        note = write_export(export, source, path, progress, zipped=True)
        return path.read_bytes(), note
