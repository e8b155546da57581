"""One writer per project: a lock that the system releases when its process ends in any way."""

import os
import platform
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.files.locking import try_lock

NAME = "project.lock"


class ProjectLocked(InputError):
    """Another process, or another part of this one, is writing to the project; it can still be opened read-only."""


class ProjectLock:
    """Held from its creation until `release`, or the end of the process."""

    def __init__(self, folder: Path) -> None:
        """Take the lock of a project.

        Raises:
            ProjectLocked: It is taken.
            InputError: The file system does not support locks, like some network drives.
            OSError: The folder cannot be written.
        """
        path = folder / NAME
        # The file stays when the lock is released: a recreated file could be locked twice.
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            free = try_lock(self._descriptor)
            if not free:  # another process may only have asked for the holder
                time.sleep(_LOOK)
                free = try_lock(self._descriptor)
        except OSError as error:
            os.close(self._descriptor)
            raise InputError(
                f"{folder}: cannot be locked ({error.strerror or error}), so two processes could write at once. "
                "Move it to a local disk, or open it read-only."
            ) from error
        if not free:
            holder = _holder(self._descriptor)
            os.close(self._descriptor)
            raise ProjectLocked(
                f"{folder}: is open in another tcfit{holder}. Close it there, or open the project read-only."
            )
        self.tell("")

    def tell(self, names: str) -> None:
        """Record the people who work on it, in one line, for processes that find it locked."""
        with suppress(OSError):  # on a full disk no name is recorded
            os.ftruncate(self._descriptor, 0)
            os.lseek(self._descriptor, 0, os.SEEK_SET)
            os.write(self._descriptor, f"{os.getpid()}\n{platform.node()}\n{names}\n".encode())

    def release(self) -> None:
        """Let others write."""
        with suppress(OSError):
            os.ftruncate(self._descriptor, 0)
        os.close(self._descriptor)


_LOOK = 0.05
"""Seconds, in which `holder` has long looked."""
_MOST = 1000
"""Bytes that are read of what a holder has written down."""


@dataclass(frozen=True, kw_only=True)
class Holder:
    """Who has a lock."""

    process: str = ""
    """Its number; empty if it has written none down."""
    computer: str = ""
    names: str = ""
    """Of the people who work on it; empty if unknown."""


def holder(folder: Path) -> Holder | None:
    """The process that writes to a project now, if any."""
    try:
        # A released lock has no content. Other processes may be dead, and are not disturbed by a look.
        if not os.stat(folder / NAME).st_size:
            return None
        descriptor = os.open(folder / NAME, os.O_RDWR)
    except OSError:
        return None
    try:
        if try_lock(descriptor):
            return None
        return _written(descriptor)
    except OSError:
        return None
    finally:
        os.close(descriptor)


def _written(descriptor: int) -> Holder:
    os.lseek(descriptor, 0, os.SEEK_SET)
    lines = [*os.read(descriptor, _MOST).decode("utf-8", "replace").splitlines(), "", "", ""]
    process, computer, names = ("".join(filter(str.isprintable, line)) for line in lines[:3])
    return Holder(process=process if process.isdigit() else "", computer=computer, names=names)


def _holder(descriptor: int) -> str:
    """The process holding the lock, as recorded in the file, in words."""
    found = _written(descriptor)
    by = f", by {found.names}" if found.names else ""
    return f" (process {found.process}{by})" if found.process else ""
