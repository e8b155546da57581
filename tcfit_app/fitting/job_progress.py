"""The progress of a job, its working time, and the remaining time."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

from fitting_core.fit.events import FitEvent, Iteration, PhaseFinished
from tcfit_app.fitting.fit_progress import FitProgress
from tcfit_app.fitting.jobs import Job
from tcfit_app.fitting.reports import JobProgress

MOST_LOSSES = 1000
"""Costs kept of a job, several times what a plot shows; beyond that, every second one is dropped."""


class JobClock:
    """Measures the working time of a job, without pauses."""

    def __init__(self, number: int, job: Job) -> None:
        self.number, self.job = number, job
        self.elapsed = 0.0
        self._progress = FitProgress(job.phases)
        self._terms: dict[str, float] = {}

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
        if isinstance(event, Iteration) and event.terms:
            self._terms = {**event.terms, "total": sum(event.terms.values())}
        elif isinstance(event, PhaseFinished):
            self._terms = event.result.objective

    @property
    def progress(self) -> JobProgress:
        """For users."""
        return JobProgress(
            job=self.number,
            phrase=self._progress.phrase,
            fraction=self._progress.fraction,
            terms=self._terms,
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
    losses: list[tuple[float, dict[str, float]]] = field(default_factory=list)
    """Working seconds, and mean cost per frame by term including "total"; at first about twice a
    second."""
    windows: list[range] = field(default_factory=list)
    """Frames already fitted in the running phase."""
    outcome: Literal["", "finished", "cancelled", "failed"] = ""
    """Empty: it has not ended."""
    reason: str = ""
    """Why it failed."""

    def take(self, progress: JobProgress) -> None:
        """Update the progress."""
        self.progress = progress
        if progress.terms and (not self.losses or progress.terms is not self.losses[-1][1]):
            self.losses.append((progress.elapsed, progress.terms))
            if len(self.losses) > MOST_LOSSES:
                del self.losses[1:-1:2]
