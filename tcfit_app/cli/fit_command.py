"""`tcfit fit`: read a clip, fit it, write the result."""

import dataclasses
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from tqdm import tqdm

from fitting_core.body.files.reading import load_body
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError, printable
from fitting_core.fit.events import FitEvent, Iteration, PhaseFinished, PhaseStarted
from fitting_core.fit.fitting import fit_clip
from fitting_core.io.result_files import FIT_NAME, OVERLAY_NAME, SUMMARY_NAME, write_result
from fitting_core.keypoints import ERROR_GROUPS
from fitting_core.results.fit_result import FitResult
from fitting_core.results.given_start import GivenStart
from fitting_core.results.known_shape import KnownShape
from tcfit_app.cli.detection_shown import DetectionShown
from tcfit_app.cli.json_lines import Note, Progress, Step, StepDone, emit, emit_figures, emit_wrote, told
from tcfit_app.exports.pictures import write_comparison
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.fit_progress import FitProgress, time_left
from tcfit_app.imports.given import read_shape, start_of
from tcfit_app.options.clip_input import clip_of, described, notes_of
from tcfit_app.options.fit import FitOptions, fit_config
from tcfit_app.options.preparing import body_file, check_out, compile_kernels, prepare_solver


@dataclasses.dataclass(frozen=True, kw_only=True)
class Outcome:
    """A finished fit."""

    fit: FitResult
    body: BodyModel
    summary: dict[str, Any]


def run_fit(options: FitOptions, *, command: str = "") -> Outcome:
    """Fit, write the result, and print its folder.

    Raises:
        InputError: Files or options cannot be used. Nothing is written then.
        KeyboardInterrupt: Cancelled. Finished phases are written.
    """
    config = fit_config(options.method)
    if options.shape is not None and config.height is not None:
        raise InputError("--shape cannot be combined with --height: a known shape has its own height.")
    check_out(options.out, overwrite=options.overwrite)
    body = prepared_body(options, config)
    shape = None if options.shape is None else read_shape(options.shape, body)
    with DetectionShown() as tell_progress:
        clip = clip_of(options, tell_progress)
    start = start_of(options.begin, clip, body, Bodies(options.body.models))
    compile_kernels(config)
    return fit_into(options.out, clip, body, config, options, start=start, shape=shape, command=command)


def prepared_body(options: FitOptions, config: FitConfig) -> BodyModel:
    """Prepare threads and device, and read the body. Raises InputError if the body is missing or the device does not
    work."""
    prepare_solver(config, options.threads)
    return load_body(body_file(options.body))


def fit_into(
    folder: Path,
    clip: Clip,
    body: BodyModel,
    config: FitConfig,
    options: FitOptions,
    *,
    start: GivenStart | None = None,
    shape: KnownShape | None = None,
    command: str = "",
    begins: Callable[[], None] = lambda: None,
) -> Outcome:
    """Fit a clip, write the result into a folder, and print the folder and the main figures.

    Args:
        begins: Called once, before the first phase that has finished is written.

    Raises:
        InputError: The folder cannot be written.
        KeyboardInterrupt: Cancelled; the phases that had finished have been written.
    """
    tell(_inputs(clip, body))
    if start is not None:
        tell([start.about.sentence()])
    run = partial(fit_clip, clip, body, config, start=start, shape=shape)
    last = config.last_phase
    fit, summary = _fit_and_write(run, clip, body, folder, last_phase=last, command=command, begins=begins)
    tell(f"Note: {warning}" for warning in fit.warnings[len(clip.notes) :])
    written = [FIT_NAME, SUMMARY_NAME]
    if options.overlay and _overlay_written(folder / OVERLAY_NAME, fit, clip, body):
        written.append(OVERLAY_NAME)
    _emit_result(folder, clip, fit, summary, written)
    print(printable("\n".join([*report(summary), f"Wrote {', '.join(written)} into {folder}"])))
    return Outcome(fit=fit, body=body, summary=summary)


def _fit_and_write(
    run: Callable[..., object],
    clip: Clip,
    body: BodyModel,
    folder: Path,
    *,
    last_phase: int,
    command: str,
    begins: Callable[[], None],
) -> tuple[FitResult, dict[str, Any]]:
    """Run all phases, and write the result after each."""
    finished: PhaseFinished | None = None
    summary: dict[str, Any] = {}
    progress = ProgressShown(range(1, last_phase + 1))

    def take(event: FitEvent) -> None:
        nonlocal finished, summary
        progress.show(event)
        if isinstance(event, PhaseFinished):
            if finished is None:
                begins()
            complete = event.phase == last_phase
            summary = write_result(folder, event.so_far, clip, body, complete=complete, command=command)
            finished = event

    try:
        with closing(progress):
            run(tell=take)
    except BaseException:
        stayed = "Stopped before phase 1 had finished. Nothing was written."
        if finished is not None:
            stayed = f"Stopped. The result up to phase {finished.phase} is in {folder}"
        tell([stayed])
        raise
    assert finished is not None
    return finished.so_far, summary


def _emit_result(folder: Path, clip: Clip, fit: FitResult, summary: dict[str, Any], written: Sequence[str]) -> None:
    for warning in fit.warnings:
        emit(Note(text=warning))
    for phase, error in summary["reprojection_px"].items():
        figures = {f"reprojection_px_{name}": value for name, value in error.items()}
        figures["jitter_mm_per_frame2"] = summary["jitter"][phase]["camera_space_mm_per_frame2"]
        emit_figures(clip.name, f"{phase[:-1]} {phase[-1]}", figures)
    emit_wrote(*(folder / name for name in written))


def _overlay_written(path: Path, fit: FitResult, clip: Clip, body: BodyModel) -> bool:
    try:
        emit(Step(step="overlay", title="Overlay video"))
        write_comparison(path, fit, clip, body, progress=told("overlay"))
        emit(StepDone(step="overlay"))
    except (InputError, OSError) as error:
        tell([f"{path.name} was not written, but the fit is complete. {error}"])
        return False
    return True


def _inputs(clip: Clip, body: BodyModel) -> list[str]:
    source = body.source.name if body.source else body.kind
    return [*described(clip), f"Body {source} ({body.gender})", *notes_of(clip)]


def report(summary: dict[str, Any]) -> list[str]:
    """The main figures as lines of a table, and the ground."""
    parts = "".join(f"{name:>8}" for name in ERROR_GROUPS)
    lines = [f"{'':9}{'reprojection px':>18}{parts} (95 %){'jitter mm/frame²':>19}{'seconds':>10}"]
    for phase, error in summary["reprojection_px"].items():
        found = [error["median"], *(error[f"{name}_p95"] for name in ERROR_GROUPS)]
        median, *off = ("-" if e is None else f"{e:.1f}" for e in found)
        jitter = summary["jitter"][phase]["camera_space_mm_per_frame2"]
        title = f"{phase[:-1]} {phase[-1]}"
        lines.append(
            f"{title:9}{median:>18}{''.join(f'{px:>8}' for px in off)}{jitter:>26.1f}{summary['seconds'][phase]:>10.1f}"
        )
    return lines if summary["ground"] is None else [*lines, summary["ground"]["text"]]


def tell(lines: Iterable[str]) -> None:
    """Print lines on the standard error."""
    for line in lines:
        print(printable(line), file=sys.stderr, flush=True)


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
                Progress(
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
