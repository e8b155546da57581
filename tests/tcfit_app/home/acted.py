"""A fit for tests that takes no time, in a module that a process has at once."""

import os
import time
from multiprocessing.connection import Connection
from pathlib import Path

from tcfit_app.home.messages import Work


def acted(pipe: Connection, folder: Path, models: Path | None) -> None:
    """In place of a fit: what the folder's name says."""
    pipe.send(Work(step="Phase 1 of 3", share=0.5))
    if folder.name == "fails":
        pipe.send(Work(step="Nobody was found.", ended=True))
    elif folder.name == "dies":
        os._exit(3)
    elif folder.name == "hangs":
        time.sleep(1000)
    else:
        pipe.send(None)
