"""The progress of a job, its working time, and the remaining time."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

from fitting_core.fit.events import FitEvent
from tcfit_app.fitting.fit_progress import FitProgress
from tcfit_app.fitting.jobs import Job
from tcfit_app.fitting.reports import JobProgress


class JobClock:
    """Measures the working time of a job, without pauses."""

    def __init__(self, number: int, job: Job) -> None:
        self.number, self.job = number, job
        self.elapsed = 0.0
        self._progress = FitProgress(job.phases)

    @contextmanager
    def working(self) -> Iterator[None]:
        """The time inside counts."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.elapsed += time.perf_counter() - start

    def take(self, event: FitEvent) -> None:
        """Update the progress from an event."""
        self._progress.take(event, self.elapsed)

    @property
    def progress(self) -> JobProgress:
        """For users."""
        return JobProgress(
            job=self.number,
            phrase=self._progress.phrase,
            fraction=self._progress.fraction,
            elapsed=self.elapsed,
            remaining=self._progress.remaining,
        )


@dataclass(kw_only=True)
class RunningJob:
    """A job from its submission until its end."""

    number: int
    run: int | None
    """The run that it fits; None: it follows edits."""
    follows: int | None = None
    """The run whose edits it follows."""
    title: str
    phases: tuple[int, ...]
    started: bool = False
    phase: int | None = None
    progress: JobProgress | None = None
    windows: list[range] = field(default_factory=list)
    """Frames already fitted in the running phase."""
    outcome: Literal["", "finished", "cancelled", "failed"] = ""
    """Empty: it has not ended."""
    reason: str = ""
    """Why it failed."""

    def take(self, progress: JobProgress) -> None:
        """Update the progress."""
        self.progress = progress
