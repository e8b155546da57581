"""Jobs of the worker whose results belong to a run of the project."""

from abc import ABC, abstractmethod
from collections.abc import Generator
from dataclasses import dataclass

from fitting_core.events import FitEvent
from fitting_core.result import FitResult
from tcfit_app.jobs import Job, RerunFrames


@dataclass(frozen=True, kw_only=True)
class _OfRun(ABC):
    """Does what its job does."""

    job: Job

    @property
    @abstractmethod
    def title(self) -> str:
        """For the user."""

    @property
    def phases(self) -> tuple[int, ...]:
        """As the job's."""
        return self.job.phases

    def run(self) -> Generator[FitEvent, None, FitResult]:
        """As the job's."""
        return self.job.run()


@dataclass(frozen=True, kw_only=True)
class RunJob(_OfRun):
    """A job that makes a run."""

    run_id: int

    @property
    def title(self) -> str:
        """As the job's."""
        return self.job.title


@dataclass(frozen=True, kw_only=True)
class CorrectionJob(_OfRun):
    """A re-run around some edits, whose windows go into the run's corrections."""

    origin: int
    job: RerunFrames

    @property
    def title(self) -> str:
        """For the user."""
        return f"Follow edits: {self.job.title.lower()}"
