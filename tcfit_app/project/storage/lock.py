"""One writer per project: a lock that the system releases when its process ends in any way."""

import os
from contextlib import suppress
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
        with suppress(OSError):  # on a full disk, the message above lacks the process
            os.ftruncate(self._descriptor, 0)
            os.write(self._descriptor, f"{os.getpid()}\n".encode())

    def release(self) -> None:
        """Let others write."""
        os.close(self._descriptor)


def _holder(descriptor: int) -> str:
    """The process holding the lock, as recorded in the file, in words."""
    os.lseek(descriptor, 0, os.SEEK_SET)
    number = os.read(descriptor, 20).strip().decode("ascii", "replace")
    return f" (process {number})" if number.isdigit() else ""
