"""Shows how a fit goes on, from its events: a bar for each phase on a terminal, else a line."""

import sys
import time
from types import TracebackType
from typing import TextIO

from tqdm import tqdm

from fitting_core.fit.events import FitEvent, Iteration, PhaseFinished, PhaseStarted

_FORMAT = "{desc} {percentage:3.0f} % |{bar}| {elapsed} < {remaining}{postfix}"
_STEPS = 1000


class Progress:
    """A context manager; give it every event.

    Args:
        stream: Where to write; None: the standard error. It gets bars if it is a terminal.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self.stream = stream or sys.stderr
        self.bar: tqdm | None = None
        """That of the phase that runs, on a terminal."""
        self._start = 0.0

    def __enter__(self) -> "Progress":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.bar is not None:
            self.bar.close()

    def show(self, event: FitEvent) -> None:
        """Show an event; those that say nothing new are passed over."""
        if isinstance(event, PhaseStarted):
            self._begin(f"Phase {event.phase}: {event.title}")
        elif isinstance(event, Iteration):
            self._move(event)
        elif isinstance(event, PhaseFinished):
            self._end(event)

    def _begin(self, title: str) -> None:
        self._start = time.perf_counter()
        if not self.stream.isatty():
            print(title, file=self.stream, flush=True)
            return
        self.bar = tqdm(
            total=_STEPS, desc=f"{title:32}", bar_format=_FORMAT, file=self.stream, dynamic_ncols=True, smoothing=0
        )

    def _move(self, event: Iteration) -> None:
        if self.bar is None:
            return
        # Some parts of a phase run twice: the share may fall back, the bar does not.
        self.bar.n = max(self.bar.n, min(_STEPS, round(_STEPS * event.share)))
        self.bar.set_postfix_str(f"{event.label}, cost {event.cost:.4g}", refresh=False)
        self.bar.update(0)

    def _end(self, event: PhaseFinished) -> None:
        total = event.result.objective["total"]
        if self.bar is None:
            seconds = time.perf_counter() - self._start
            print(f"  finished in {seconds:.1f} s, cost {total:.4g}", file=self.stream, flush=True)
            return
        self.bar.n = _STEPS
        self.bar.set_postfix_str(f"cost {total:.4g}", refresh=True)
        self.bar.close()
        self.bar = None
