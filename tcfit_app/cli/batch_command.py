"""`tcfit batch`: fit many clips, and go on where an earlier run of the same list was stopped."""

import sys
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from tqdm import tqdm

from fitting_core.errors import InputError
from tcfit_app.batch.clip_fit import tidy
from tcfit_app.batch.fingerprint import missing_input
from tcfit_app.batch.local import Crew, Ended, LocalProcesses, News
from tcfit_app.batch.manifest import ClipTask, Complaints, read_manifest
from tcfit_app.batch.on_ray import RayCluster
from tcfit_app.batch.outcome import FAILURES, SUMMARY_CSV, Row, row_of, show_summary, write_summary
from tcfit_app.batch.records import (
    Record,
    batch_folder,
    done_record,
    failed_path,
    failed_record,
    patient_lock,
    write_log,
    write_record,
)
from tcfit_app.bench.machine import cores
from tcfit_app.options.batch import BatchOptions
from tcfit_app.options.preparing import body_file, check_out, compile_kernels, prepare_solver
from tcfit_app.project.storage.accessing import accessing

_PATIENCE = 3.0
"""Seconds to wait for a batch of the same list that was killed."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Clips to fit, and how the others went before; by place in the list."""

    tasks: Sequence[ClipTask]
    to_do: tuple[int, ...]
    before: dict[int, Record]


def run_batch(options: BatchOptions, *, command: str = "") -> int:
    """Fit all clips of a list that are not done yet, and say how each went.

    Args:
        options: The command line.
        command: The same as text, for the record.

    Returns:
        The exit code: 1 if clips have failed, now or before.

    Raises:
        InputError: The list or the command line has errors; nothing has been started then.
        KeyboardInterrupt: Stopped; what was done is kept.
    """
    if options.jobs is not None and options.jobs < 1:
        raise InputError(f"--jobs is {options.jobs}; expected 1 or more, up to the number of cores.")
    begin = time.monotonic()
    complaints = Complaints(options.manifest)
    tasks = read_manifest(options, complaints, command=command)
    folder = batch_folder(options.manifest)
    todo = plan(tasks, folder, complaints, retry=options.retry, here=options.ray is None)
    complaints.raise_any()
    if todo.to_do and options.ray is None:
        compile_kernels(tasks[todo.to_do[0]].config)  # once, and not in each of the processes
    held = patient_lock(folder, seconds=_PATIENCE, wanted="fit this list")
    ended: dict[int, Record] = {}
    try:
        _run(_crew(options), todo, folder, ended)
        rows = _told(todo, ended, folder, time.monotonic() - begin)
    except KeyboardInterrupt:
        _told(todo, ended, folder, time.monotonic() - begin)
        print(f"Stopped. The same command goes on with the {len(todo.to_do) - len(ended)} clips that are left.")
        raise
    finally:
        held.release()
    return int(any(row.state in FAILURES for row in rows))


def _told(todo: Plan, ended: dict[int, Record], folder: Path, seconds: float) -> list[Row]:
    """The outcome, in files and on the terminal."""
    rows = [
        row_of(task, todo.before.get(index) or ended.get(index), before=index in todo.before)
        for index, task in enumerate(todo.tasks)
    ]
    with accessing(folder):
        write_summary(folder, rows, seconds=seconds)
    show_summary(rows, seconds=seconds, console=Console())
    print(f"A row for each clip is in {folder / SUMMARY_CSV}")
    return rows


def _crew(options: BatchOptions) -> Crew:
    if options.ray is not None:
        return RayCluster(options.ray[0] if options.ray else None, options.jobs)
    return LocalProcesses(options.jobs or cores())


