"""Files and folders that appear whole or not at all, and survive a crash of the process or the computer.

Drafts are in a hidden folder beside their target, locked by the writing process. The system releases the lock of a
process that dies, so the next writer to the same target finds the folder unlocked and empties it.
"""

import errno
import hashlib
import itertools
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fitting_core.files.locking import locked

LONGEST = 255
"""Bytes that a file's name may have: Linux and macOS; Windows counts UTF-16 units, which are fewer."""
_SUFFIX = ".partial"
_LOCK, _REPLACED = "tcfit-draft.lock", "replaced"
"""In a hidden folder: who has that locked may write there, and no other program's folder has it; and what was at the
place before, while it is replaced."""
_SCRATCH = "tcfit-scratch-"
_LONG = 80
"""Bytes of a hidden folder's name: longer ones would make paths that Windows and SQLite do not take."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A file to write, which takes the place of `path` when the block ends well, and vanishes when it does not.

    When the block has ended, the file is on the disk under its name.
    """
    with drafting(path) as draft:
        yield draft
        sync(draft)
        os.replace(draft, path)
        sync(path.parent)


@contextmanager
def drafting(path: Path) -> Iterator[Path]:
    """A place for a file or folder of the name of `path`, on the same disk; what is there at the end is deleted.

    The folder belongs to this process alone, so other files may be put beside the draft.
    """
    folder, lock = _own_folder(path)
    try:
        yield folder / path.name
    finally:
        _restore(folder, path)
        _delete(folder, lock)


def put_folder(draft: Path, path: Path) -> None:
    """Move a folder from where `drafting` let it be written to its place; when this returns, it is on the disk.

    Unless the new folder is in place, the old content of `path` is restored at the end of `drafting` or, after a crash,
    by the next writer.
    """
    for folder, _, files in os.walk(draft):
        for name in (*files, "."):
            sync(Path(folder, name))
    if path.exists():
        path.rename(draft.with_name(_REPLACED))
    draft.rename(path)
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
    """Delete what processes that died have not finished in a folder."""
    for left in folder.glob(f".*{_SUFFIX}"):
        _delete_if_left(left)


def sweep_beside(path: Path) -> None:
    """Delete what processes that died have left beside a file or folder that is whole."""
    for number in itertools.count(1):
        folder = _hidden(path, number)
        if not folder.exists():
            return
        _delete_if_left(folder)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A folder among the system's temporary ones; gone when the block ends.

    Of a process that dies it stays until the next one asks for such a folder.
    """
    for left in Path(tempfile.gettempdir()).glob(f"{_SCRATCH}*"):
        _delete_if_left(left)
    folder, lock = _new_scratch()
    try:
        work = folder / "work"
        work.mkdir()
        yield work
    finally:
        _delete(folder, lock)


def _own_folder(path: Path) -> tuple[Path, int | None]:
    """A hidden folder beside `path` for this process alone, and its lock. Remains of dead processes are deleted."""
    for number in itertools.count(1):
        folder = _hidden(path, number)
        with suppress(FileExistsError):
            folder.mkdir()
        try:
            lock = _taken(folder)
        except FileNotFoundError:
            continue  # deleted by another process in between
        except OSError as error:
            if error.errno != errno.ENOLCK:
                raise
            _delete(folder, None)
            # Without locks, a folder may still be in use: each writer has its own, which stays.
            return Path(tempfile.mkdtemp(prefix=".", suffix=_SUFFIX, dir=path.parent)), None
        if lock is not None:
            _restore(folder, path)
            _empty(folder)
            return folder, lock
    raise AssertionError("numbers do not end")


def _hidden(path: Path, number: int) -> Path:
    infix = "" if number == 1 else f".{number}"
    name = f".{path.name}{infix}{_SUFFIX}"
    if len(os.fsencode(name)) > _LONG:
        name = f".{hashlib.sha256(os.fsencode(path.name)).hexdigest()[:32]}{infix}{_SUFFIX}"
    return path.with_name(name)


def _taken(folder: Path) -> int | None:
    """The lock of a hidden folder; None if another process has it, or the folder is another program's or user's. Raises
    OSError if it is gone or not writable, or the file system has no locks."""
    try:
        if folder.is_symlink() or not ((folder / _LOCK).exists() or not any(folder.iterdir())):
            return None
        return locked(folder / _LOCK)
    except (PermissionError, NotADirectoryError):
        return None


def _new_scratch() -> tuple[Path, int | None]:
    """A temporary folder and its lock, or None where the file system knows no locks."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=_SCRATCH))
        try:
            lock = locked(folder / _LOCK)
        except FileNotFoundError:
            continue  # another process took it for a dead process's and deleted it
        except OSError as error:
            if error.errno != errno.ENOLCK:
                raise
            return folder, None
        if lock is not None:
            return folder, lock


def _delete_if_left(folder: Path) -> None:
    """Delete a hidden folder, unless a process is still at work in it or what was replaced is still in it."""
    with suppress(OSError):  # what cannot be deleted stays
        if not (folder / _REPLACED).exists() and (lock := _taken(folder)) is not None:
            _delete(folder, lock)


def _restore(folder: Path, path: Path) -> None:
    """Restore a file or folder whose replacement was interrupted."""
    old = folder / _REPLACED
    if old.exists() and not os.path.lexists(path):
        old.rename(path)


def _empty(folder: Path) -> None:
    for entry in folder.iterdir():
        if entry.name == _LOCK:
            continue
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry, ignore_errors=True)
        else:
            entry.unlink(missing_ok=True)


def _delete(folder: Path, lock: int | None) -> None:
    """Delete the lock's file last: other processes then wait for it, or make another folder."""
    with suppress(OSError):
        _empty(folder)
    if lock is not None and sys.platform == "win32":
        os.close(lock)  # Windows deletes no open file.
    with suppress(OSError):
        (folder / _LOCK).unlink(missing_ok=True)
        folder.rmdir()
    if lock is not None and sys.platform != "win32":
        os.close(lock)
