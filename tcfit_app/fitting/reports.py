"""The worker's reports to the drawing loop, and messages for users."""

from dataclasses import dataclass, field
from typing import Literal

from fitting_core.body.params import BodyParams
from fitting_core.fit.events import FitEvent, FramesFitted, PhaseStarted
from tcfit_app.fitting.fit_progress import FitProgress


@dataclass(frozen=True, kw_only=True)
class Notice:
    """A message shown once in every browser."""

    title: str
    text: str
    kind: Literal["info", "done", "error"] = "info"


@dataclass(frozen=True, kw_only=True)
class JobStarted:
    """A job left the queue."""

    job: int


@dataclass(frozen=True, kw_only=True)
class JobReported:
    """An event of a job's fit."""

    job: int
    event: FitEvent
    worked: float
    """Seconds that the job has worked, without pauses."""


@dataclass(frozen=True, kw_only=True)
class JobEnded:
    """A job has finished and its result is stored; or it was cancelled, queued or between two iterations; or it failed.

    Phases it had finished remain valid.
    """

    job: int
    how: Literal["finished", "cancelled", "failed"]
    reason: str = ""
    """Why it failed, for users; the traceback is in the log."""


@dataclass(frozen=True, kw_only=True)
class DragMoved:
    """A window followed the pointer."""

    drag: int
    frames: range
    params: BodyParams
    """For these frames."""


@dataclass(frozen=True, kw_only=True)
class DragEnded:
    """A correction was released, converged and stored; or it ended without a result; or it could not be followed."""

    drag: int
    how: Literal["finished", "abandoned", "failed"]
    reason: str = ""
    """As in JobEnded."""


@dataclass(frozen=True, kw_only=True)
class ErrandEnded:
    """An errand was run."""

    errand: int
    reason: str = ""
    """Why it failed, as in JobEnded; empty if it did not."""


Report = JobStarted | JobReported | JobEnded | DragMoved | DragEnded | ErrandEnded


@dataclass(kw_only=True)
class RunningJob:
    """A job from its submission until its end, as its reports describe it."""

    number: int
    run: int | None
    """The run that it fits; None: it follows edits."""
    follows: int | None = None
    """The run whose edits it follows."""
    title: str
    phases: tuple[int, ...]
    started: bool = False
    phase: int | None = None
    progress: FitProgress | None = None
    """None: it is starting."""
    windows: list[range] = field(default_factory=list)
    """Frames already fitted in the running phase."""
    outcome: Literal["", "finished", "cancelled", "failed"] = ""
    """Empty: it has not ended."""
    reason: str = ""
    """Why it failed."""

    def take(self, event: FitEvent, worked: float) -> None:
        """Update from an event of its fit; `worked` as in `JobReported`."""
        self.progress = self.progress or FitProgress(self.phases)
        self.progress.take(event, worked)
        if isinstance(event, PhaseStarted):
            self.phase = event.phase
            self.windows.clear()
        elif isinstance(event, FramesFitted):
            self.windows.append(event.frames)
