"""The worker's reports to the drawing loop, and messages for users."""

from dataclasses import dataclass
from typing import Literal

from fitting_core.body.params import BodyParams
from fitting_core.fit.events import FitEvent


@dataclass(frozen=True, kw_only=True)
class Notice:
    """A message shown once in every browser."""

    title: str
    text: str
    kind: Literal["info", "done", "error"] = "info"


@dataclass(frozen=True, kw_only=True)
class JobProgress:
    """The progress of a running job."""

    job: int
    phrase: str
    """What is being done, as in `FitProgress`."""
    fraction: float
    """Of the whole job, 0 to 1; never decreases."""
    elapsed: float
    """Working seconds, without pauses."""
    remaining: float | None
    """Estimated working seconds left; None: unknown."""


@dataclass(frozen=True, kw_only=True)
class JobStarted:
    """A job left the queue."""

    job: int


@dataclass(frozen=True, kw_only=True)
class JobReported:
    """A phase started or finished, or frames became final."""

    job: int
    event: FitEvent


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


Report = JobProgress | JobStarted | JobReported | JobEnded | DragMoved | DragEnded | ErrandEnded
