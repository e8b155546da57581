"""How far a job is, how long it has worked, and how long it will still take."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

from fitting_core.fit.events import FitEvent, Iteration, PhaseFinished
from tcfit_app.fitting.jobs import TYPICAL_SHARES, Job
from tcfit_app.fitting.reports import JobProgress

_EARLY = 0.02
"""Share of a job before which nothing is said about the remaining time."""


class JobClock:
    """Counts the seconds of one job's work, not of its pauses."""

    def __init__(self, number: int, job: Job) -> None:
        self.number, self.job = number, job
        self.elapsed = 0.0
        self._share = 0.0
        self._terms: dict[str, float] = {}

    @contextmanager
    def working(self) -> Iterator[None]:
        """What runs inside counts."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.elapsed += time.perf_counter() - start

    def take(self, event: FitEvent) -> None:
        """Learns from an event how far the job is."""
        if isinstance(event, Iteration):
            self._share = max(self._share, self._done(event.phase, event.share))
            if event.terms:
                self._terms = {**event.terms, "total": sum(event.terms.values())}
        elif isinstance(event, PhaseFinished):
            self._share = max(self._share, self._done(event.phase, 1.0))
            self._terms = event.result.objective

    def _done(self, phase: int, share: float) -> float:
        """Of the whole job, by the typical share of each phase."""
        whole = sum(TYPICAL_SHARES[p] for p in self.job.phases)
        before = sum(TYPICAL_SHARES[p] for p in self.job.phases if p < phase)
        return min(1.0, (before + share * TYPICAL_SHARES[phase]) / whole)

    def progress(self, event: Iteration) -> JobProgress:
        """For the user."""
        early = self._share < _EARLY
        return JobProgress(
            job=self.number,
            title=self.job.title,
            phase=event.phase,
            label=event.label,
            share=self._share,
            cost=event.cost,
            terms=self._terms,
            elapsed=self.elapsed,
            remaining=None if early else self.elapsed * (1 - self._share) / self._share,
        )


@dataclass(kw_only=True)
class RunningJob:
    """A job from its submission to its end."""

    number: int
    run: int | None
    """The run that it fits; None: edits are being followed."""
    follows: int | None = None
    """The run whose edits are being followed."""
    title: str
    phases: tuple[int, ...]
    started: bool = False
    phase: int | None = None
    progress: JobProgress | None = None
    losses: list[tuple[float, dict[str, float]]] = field(default_factory=list)
    """Seconds of work, and mean cost of a frame by term, "total" among them; about twice a second."""
    windows: list[range] = field(default_factory=list)
    """Frames that have a fit from the phase that is running."""
    outcome: Literal["", "finished", "cancelled", "failed"] = ""
    """Empty: it has not ended."""
    reason: str = ""
    """Why it failed."""

    def take(self, progress: JobProgress) -> None:
        """It has come further."""
        self.progress = progress
        if progress.terms and (not self.losses or progress.terms is not self.losses[-1][1]):
            self.losses.append((progress.elapsed, progress.terms))
