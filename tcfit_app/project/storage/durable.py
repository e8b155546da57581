"""Files that are whole and on the disk once written, whatever happens to the computer afterwards."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing

_DRAFTS = ".*.partial*"


@contextmanager
def durable(path: Path) -> Iterator[Path]:
    """A file to write, as `replacing` gives it; when the block has ended, it is on the disk under its name."""
    with replacing(path) as draft:
        yield draft
        sync(draft)
    sync(path.parent)


def sync(path: Path) -> None:
    """Have a file's content, or a folder's list of names, on the disk."""
    if path.is_dir() and sys.platform == "win32":
        return  # Windows opens no folders, and keeps names by itself.
    descriptor = os.open(path, os.O_RDWR if path.is_file() else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sweep(folder: Path) -> None:
    """Delete what was not finished when a process died."""
    for draft in folder.glob(_DRAFTS):
        if draft.is_file():
            draft.unlink(missing_ok=True)


@contextmanager
def accessing(path: Path) -> Iterator[None]:
    """What the system refuses becomes an InputError that names the file or folder."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read or written ({error.strerror or error}). Free space, or allow reading and writing "
            "there; what was stored before is still there."
        ) from error