def _run(crew: Crew, todo: Plan, folder: Path, ended: dict[int, Record]) -> None:
    """Fit what is to be done; `ended` takes the record of each clip as it comes."""
    for index in todo.before:
        tidy(todo.tasks[index])
    tasks = [todo.tasks[index] for index in todo.to_do]
    progress = _Lines(len(todo.tasks), len(todo.before), tasks)
    with closing(progress), closing(crew.run(tasks, folder)) as all_news:
        for news in all_news:
            if isinstance(news, Ended):
                _keep(folder, tasks[news.index], news.record)
                ended[todo.to_do[news.index]] = news.record
            progress.show(news)


def _keep(folder: Path, task: ClipTask, record: Record) -> None:
    path = failed_path(folder, task)
    with accessing(path):
        path.parent.mkdir(exist_ok=True)
        if record.state == "failed":
            write_record(path, record)
            write_log(folder, "failed", task, reason=record.reason)
        else:
            path.unlink(missing_ok=True)


class _Lines:
    """A line on the standard output for each clip that ends; on a terminal, below them, what is being fitted."""

    def __init__(self, total: int, before: int, tasks: list[ClipTask]) -> None:
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
            tqdm.write(f"{before} of {total} clips were done or have failed before.", file=sys.stdout)

    def show(self, news: News) -> None:
        """Tell of it."""
        task = self._tasks[news.index]
        if isinstance(news, Ended):
            self._running.pop(news.index, None)
            self._count += 1
            tqdm.write(self._line(task, news.record), file=sys.stdout)
            sys.stdout.flush()
            self._bar.update(1)
        else:
            self._running[news.index] = f"phase {news.phase} {news.share:.0%}" if news.phase else "reading"
        self._bar.set_postfix_str(", ".join(f"{self._tasks[i].name} {how}" for i, how in self._running.items()))

    def _line(self, task: ClipTask, record: Record) -> str:
        place = f"[{self._count:>{len(str(self._total))}}/{self._total}]"
        head = f"{place} {record.state:6} {task.name:{self._width}} {record.seconds:7.1f} s"
        if record.figures is None:
            return f"{head}  {record.reason.splitlines()[0]}"
        pixels = record.figures.reprojection_px
        error = "" if pixels is None else f", {pixels:.1f} px"
        return f"{head}  {record.figures.frames} frames{error}"

    def close(self) -> None:
        """The bar goes."""
        self._bar.close()


def plan(
    tasks: Sequence[ClipTask], folder: Path, complaints: Complaints, *, retry: bool = False, here: bool = True
) -> Plan:
    """Look at what is there of each clip; what stands in the way of one goes to `complaints`.

    Args:
        tasks: The list.
        folder: The batch's.
        complaints: Takes every error.
        retry: Fit those again that have failed.
        here: They are fitted on this computer: its devices count.
    """
    _check_bodies(tasks, complaints)
    complaints.raise_any()  # Without a body nothing can be compared.
    to_do: list[int] = []
    before: dict[int, Record] = {}
    for index, task in enumerate(tasks):
        record = done_record(task) or (None if retry else failed_record(folder, task))
        if record:
            before[index] = record
            continue
        to_do.append(index)
        for column, path in missing_input(task):
            complaints.add(task.line, f"{path} does not exist.", column)
        try:
            check_out(task.out, overwrite=task.fit.overwrite or task.project)
        except InputError as error:
            complaints.add(task.line, str(error).removeprefix("--out "), "out")
    if here:
        _check_devices([tasks[index] for index in to_do], complaints)
    return Plan(tasks=tasks, to_do=tuple(to_do), before=before)


def _check_bodies(tasks: Sequence[ClipTask], complaints: Complaints) -> None:
    """Each body model once, in the first line that asks for it."""
    first = {task.fit.body: task for task in reversed(tasks)}
    for options, task in first.items():
        try:
            body_file(options)
        except InputError as error:
            complaints.add(task.line, str(error))


def _check_devices(tasks: Sequence[ClipTask], complaints: Complaints) -> None:
    first = {(task.config.device, task.config.precision): task for task in reversed(tasks)}
    for task in first.values():
        try:
            prepare_solver(task.config, 1)
        except InputError as error:
            complaints.add(task.line, str(error))
