"""File system errors in words for users, and folders of new projects."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fitting_core.errors import InputError, some_of
from fitting_core.files.atomic import drafting, put_folder
from fitting_core.io.people_file import holds_people
from tcfit_app.project.storage import database


@contextmanager
def accessing(path: Path) -> Iterator[None]:
    """Turns file system errors into an InputError naming the file or folder."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read or written ({error.strerror or error}). Free space, or allow reading and writing "
            "there; what was stored before is still there."
        ) from error


@contextmanager
def creating(folder: Path) -> Iterator[Path]:
    """The draft of a new project's folder, which takes its place when the block ends well. Raises InputError if the
    folder is not empty or cannot be written; nothing is left there then."""
    with accessing(folder):
        check_free(folder)
        folder.parent.mkdir(parents=True, exist_ok=True)
        with drafting(folder) as draft:
            draft.mkdir()
            yield draft
            check_free(folder)
            if folder.exists():
                folder.rmdir()
            put_folder(draft, folder)


def check_free(folder: Path) -> None:
    """Raises InputError if no project can be created in a folder, which need not exist."""
    if (folder / database.NAME).exists():
        raise InputError(f"{folder}: is already a project. Open it, or choose another folder.")
    if holds_people(folder):
        raise InputError(f"{folder}: is already a folder of several people. Open it, or choose another one.")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; expected a folder, which need not exist.")
    if names := sorted(entry.name for entry in folder.iterdir()) if folder.exists() else []:
        raise InputError(
            f"{folder}: contains other files ({some_of(names, most=4)}). Choose a folder that is empty or new."
        )
