"""Jobs of the worker whose results belong to a run of the project."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

from fitting_core.fit.events import FitEvent
from fitting_core.fit.result import FitResult
from tcfit_app.fitting.jobs import Job, RerunFrames


@dataclass(kw_only=True)
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


@dataclass(kw_only=True)
class RunJob(_OfRun):
    """A job that makes a run."""

    run_id: int
    start: Callable[[], FitResult] | None = None
    """The fit that frames are fitted again in, where it is still to come: asked for when the job begins."""

    @property
    def title(self) -> str:
        """As the job's."""
        return self.job.title

    def run(self) -> Generator[FitEvent, None, FitResult]:
        """As the job's. Raises InputError if the fit to start from never came."""
        if self.start is not None:
            assert isinstance(self.job, RerunFrames)
            self.job = replace(self.job, start=self.start())
        return self.job.run()


@dataclass(kw_only=True)
class CorrectionJob(_OfRun):
    """A re-run around some edits, whose windows go into the run's corrections."""

    origin: int
    frames: frozenset[int]
    """That were edited."""
    job: RerunFrames
    edits_seen: int
    """Id of the last log entry that the job's keypoints hold."""
    renewed: Callable[[], tuple[RerunFrames, int]]
    """The job and `edits_seen` as of now: drags go first, and have changed both by the time that it begins."""

    @property
    def title(self) -> str:
        """For the user."""
        return f"Follow edits: {self.job.title.lower()}"

    def run(self) -> Generator[FitEvent, None, FitResult]:
        """As the job's, from what there is now."""
        self.job, self.edits_seen = self.renewed()
        return self.job.run()
