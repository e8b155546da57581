"""A job for tests that takes no time, in a module that a process has at once."""

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from fitting_core.errors import InputError
from tcfit_app.home.jobs import Report
from tcfit_app.home.messages import Work


@dataclass(frozen=True, kw_only=True)
class Acted:
    """Does what the folder's name says."""

    kind: ClassVar[str] = "act"
    writes: ClassVar[bool] = False

    def run(self, folder: Path, report: Report) -> str:
        report(Work(step="Phase 1 of 3", share=0.5))
        if folder.name == "fails":
            raise InputError("Nobody was found.")
        if folder.name == "dies":
            os._exit(3)
        if folder.name == "hangs":
            time.sleep(1000)
        return "Said" if folder.name == "says" else ""


@dataclass(frozen=True, kw_only=True)
class ActedAfterwards(Acted):
    """Another kind."""

    kind: ClassVar[str] = "act afterwards"
