"""`tcfit batch`: fit many clips, and continue a list that was stopped."""

import os
import shlex
import sys
import time
from collections.abc import Callable, Hashable, Iterable, Sequence
from contextlib import closing
from pathlib import Path

from rich.console import Console
from tqdm import tqdm

from fitting_core.errors import InputError
from fitting_core.fit.fused.ready import cores
from fitting_core.io.known_shape import read_known_shape
from tcfit_app.batch.clip_fit import tidy
from tcfit_app.batch.columns import LEAST_PART
from tcfit_app.batch.executors import Executor, LocalProcesses, RayCluster
from tcfit_app.batch.inputs import SHAPE_NAME, detector_of, detector_version, missing_input
from tcfit_app.batch.manifest import ClipTask, Complaints, read_manifest
from tcfit_app.batch.outcome import FAILURES, SUMMARY_CSV, ClipOutcome, outcome_of, show_summary, write_summary
from tcfit_app.batch.records import Record, batch_folder, done_record, failed_path, patient_lock, write_json, write_log
from tcfit_app.batch.rounds import Course, Round, with_shape
from tcfit_app.cli.json_lines import ClipEnded, StepProgress, emit, emit_wrote
from tcfit_app.fitting.process_queue import Work
from tcfit_app.options.batch import BatchOptions
from tcfit_app.options.preparing import body_file, check_out, compile_kernels, prepare_solver
from tcfit_app.project.storage.accessing import accessing

_PATIENCE = 3.0
"""Seconds to wait for the lock of a batch that was killed."""


def run_batch(options: BatchOptions, *, command: str = "") -> int:
    """Fit the unfinished clips of a list, and report the outcome of each.

    Returns:
        The exit code: 1 if clips failed, now or before.

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
    folder = batch_folder(options.manifest)
    course = Course(tasks, folder, retry=options.retry and not options.report)
    if options.report:
        return _reported(course)
    _check(course, complaints, here=options.ray is None)
    complaints.raise_any()
    held = patient_lock(folder, seconds=_PATIENCE, wanted="fit this list")
    try:
        _run(_executor(options), course)
        rows = _told(course, time.monotonic() - begin)
    except KeyboardInterrupt:
        rows = _told(course, time.monotonic() - begin)
        left = sum(row.state == "left" for row in rows)
        print(f"Stopped. The same command continues with the {left} remaining clips.")
        raise
    finally:
        held.release()
    return int(any(row.state in FAILURES for row in rows))


def _reported(course: Course) -> int:
    """Report the state of each clip without fitting."""
    for _ in course.later():
        pass
    with accessing(course.folder):
        course.folder.mkdir(parents=True, exist_ok=True)
    rows = _told(course, 0.0)
    return int(any(row.state in FAILURES for row in rows))


def _told(course: Course, seconds: float) -> list[ClipOutcome]:
    """Write and print the outcome."""
    outcomes = [course.outcome(place) for place in range(len(course.tasks))]
    rows = [outcome_of(task, *found) for task, found in zip(course.tasks, outcomes, strict=True)]
    folder = course.folder
    with accessing(folder):
        write_summary(folder, rows, seconds=seconds)
    show_summary(rows, seconds=seconds, console=Console())
    emit_wrote(folder / SUMMARY_CSV)
    common = _common_folder([task.out.absolute().parent for task in course.tasks])
    print(f"Wrote {folder / SUMMARY_CSV}. To see the clips: {shlex.join(['tcfit', 'review', common])}")
    return rows


def _common_folder(folders: Sequence[Path]) -> str:
    """The folder that holds all results; that of the first if they are on several drives."""
    try:
        return os.path.commonpath(folders)
    except ValueError:
        return str(folders[0])


def _executor(options: BatchOptions) -> Executor:
    if options.ray is not None:
        return RayCluster(options.ray[0] if options.ray else None, options.jobs)
    return LocalProcesses(options.jobs or cores())


def _run(executor: Executor, course: Course) -> None:
    """Run the rounds, one after the other."""
    _work_off(executor, course.first, course.folder)
    for later in course.later():
        for index in later.to_do:
            task = later.tasks[index]
            if task.form == "shape" and (task.out / SHAPE_NAME).exists():
                print(f"{task.subject}: the clips have changed, or their settings, so the shape is estimated again.")
                print("If it differs, all clips of the subject are fitted again.")
        _work_off(executor, later, course.folder)


def _work_off(executor: Executor, work: Round, folder: Path) -> None:
    """Run the unfinished tasks of a round, and store each record in it."""
    for index in work.before:
        tidy(work.tasks[index])
    to_do = work.to_do
    tasks = [work.tasks[index] for index in to_do]
    if tasks and isinstance(executor, LocalProcesses):
        compile_kernels(tasks[0].config)  # once, not in each process
    progress = _Lines(len(work.tasks), len(work.before), tasks, work.what)
    with closing(progress), closing(executor.run(tasks, folder)) as all_news:
        for index, news in all_news:
            if isinstance(news, Record):
                _keep(folder, tasks[index], news)
                work.records[to_do[index]] = news
            progress.show(index, news)


def _keep(folder: Path, task: ClipTask, record: Record) -> None:
    path = failed_path(folder, task)
    with accessing(path):
        path.parent.mkdir(exist_ok=True)
        if record.state == "failed":
            write_json(path, record)
            write_log(folder, "failed", task, reason=record.reason)
        else:
            path.unlink(missing_ok=True)


class _Lines:
    """Prints a line for each clip that ends; on a terminal, a bar with the running clips below them."""

    def __init__(self, total: int, before: int, tasks: list[ClipTask], what: str) -> None:
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
            tqdm.write(f"{what}: {before} of {total} were done, or failed, in an earlier run.", file=sys.stdout)

    def show(self, index: int, news: Work | Record) -> None:
        task = self._tasks[index]
        if isinstance(news, Record):
            self._running.pop(index, None)
            self._count += 1
            emit(
                ClipEnded(
                    clip=task.name,
                    state=news.state,
                    place=self._count,
                    total=self._total,
                    seconds=news.seconds,
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

    def _line(self, task: ClipTask, record: Record) -> str:
        place = f"[{self._count:>{len(str(self._total))}}/{self._total}]"
        head = f"{place} {record.state:6} {task.name:{self._width}} {record.seconds:7.1f} s"
        if record.figures is None:
            return f"{head}  {record.reason.splitlines()[0]}"
        off = ", ".join(f"{part} {px:.0f} px" for part, px in record.figures.off.items())
        return f"{head}  {record.figures.frames} frames{off and f'; 95 % off by less than {off}'}"

    def close(self) -> None:
        self._bar.close()


def _check(course: Course, complaints: Complaints, *, here: bool) -> None:
    """Report what would prevent a fit; `here`: also of this computer's devices and detectors."""
    to_do = [course.tasks[place] for place in course.first.to_do]
    for task in to_do:
        for column, path in missing_input(task):
            complaints.add(task.line, f"{path} does not exist.", column)
    _check_each(to_do, complaints, lambda task: task.fit.shape and read_known_shape(task.fit.shape), "shape")
    to_do += [task for task in course.waiting() if not done_record(with_shape(task, course.folder))]
    _check_each(
        to_do,
        complaints,
        lambda task: check_out(task.out, overwrite=task.fit.overwrite or task.form == "project"),
        "out",
    )
    if here:
        devices = _first_by(to_do, lambda task: (task.config.device, task.config.precision))
        _check_each(devices, complaints, lambda task: prepare_solver(task.config, 1))
        detectors = _first_by([task for task in to_do if detector_of(task)], detector_of)
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
