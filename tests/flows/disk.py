"""A disk that fills up, or a process that is killed, at a chosen write of the project."""

import errno
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from fitting_core.files import atomic
from tcfit_app.project.storage import database


class Disk:
    """Counts the writes of this process: transactions when they commit, files when their draft begins and when it is
    synced.

    Attributes:
        room: How many writes succeed until the disk is full; None: all.
        killed: Called once, when `fuse` writes have been made: what is on the disk by then is what a killed process
            leaves.
        fuse: How many writes are made until then; None: it is not called.
    """

    def __init__(self) -> None:
        self.room: int | None = None
        self.fuse: int | None = None
        self.killed: Callable[[], None] = lambda: None
        self.refused = 0
        self._lock = threading.RLock()

    def write(self) -> None:
        """Raises OSError if the disk is full."""
        with self._lock:
            if self.fuse is not None:
                self.fuse -= 1
                if self.fuse < 0:
                    self.fuse = None
                    self.killed()
            if self.room is not None:
                self.room -= 1
                if self.room < 0:
                    self.refused += 1
                    raise OSError(errno.ENOSPC, "No space left on device")


@contextmanager
def disk() -> Iterator[Disk]:
    """The disk of this process until the block ends."""
    made, transaction, own_folder, sync = Disk(), database._transaction, atomic._own_folder, atomic.sync

    @contextmanager
    def committed(connection: sqlite3.Connection) -> Iterator[None]:
        with transaction(connection):
            yield
            try:
                made.write()
            except OSError as full:
                error = sqlite3.OperationalError("database or disk is full")
                error.sqlite_errorname = "SQLITE_FULL"
                raise error from full

    def begun(path: Path) -> Any:
        made.write()
        return own_folder(path)

    def synced(path: Path) -> None:
        made.write()
        sync(path)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(database, "_transaction", committed)
        patch.setattr(atomic, "_own_folder", begun)
        patch.setattr(atomic, "sync", synced)
        yield made
