"""What the worker reports to the draw loop: the newest progress in places that are overwritten, all else in order."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from fitting_core.body.params import BodyParams
from fitting_core.fit.events import FitEvent


@dataclass(frozen=True, kw_only=True)
class Notice:
    """Something that every browser is told once."""

    title: str
    text: str
    kind: Literal["info", "done", "error"] = "info"


@dataclass(frozen=True, kw_only=True)
class JobProgress:
    """How far a running job is."""

    job: int
    title: str
    phase: int
    label: str
    """Part of the phase: "stage 3 of 5", "window 12 of 90, stage 5 of 5"."""
    share: float
    """Of the whole job, 0 to 1; never falls."""
    cost: float
    """Mean cost of the frames that are being fitted."""
    terms: dict[str, float]
    """Mean cost of a frame by term, and "total", when it was evaluated last: another dict each time. Empty before."""
    elapsed: float
    """Seconds of work, without pauses."""
    remaining: float | None
    """Seconds of work to come, as far as `share` tells; None: too early to say."""


@dataclass(frozen=True, kw_only=True)
class JobStarted:
    """A job left the queue."""

    job: int


@dataclass(frozen=True, kw_only=True)
class JobReported:
    """A phase began or finished, or frames became final."""

    job: int
    event: FitEvent


@dataclass(frozen=True, kw_only=True)
class JobEnded:
    """A job has its outcome, which the sink has kept; or was cancelled, queued or between two iterations; or failed.

    Phases that it had finished stay valid.
    """

    job: int
    how: Literal["finished", "cancelled", "failed"]
    reason: str = ""
    """Why it failed, for the user; the traceback is in the log."""


@dataclass(frozen=True, kw_only=True)
class DragMoved:
    """A window followed the pointer."""

    drag: int
    frames: range
    params: BodyParams
    """Of these frames."""


@dataclass(frozen=True, kw_only=True)
class DragEnded:
    """A correction was released, its window is converged, and the sink has kept it; or it ended without a result; or it
    could not be followed."""

    drag: int
    how: Literal["finished", "abandoned", "failed"]
    reason: str = ""
    """As of JobEnded."""


@dataclass(frozen=True, kw_only=True)
class ErrandEnded:
    """An errand was run."""

    errand: int
    reason: str = ""
    """Why it failed, as of JobEnded; empty if it did not."""


Report = JobStarted | JobReported | JobEnded | DragEnded | ErrandEnded
"""What must not be lost."""


@dataclass(frozen=True, kw_only=True)
class News:
    """What came since the reports were taken last."""

    progress: JobProgress | None = None
    moved: tuple[DragMoved, ...] = ()
    """Of each drag the newest."""
    reports: list[Report] = field(default_factory=list)
    """In order."""


class Reports:
    """Filled by the worker, emptied by the draw loop; neither ever waits for the other."""

    def __init__(self) -> None:
        self.arrived: Callable[[], None] = lambda: None
        """Called by the worker's thread when there is something new."""
        self._lock = threading.Lock()
        self._progress: JobProgress | None = None
        self._moved: dict[int, DragMoved] = {}
        """By drag."""
        self._reports: list[Report] = []

    def show(self, latest: JobProgress | DragMoved) -> None:
        """Replaces what was shown before."""
        with self._lock:
            if isinstance(latest, JobProgress):
                self._progress = latest
            else:
                self._moved[latest.drag] = latest
        self.arrived()

    def tell(self, report: Report) -> None:
        """Queued behind all that was told before; the progress of a job or drag that ends is dropped."""
        with self._lock:
            if isinstance(report, JobEnded):
                self._progress = None
            if isinstance(report, DragEnded):
                self._moved.pop(report.drag, None)
            self._reports.append(report)
        self.arrived()

    def take(self) -> News:
        """Everything since the last call."""
        with self._lock:
            news = News(progress=self._progress, moved=tuple(self._moved.values()), reports=self._reports)
            self._progress, self._moved, self._reports = None, {}, []
            return news
