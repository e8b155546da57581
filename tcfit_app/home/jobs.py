"""Jobs on clips, each in a process of its own: a crash does not affect the list and the reviews, and a job can be
cancelled at any moment. What it has stored by then stays."""

import logging
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import ClassVar, Protocol

from fitting_core.errors import InputError
from tcfit_app.fitting import child_processes
from tcfit_app.home.messages import Report, Work, failure

_BETWEEN = 0.5
"""Seconds."""


class Job(Protocol):
    """Is sent to the process."""

    kind: ClassVar[str]
    """A clip waits for one job of a kind at most."""
    writes: ClassVar[bool]
    """Whether it writes into the project, which must then be closed."""

    def run(self, folder: Path, report: Report) -> str:
        """Do it, in the process.

        Args:
            folder: Of the project.
            report: Receives the progress.

        Returns:
            The final message; may be empty.

        Raises:
            InputError: It cannot be done.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class FitJob:
    """Find missing keypoints, and fit."""

    kind: ClassVar[str] = "fit"
    writes: ClassVar[bool] = True
    models: Path | None = None
    """Folder of body models."""

    def run(self, folder: Path, report: Report) -> str:
        """See `Job.run`."""
        from tcfit_app.home.fitting import fit_project  # torch's two seconds are not for the list

        fit_project(folder, report, models=self.models)
        return ""


@dataclass(frozen=True, kw_only=True)
class ExportJob:
    """Write the last fit for other programs."""

    kind: ClassVar[str] = "export"
    writes: ClassVar[bool] = False
    formats: tuple[str, ...]
    axes: str = ""
    """Of AXES_CHOICES."""
    view: str = ""
    """Of VIEW_CHOICES."""
    models: Path | None = None
    """Folder of body models."""

    def run(self, folder: Path, report: Report) -> str:
        """See `Job.run`."""
        from tcfit_app.home.exporting import export_project

        return export_project(folder, report, formats=self.formats, axes=self.axes, view=self.view, models=self.models)


def serve(pipe: Connection, folder: Path, job: Job) -> None:
    """Run a job in the process: sends `Work` through the pipe, and in the end None or a `Work` that has ended."""
    child_processes.end_with_parent()
    try:
        said = job.run(folder, _seldom(pipe.send))
        pipe.send(Work(step=said, ended="done") if said else None)
    except InputError as error:
        pipe.send(Work(step=str(error), ended="failed"))
    except (Exception, KeyboardInterrupt) as error:  # a plugin may raise the latter: this process is deaf to Ctrl-C
        logging.getLogger(__name__).exception("%s: the %s went wrong", folder, job.kind)
        pipe.send(failure(error))


def _seldom(report: Report) -> Report:
    """The same report, at most twice a second within a step."""
    step, reported = "", 0.0

    def seldom(work: Work) -> None:
        nonlocal step, reported
        if work.step != step or time.monotonic() > reported + _BETWEEN:
            step, reported = work.step, time.monotonic()
            report(work)

    return seldom
