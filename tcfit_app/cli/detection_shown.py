"""The progress of a detection, on the terminal and as events."""

import sys
from types import TracebackType

from tqdm import tqdm

from fitting_core.detect.detecting import DetectionProgress
from tcfit_app.cli.json_lines import Progress, Step, StepDone, emit

_STEP, _TITLE = "keypoints", "Keypoints"


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
            emit(StepDone(step=_STEP))
        elif 0 < self._last.kept < self._last.total:
            _tell(f"Stopped. The keypoints of {_frames(self._last)} are cached; the same command continues.")

    def __call__(self, progress: DetectionProgress) -> None:
        """Show it."""
        if self._last is None:
            self._begin(progress)
        self._last = progress
        emit(Progress(step=_STEP, share=progress.share, text=f"{progress.done} of {progress.total} frames"))
        if self._bar is not None:
            self._bar.update(progress.done - self._bar.n)

    def _begin(self, progress: DetectionProgress) -> None:
        emit(Step(step=_STEP, title=_TITLE))
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
