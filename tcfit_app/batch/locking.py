"""Locks for which to wait a little: a process that was killed may need a moment to let go."""

import time
from pathlib import Path

from fitting_core.errors import InputError
from tcfit_app.project.storage.durable import accessing
from tcfit_app.project.storage.lock import Lock, ProjectLocked

_PAUSE = 0.1


def patient_lock(folder: Path, *, seconds: float, wanted: str) -> Lock:
    """Take the lock of a folder, which is made if it does not exist.

    Args:
        folder: What only one process may work on.
        seconds: To wait for a process that has it.
        wanted: What the user wanted, for the message: "fit into ...".

    Raises:
        InputError: Somebody still has it, or the folder cannot be written.
    """
    until = time.monotonic() + seconds
    while True:
        try:
            with accessing(folder):
                folder.mkdir(parents=True, exist_ok=True)
                return Lock(folder)
        except ProjectLocked as error:
            if time.monotonic() > until:
                raise InputError(
                    f"{folder}: another process is at work to {wanted}. Wait for it, or stop it. ({error})"
                ) from error
            time.sleep(_PAUSE)
