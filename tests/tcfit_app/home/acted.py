"""A job for tests that takes no time, in a module that a process has at once."""

import os
import time
from pathlib import Path

from fitting_core.errors import InputError
from tcfit_app.fitting.process_queue import Report, Work


def act(folder: Path, report: Report) -> str:
    """Do what the folder's name says."""
    report(Work(step="Phase 1 of 3", share=0.5))
    if folder.name == "fails":
        raise InputError("Nobody was found.")
    if folder.name == "dies":
        os._exit(3)
    if folder.name == "hangs":
        time.sleep(1000)
    return "Said" if folder.name == "says" else ""
