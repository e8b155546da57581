"""`--json`: what a command does, a JSON object for each line of the standard output, for programs that start tcfit.

Events and their fields stay from version to version; new ones may come, which readers must pass over. SCHEMA goes up
when anything else changes. What is printed for people goes to the standard error meanwhile.
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
"""Progress is told when the share has grown by this much."""


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


class Progress(Event, frozen=True, kw_only=True, tag="progress"):
    """How far a step is. Lines come at most for each hundredth."""

    step: str
    share: float
    """0 to 1; it never falls."""
    text: str
    """What is being done, in words; may be empty."""
    clip: str | None = None
    """Of `batch`: which of the clips."""
    cost: float | None = None
    """Of a fit: mean cost of the frames that are being fitted."""
    fraction: float | None = None
    """Of a fit: of all its phases, 0 to 1; it never falls."""
    remaining: float | None = None
    """Of a fit: seconds left; null until the estimate is stable."""


class StepDone(Event, frozen=True, kw_only=True, tag="step_done"):
    """A step has ended well."""

    step: str
    seconds: float | None = None
    cost: float | None = None
    """Of a phase of a fit."""


class ClipEnded(Event, frozen=True, kw_only=True, tag="clip"):
    """Of `batch`: a clip is done, or has failed."""

    clip: str
    state: str
    """As in summary.csv: "done" or "failed"."""
    place: int
    """How many have ended, this one included, of `total`."""
    total: int
    seconds: float
    reason: str
    """Why it failed; else empty."""


class Figures(Event, frozen=True, kw_only=True, tag="figures"):
    """What was measured."""

    of: str
    """Of which clip, run or sequence."""
    method: str
    """Which fit of it: "phase 1", "phase 3", "final", or a preset."""
    figures: dict[str, float | None]
    """By name, as in metrics.json or summary.json; null where it cannot be measured."""


class Note(Event, frozen=True, kw_only=True, tag="note"):
    """What a person should know."""

    text: str


class Wrote(Event, frozen=True, kw_only=True, tag="wrote"):
    """A file or folder is whole."""

    path: str
    kind: str
    """What it is: a format of `export`, or the file's name."""


class Failure(Event, frozen=True, kw_only=True, tag="error"):
    """Why the command fails; `ended` follows."""

    text: str
    """What was found, what was expected, and what to do."""


class Ended(Event, frozen=True, kw_only=True, tag="ended"):
    """The last line. A process that was killed has none."""

    code: int
    """The exit code: 0, or 1 (failed), 2 (what was given cannot be used), 130 (cancelled)."""


AnyEvent = Started | Step | Progress | StepDone | ClipEnded | Figures | Note | Wrote | Failure | Ended
EVENTS = get_args(AnyEvent)


class _Lines:
    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self._shares: dict[tuple[str, str | None], float] = {}

    def write(self, event: AnyEvent) -> None:
        if isinstance(event, Progress):
            key = event.step, event.clip
            if event.share < self._shares.get(key, -_STEP) + _STEP - 1e-9:
                return
            self._shares[key] = event.share
        self.stream.write(msgspec.json.encode(event).decode() + "\n")
        self.stream.flush()


_lines: ContextVar[_Lines | None] = ContextVar("lines", default=None)
"""Of the command that runs; None without --json."""


def emit(event: AnyEvent) -> None:
    """Tell programs of something; nothing happens without --json."""
    if (lines := _lines.get()) is not None:
        lines.write(event)


def told(step: str) -> Callable[[float], None]:
    """Takes shares of a step, and tells of them."""
    return lambda share: emit(Progress(step=step, share=share, text=""))


def emit_figures(of: str, method: str, figures: Mapping[str, float | None]) -> None:
    """See `Figures`."""
    emit(Figures(of=of, method=method, figures=dict(figures)))


def emit_wrote(*paths: Path, kind: str | None = None) -> None:
    """See `Wrote`; the kind is the file's name if it is not given."""
    for path in paths:
        emit(Wrote(path=str(path), kind=kind or path.name))


@contextmanager
def json_lines() -> Iterator[Callable[[int], int]]:
    """Events go to the standard output, and all that is printed to the standard error, until the block ends.

    Yields:
        Takes the exit code at the end, tells it, and gives it back.
    """
    lines = _Lines(sys.stdout)

    def end(code: int) -> int:
        try:
            emit(Ended(code=code))
        except OSError:  # nobody reads any more
            discard(lines.stream)
        return code

    before = _lines.set(lines)
    try:
        with redirect_stdout(sys.stderr):
            yield end
    finally:
        _lines.reset(before)


def discard(stream: TextIO) -> None:
    """Send what is still buffered nowhere, which Python would try to write when it exits."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def version() -> str:
    """Of tcfit; empty where it runs without being installed."""
    from importlib import metadata

    try:
        return metadata.version("tcfit")
    except metadata.PackageNotFoundError:
        return ""
