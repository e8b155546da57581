"""`tcfit batch`: fit many clips, and continue a list that was stopped."""

import os
import shlex
import sys
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from rich.console import Console
from tqdm import tqdm

from fitting_core.errors import InputError
from fitting_core.files.locking import locked
from fitting_core.fit.fused.ready import cores
from fitting_core.io.known_shape import read_known_shape
from fitting_core.keypoints import ERROR_GROUPS
from tcfit_app.batch.columns import LEAST_PART
from tcfit_app.batch.executors import News, fitted_by_ray, fitted_here
from tcfit_app.batch.inputs import detector_of, detector_version, missing_input
from tcfit_app.batch.manifest import ClipTask, Complaints, read_manifest
from tcfit_app.batch.outcome import SUMMARY_CSV, ClipOutcome, done_before, show_summary, write_summary
from tcfit_app.cli.json_lines import ClipEnded, StepProgress, emit, emit_wrote
from tcfit_app.fitting.process_queue import Work
from tcfit_app.home.found import BATCH_SUFFIX
from tcfit_app.options.batch import BatchOptions
from tcfit_app.options.preparing import body_file, check_out, compile_kernels, prepare_solver
from tcfit_app.project.storage.accessing import accessing

_LOCK = "batch.lock"


def run_batch(options: BatchOptions, *, command: str = "") -> int:
    """Fit the unfinished clips of a list, and report the outcome of each.

    Returns:
        The exit code: 1 if clips failed.

    Raises:
        InputError: The list or the command line has errors. Nothing is started then.
        KeyboardInterrupt: Stopped. Finished clips are kept.
    """
    if options.jobs is not None and options.jobs < 1:
        raise InputError(f"--jobs is {options.jobs}; expected 1 or more, up to the number of cores.")
    if options.part_minutes is not None and options.part_minutes not in LEAST_PART:
        raise InputError(f"--part-minutes is {options.part_minutes:g}; expected {LEAST_PART}.")
    begin = time.monotonic()
    complaints = Complaints(options.manifest)
    tasks = read_manifest(options, complaints, command=command)
    _check_each(_first_by(tasks, lambda task: task.fit.body), complaints, lambda task: body_file(task.fit.body))
    complaints.raise_any()  # the hash of a clip includes the body
    folder = options.manifest.with_name(f"{options.manifest.stem}{BATCH_SUFFIX}")
    with _alone(folder):
        rows = [done_before(task) or ClipOutcome(line=task.line, clip=task.name) for task in tasks]
        _check([task for task, row in zip(tasks, rows, strict=True) if row.state == "left"], complaints, options)
        complaints.raise_any()
        try:
            _fit(options, tasks, rows)
        except KeyboardInterrupt:
            left = sum(row.state == "left" for row in rows)
            print(f"Stopped. The same command continues with the {left} remaining clips.")
            raise
        finally:
            _report(folder, tasks, rows, time.monotonic() - begin)
    return int(any(row.state == "failed" for row in rows))


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the lock of a batch's folder. Raises InputError if another process has it, or it cannot be written."""
    with accessing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        lock = locked(folder / _LOCK)
    if lock is None:
        raise InputError(f"{folder}: another process fits this list. Wait for it, or stop it.")
    try:
        yield
    finally:
        with suppress(OSError):  # a folder with a summary stays, as does an open file on Windows
            (folder / _LOCK).unlink()
            folder.rmdir()
        os.close(lock)


def _report(folder: Path, tasks: Sequence[ClipTask], rows: Sequence[ClipOutcome], seconds: float) -> None:
    """Write and print the outcome."""
    with accessing(folder):
        write_summary(folder, rows)
    show_summary(rows, seconds=seconds, console=Console())
    emit_wrote(folder / SUMMARY_CSV)
    common = _common_folder([task.out.absolute().parent for task in tasks])
    print(f"Wrote {folder / SUMMARY_CSV}. To see the clips: {shlex.join(['tcfit', 'review', common])}")


def _common_folder(folders: Sequence[Path]) -> str:
    """The folder that holds all results; that of the first if they are on several drives."""
    try:
        return os.path.commonpath(folders)
    except ValueError:
        return str(folders[0])


def _news(options: BatchOptions, tasks: Sequence[ClipTask]) -> News:
    if options.ray is not None:
        return fitted_by_ray(tasks, options.ray[0] if options.ray else None, options.jobs)
    if tasks:
        compile_kernels(tasks[0].config)  # once, not in each process
    return fitted_here(tasks, options.jobs or cores())


