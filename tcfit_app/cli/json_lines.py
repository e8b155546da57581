"""`--json`: progress of a command as events, one JSON object per line of standard output.

Events and their fields are stable; readers must ignore new ones. SCHEMA goes up if anything else changes. Messages for
people go to standard error.
"""

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from contextvars import ContextVar
from pathlib import Path
from typing import TextIO, get_args

import msgspec

SCHEMA = 1
OPTION = "--json"
_STEP = 0.01
"""StepProgress is reported when the share has grown by this much."""


class Event(msgspec.Struct, frozen=True, kw_only=True, tag_field="event"):
    """A line."""


class Started(Event, frozen=True, kw_only=True, tag="started"):
    """The first line."""

    schema: int
    """SCHEMA."""
    command: str
    """Such as "fit"."""
    version: str
    """Of tcfit."""


class Step(Event, frozen=True, kw_only=True, tag="step"):
    """A step begins: a phase of a fit, a format of an export."""

    step: str
    """Its name, the same in all runs: "phase 1", "overlay", "glb"."""
    title: str
    """In words."""


class StepProgress(Event, frozen=True, kw_only=True, tag="progress"):
    """StepProgress of a step, at most one line for each hundredth."""

    step: str
    share: float
    """0 to 1; it never falls."""
    text: str
    """What is being done, for people; may be empty."""
    clip: str | None = None
    """For `batch`: the clip."""
    cost: float | None = None
    """For a fit: mean cost of the frames that are being fitted."""
    fraction: float | None = None
    """For a fit: share of the whole fit, 0 to 1; it never falls."""
    remaining: float | None = None
    """For a fit: seconds left; null until the estimate is stable."""


class StepDone(Event, frozen=True, kw_only=True, tag="step_done"):
    """A step has succeeded."""

    step: str
    seconds: float | None = None
    cost: float | None = None
    """For a phase of a fit."""


class ClipEnded(Event, frozen=True, kw_only=True, tag="clip"):
    """For `batch`: a clip is done, or has failed."""

    clip: str
    state: str
    """As in summary.csv: "done" or "failed"."""
    place: int
    """Number of ended clips, including this one, of `total`."""
    total: int
    seconds: float
    reason: str
    """Why it failed; else empty."""


class Figures(Event, frozen=True, kw_only=True, tag="figures"):
    """Measured figures."""

    of: str
    """Clip, run or sequence."""
    method: str
    """Its fit: "phase 1", "phase 3", "final", or a preset."""
    figures: dict[str, float | None]
    """By name, as in metrics.json or summary.json; null if a figure cannot be measured."""


class Note(Event, frozen=True, kw_only=True, tag="note"):
    """A message for people."""

    text: str


class Wrote(Event, frozen=True, kw_only=True, tag="wrote"):
    """A file or folder is complete."""

    path: str
    kind: str
    """A format of `export`, or the file's name."""


class Failure(Event, frozen=True, kw_only=True, tag="error"):
    """The command fails; `ended` follows."""

    text: str
    """Found, expected, and what to do."""


class Ended(Event, frozen=True, kw_only=True, tag="ended"):
    """The last line, unless the process was killed."""

    code: int
    """The exit code: 0, 1 (failed), 2 (wrong input), 130 (cancelled)."""


AnyEvent = Started | Step | StepProgress | StepDone | ClipEnded | Figures | Note | Wrote | Failure | Ended
EVENTS = get_args(AnyEvent)


class _Lines:
    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self._shares: dict[tuple[str, str | None], float] = {}

    def write(self, event: AnyEvent) -> None:
        if isinstance(event, StepProgress):
            key = event.step, event.clip
            if event.share < self._shares.get(key, -_STEP) + _STEP - 1e-9:
                return
            self._shares[key] = event.share
        self.stream.write(msgspec.json.encode(event).decode() + "\n")
        self.stream.flush()


_lines: ContextVar[_Lines | None] = ContextVar("lines", default=None)
"""The running command's; None without --json."""


def emit(event: AnyEvent) -> None:
    """Write an event; without --json, do nothing."""
    if (lines := _lines.get()) is not None:
        lines.write(event)


def share_reporter(step: str) -> Callable[[float], None]:
    """A function that reports shares of a step."""
    return lambda share: emit(StepProgress(step=step, share=share, text=""))


def emit_figures(of: str, method: str, figures: Mapping[str, float | None]) -> None:
    """See `Figures`."""
    emit(Figures(of=of, method=method, figures=dict(figures)))


def emit_wrote(*paths: Path, kind: str | None = None) -> None:
    """See `Wrote`; the kind is the file's name if it is not given."""
    for path in paths:
        emit(Wrote(path=str(path), kind=kind or path.name))


@contextmanager
def json_lines() -> Iterator[Callable[[int], int]]:
    """Until the block ends, events go to standard output, and everything that is printed goes to standard error.

    Yields:
        A function that reports the exit code and returns it.
    """
    lines = _Lines(sys.stdout)

    def end(code: int) -> int:
        try:
            emit(Ended(code=code))
        except OSError:  # the reader is gone
            discard(lines.stream)
        return code

    before = _lines.set(lines)
    try:
        with redirect_stdout(sys.stderr):
            yield end
    finally:
        _lines.reset(before)


def discard(stream: TextIO) -> None:
    """Discard buffered output, which Python would try to write at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    if nowhere != stream.fileno():  # equal if the stream's descriptor was closed: the lowest free one is taken
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def version() -> str:
    """The version of tcfit; empty if it is not installed."""
    from importlib import metadata

    try:
        return metadata.version("tcfit")
    except metadata.PackageNotFoundError:
        return ""
