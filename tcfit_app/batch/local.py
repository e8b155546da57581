"""Fits clips in processes on this computer.

Each process fits one clip after the other and tells of it through a pipe. It ends with the process that started it.
"""

import time
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Protocol

from fitting_core.detect.detecting import DetectionProgress
from fitting_core.fit.events import FitEvent, Iteration
from tcfit_app.batch.clip_fit import failure, fit_clip, one_thread
from tcfit_app.batch.inputs import inputs_of
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.batch.records import Record
from tcfit_app.fitting import child_processes
from tcfit_app.fitting.child_processes import Child


@dataclass(frozen=True, kw_only=True)
class TaskUnderway:
    """A clip is being fitted."""

    index: int
    """Which of the tasks."""
    phase: int = 0
    """0: its keypoints are found, or it has only begun."""
    share: float = 0.0
    """Of the phase, or of the frames whose keypoints are found."""


@dataclass(frozen=True, kw_only=True)
class TaskEnded:
    """A clip is done, or has failed."""

    index: int
    record: Record


News = TaskUnderway | TaskEnded


class Crew(Protocol):
    """Fits clips, several at a time."""

    def run(self, tasks: Sequence[ClipTask], folder: Path) -> Generator[News, None, None]:
        """Fits them all; each ends exactly once. Closing the generator stops at once and leaves nothing half-done that
        matters. `folder` is the batch's."""
        ...


_TRIES = 2
"""How often a clip's process may die: the first time may not be its fault, as when memory runs out."""
_BETWEEN = 0.5
"""Seconds between two progress messages about a clip."""


@dataclass
class _Worker:
    """A process, and the task that it fits."""

    child: Child
    index: int | None = None


@dataclass
class _Work:
    """What is to be done, and how often each clip was tried."""

    tasks: Sequence[ClipTask]
    folder: Path
    waiting: deque[int] = field(default_factory=deque)
    deaths: dict[int, int] = field(default_factory=dict)


class LocalProcesses:
    """Processes of this computer."""

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs

    def run(self, tasks: Sequence[ClipTask], folder: Path) -> Generator[News, None, None]:
        """See `Crew.run`."""
        work = _Work(tasks=tasks, folder=folder, waiting=deque(range(len(tasks))))
        workers: list[_Worker] = []
        try:
            for _ in range(min(self.jobs, len(tasks))):
                workers.append(_Worker(Child.started(_serve, folder)))
            while work.waiting or any(worker.index is not None for worker in workers):
                yield from _hand_out(work, workers)
                ready = wait([end for w in workers for end in (w.child.pipe, w.child.process.sentinel)])
                for worker in [w for w in workers if w.child.pipe in ready or w.child.process.sentinel in ready]:
                    yield from _heard(worker, workers, work)
        finally:
            for worker in workers:
                worker.child.end()


def _hand_out(work: _Work, workers: list[_Worker]) -> Iterator[News]:
    for worker in workers:
        if worker.index is None and work.waiting:
            index = work.waiting.popleft()
            with suppress(OSError):  # A process that has just died is found out by its sentinel.
                worker.child.pipe.send((index, work.tasks[index]))
            worker.index = index
            yield TaskUnderway(index=index)


def _heard(worker: _Worker, workers: list[_Worker], work: _Work) -> Iterator[News]:
    """News from a process; a new one replaces one that has died."""
    try:
        news = worker.child.pipe.recv()
    except (EOFError, OSError):
        how = worker.child.how_it_ended()
        worker.child.pipe.close()
        workers.remove(worker)
        if worker.index is not None:
            yield from _died(worker.index, how, work)
        if work.waiting:
            workers.append(_Worker(Child.started(_serve, work.folder)))
        return
    if isinstance(news, TaskEnded):
        worker.index = None
    yield news


def _died(index: int, how: str, work: _Work) -> Iterator[News]:
    """The clip is tried once more, at the end of the queue, or has failed."""
    work.deaths[index] = work.deaths.get(index, 0) + 1
    if work.deaths[index] < _TRIES:
        work.waiting.append(index)
        return
    reason = f"Its process ended {how}, {_TRIES} times. Memory may have run out: try fewer --jobs, or shorter clips."
    yield TaskEnded(index=index, record=failure(inputs_of(work.tasks[index]), reason))


def _serve(pipe: Connection, folder: Path) -> None:
    """Fit the clips that come through the pipe until it is closed."""
    child_processes.end_with_parent()
    one_thread()
    with suppress(EOFError, OSError):
        while True:
            index, task = pipe.recv()
            pipe.send(TaskEnded(index=index, record=_fitted(index, task, folder, pipe)))


def _fitted(index: int, task: ClipTask, folder: Path, pipe: Connection) -> Record:
    reported = time.monotonic()

    def report(event: FitEvent | DetectionProgress) -> None:
        nonlocal reported
        if isinstance(event, Iteration | DetectionProgress) and time.monotonic() > reported + _BETWEEN:
            reported = time.monotonic()
            phase = event.phase if isinstance(event, Iteration) else 0
            pipe.send(TaskUnderway(index=index, phase=phase, share=event.share))

    try:
        return fit_clip(task, folder, report)
    except KeyboardInterrupt:  # raised by a plugin: the process is deaf to those of a terminal
        return failure(inputs_of(task), "A plugin interrupted the fit (KeyboardInterrupt).")
