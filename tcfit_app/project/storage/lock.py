"""One writer for a project: a lock that the system takes back when its process ends, however it ends."""

import os
from contextlib import suppress
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.files.locking import try_lock

NAME = "project.lock"


class ProjectLocked(InputError):
    """Another process, or another place in this one, writes to the project; it can still be opened read-only."""


class Lock:
    """Held from its creation to `release`, or to the end of the process."""

    def __init__(self, folder: Path) -> None:
        """Take the lock of a project.

        Raises:
            ProjectLocked: Somebody has it.
            InputError: The file system knows no locks, as some network drives.
            OSError: The folder cannot be written.
        """
        path = folder / NAME
        # The file stays when the lock is released: a new one under the same name could be locked twice.
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            free = try_lock(self._descriptor)
        except OSError as error:
            os.close(self._descriptor)
            raise InputError(
                f"{folder}: cannot be locked here ({error.strerror or error}), so that two could write at once. "
                "Move it to a disk of this computer, or open it read-only."
            ) from error
        if not free:
            holder = _holder(self._descriptor)
            os.close(self._descriptor)
            raise ProjectLocked(
                f"{folder}: is open in another tcfit{holder}. Close that one, or open the project read-only."
            )
        with suppress(OSError):  # On a full disk the message above names no process.
            os.ftruncate(self._descriptor, 0)
            os.write(self._descriptor, f"{os.getpid()}\n".encode())

    def release(self) -> None:
        """Let others write."""
        os.close(self._descriptor)


def _holder(descriptor: int) -> str:
    """The process that holds the lock, as it has written it down, in words."""
    os.lseek(descriptor, 0, os.SEEK_SET)
    number = os.read(descriptor, 20).strip().decode("ascii", "replace")
    return f" (process {number})" if number.isdigit() else ""