def _fit(options: BatchOptions, tasks: Sequence[ClipTask], rows: list[ClipOutcome]) -> None:
    """Fit the clips that are left, and store the outcome of each in its row."""
    places = [place for place, row in enumerate(rows) if row.state == "left"]
    left = [tasks[place] for place in places]
    all_news, progress = _news(options, left), _Lines(len(tasks), left)
    with closing(progress), closing(all_news):
        for index, news in all_news:
            if isinstance(news, ClipOutcome):
                rows[places[index]] = news
            progress.show(index, news)


class _Lines:
    """Prints a line for each clip that ends; on a terminal, a bar with the running clips below them."""

    def __init__(self, total: int, tasks: list[ClipTask]) -> None:
        before = total - len(tasks)
        self._tasks, self._total, self._count = tasks, total, before
        self._running: dict[int, str] = {}
        self._width = min(40, max((len(task.name) for task in tasks), default=0))
        self._bar = tqdm(
            total=total,
            initial=before,
            file=sys.stderr,
            disable=not sys.stderr.isatty(),
            leave=False,
            dynamic_ncols=True,
            bar_format="{n_fmt}/{total_fmt} |{bar:20}| {elapsed} < {remaining}{postfix}",
        )
        if before:
            tqdm.write(f"{before} of {total} clips were finished before.", file=sys.stdout)

    def show(self, index: int, news: Work | ClipOutcome) -> None:
        task = self._tasks[index]
        if isinstance(news, ClipOutcome):
            self._running.pop(index, None)
            self._count += 1
            emit(
                ClipEnded(
                    clip=task.name,
                    state=news.state,
                    place=self._count,
                    total=self._total,
                    seconds=news.seconds or 0.0,
                    reason=news.reason,
                )
            )
            tqdm.write(self._line(task, news), file=sys.stdout)
            sys.stdout.flush()
            self._bar.update(1)
        else:
            share = news.share or 0.0
            emit(StepProgress(step=news.step, share=share, text="", clip=task.name))
            self._running[index] = f"{news.step} {share:.0%}" if share else news.step
        self._bar.set_postfix_str(", ".join(f"{self._tasks[i].name} {how}" for i, how in self._running.items()))

    def _line(self, task: ClipTask, row: ClipOutcome) -> str:
        place = f"[{self._count:>{len(str(self._total))}}/{self._total}]"
        head = f"{place} {row.state:6} {task.name:{self._width}} {row.seconds or 0.0:7.1f} s"
        if row.state == "failed":
            return f"{head}  {row.reason.splitlines()[0]}"
        shown = {name: getattr(row, f"{name}_p95_px") for name in ERROR_GROUPS}
        off = ", ".join(f"{part} {px:.0f} px" for part, px in shown.items() if px is not None)
        return f"{head}  {row.frames} frames{off and f'; 95 % off by less than {off}'}"

    def close(self) -> None:
        self._bar.close()


def _check(tasks: Sequence[ClipTask], complaints: Complaints, options: BatchOptions) -> None:
    """Report what would prevent a fit; without Ray also of this computer's devices and detectors."""
    for task in tasks:
        for column, path in missing_input(task):
            complaints.add(task.line, f"{path} does not exist.", column)
    _check_each(tasks, complaints, lambda task: task.fit.shape and read_known_shape(task.fit.shape), "shape")
    _check_each(tasks, complaints, lambda task: check_out(task.out, overwrite=options.overwrite), "out")
    if options.ray is None:
        devices = _first_by(tasks, lambda task: (task.config.device, task.config.precision))
        _check_each(devices, complaints, lambda task: prepare_solver(task.config, 1))
        detectors = _first_by([task for task in tasks if detector_of(task)], detector_of)
        _check_each(detectors, complaints, lambda task: detector_version(detector_of(task) or ""), "detector")


def _check_each(
    tasks: Iterable[ClipTask], complaints: Complaints, check: Callable[[ClipTask], object], column: str = ""
) -> None:
    """Report the tasks that a check refuses."""
    for task in tasks:
        try:
            check(task)
        except InputError as error:
            complaints.add(task.line, str(error).removeprefix("--out "), column)


def _first_by(tasks: Sequence[ClipTask], key: Callable[[ClipTask], Hashable]) -> Iterable[ClipTask]:
    """The first task for each key, so that a shared problem is reported once."""
    return {key(task): task for task in reversed(tasks)}.values()
