"""The progress of a command: bars on a terminal, lines elsewhere, and events for `--json`."""

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import TextIO

from tqdm import tqdm

from fitting_core.detect.detecting import DetectionProgress
from fitting_core.fit.events import FitEvent, Iteration, PhaseFinished, PhaseStarted
from fitting_core.motion import Progress
from tcfit_app.cli.json_lines import Step, StepDone, StepProgress, emit, share_reporter
from tcfit_app.fitting.fit_progress import FitProgress, time_left


@contextmanager
def bar(title: str, step: str) -> Iterator[Progress]:
    """A bar on a terminal; what it yields takes shares, moves the bar, and reports them as those of a step."""
    form, tell = "{desc} {percentage:3.0f} % |{bar}| {elapsed} < {remaining}", share_reporter(step)
    with tqdm(total=1.0, desc=f"{title:26}", bar_format=form, file=sys.stderr, disable=None, leave=False) as shown:

        def advance(share: float) -> None:
            shown.update(share - shown.n)
            tell(share)

        yield advance


_KEYPOINTS, _TITLE = "keypoints", "Keypoints"


class DetectionShown:
    """A context manager, called with each progress: shows a bar on a terminal, else a line.

    Shows nothing if keypoints are given. If the detection ends early, says which frames are cached.
    """

    def __init__(self) -> None:
        self._last: DetectionProgress | None = None
        self._bar: tqdm | None = None

    def __enter__(self) -> "DetectionShown":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()
        if self._last is None:
            return
        if kind is None:
            emit(StepDone(step=_KEYPOINTS))
        elif 0 < self._last.kept < self._last.total:
            _tell(f"Stopped. The keypoints of {_frames(self._last)} are cached; the same command continues.")

    def __call__(self, progress: DetectionProgress) -> None:
        """Show it."""
        if self._last is None:
            self._begin(progress)
        self._last = progress
        emit(StepProgress(step=_KEYPOINTS, share=progress.share, text=f"{progress.done} of {progress.total} frames"))
        if self._bar is not None:
            self._bar.update(progress.done - self._bar.n)

    def _begin(self, progress: DetectionProgress) -> None:
        emit(Step(step=_KEYPOINTS, title=_TITLE))
        if progress.kept == progress.total:
            return
        if progress.kept:
            _tell(f"Continuing after {_frames(progress)} with cached keypoints.")
        if not sys.stderr.isatty():
            _tell(f"Detecting keypoints in {progress.total} frames ...")
            return
        self._bar = tqdm(
            desc=_TITLE, total=progress.total, initial=progress.kept, unit=" frames", dynamic_ncols=True, smoothing=0.1
        )


def _frames(progress: DetectionProgress) -> str:
    return f"{progress.kept} of {progress.total} frames"


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


_FORMAT = "{desc} {percentage:3.0f} % |{bar}| {elapsed}{postfix}"
_STEPS = 1000


class ProgressShown:
    """Shows a fit's progress: as one bar if the stream (None: standard error) is a terminal, and as JSON events.

    Args:
        phases: What the fit runs, in order.
        stream: Where to.
    """

    def __init__(self, phases: Sequence[int], stream: TextIO | None = None) -> None:
        self.stream = stream or sys.stderr
        self.bar: tqdm | None = None
        self._progress, self._start = FitProgress(phases), time.perf_counter()

    def close(self) -> None:
        """Leave the bar as it is."""
        if self.bar is not None:
            self.bar.close()

    def show(self, event: FitEvent) -> None:
        """Show an event."""
        self._progress.take(event, time.perf_counter() - self._start)
        step = f"phase {self._progress.phase}"
        if isinstance(event, PhaseStarted):
            emit(Step(step=step, title=event.title))
            self._begin()
        elif isinstance(event, Iteration):
            emit(
                StepProgress(
                    step=step,
                    share=event.share,
                    text=self._progress.phrase,
                    cost=event.cost,
                    fraction=self._progress.fraction,
                    remaining=self._progress.remaining,
                )
            )
            self._move()
        elif isinstance(event, PhaseFinished):
            seconds, cost = event.result.seconds, event.result.objective["total"]
            emit(StepDone(step=step, seconds=seconds, cost=cost))
            self._move()
            if self.bar is None:
                print(f"  {seconds:.1f} s, cost {cost:.4g}", file=self.stream, flush=True)

    def _begin(self) -> None:
        if not self.stream.isatty():
            print(f"Phase {self._progress.phase}: {self._progress.phrase}", file=self.stream, flush=True)
        elif self.bar is None:
            self.bar = tqdm(total=_STEPS, bar_format=_FORMAT, file=self.stream, dynamic_ncols=True, smoothing=0)

    def _move(self) -> None:
        if self.bar is None:
            return
        left = time_left(self._progress.remaining)
        self.bar.set_description_str(f"{self._progress.phrase.capitalize():10}", refresh=False)
        self.bar.set_postfix_str(left, refresh=False)
        self.bar.n = round(_STEPS * self._progress.fraction)
        self.bar.update(0)
        if self.bar.n == _STEPS:
            self.bar.refresh()
