"""A queue of tasks for processes of this computer: new interpreters that ignore Ctrl-C and end with their parent."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Literal

import msgspec

CONTEXT = multiprocessing.get_context("spawn")
"""Start method. A forked process may hang if its parent has used torch."""
_BETWEEN = 0.5
"""Seconds between two reports within a step."""


class Work(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The progress of a task in the background."""

    step: str
    """In words."""
    share: float | None = None
    """0 to 1."""
    ended: Literal["", "failed", "done"] = ""
    """How; `step` then says why, or what was done."""


Report = Callable[[Work], None]
Task = Callable[[Report], Any]
"""Is sent to a process, and returns what is sent back. What it raises ends the process."""


@dataclass(frozen=True, kw_only=True)
class Ended:
    """The end of a task."""

    result: Any = None
    died: str = ""
    """How its process died, instead of a result: the rest of "Its process ended ..."."""


@dataclass
class _Worker:
    """A process, this end of the pipe to it, and the key of its task; None: it has none."""

    process: BaseProcess
    pipe: Connection
    key: Hashable = None

    def end(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.join()
        self.pipe.close()

    def how_it_ended(self) -> str:
        """Wait for the end of a process that has closed its pipe."""
        self.process.join()
        code = self.process.exitcode
        return f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"


@dataclass(kw_only=True)
class ProcessQueue:
    """Tasks by key, done in their order. Not thread-safe."""

    processes: int = 1
    """Number of tasks that run at the same time. Each process does one after the other."""
    tries: int = 1
    """How often a task is begun whose process dies; again at the end of the queue."""
    _waiting: dict[Hashable, Task] = field(default_factory=dict)
    _running: dict[Hashable, Task] = field(default_factory=dict)
    _deaths: dict[Hashable, int] = field(default_factory=dict)
    _workers: list[_Worker] = field(default_factory=list)

    @property
    def busy(self) -> bool:
        """Whether a task waits or runs."""
        return bool(self._waiting or self._running)

    def add(self, key: Hashable, task: Task) -> None:
        """Append a task."""
        self._waiting[key] = task

    def cancel(self, key: Hashable) -> None:
        """Remove a task, and kill its process."""
        self._waiting.pop(key, None)
        if self._running.pop(key, None) is not None:
            self._remove(next(worker for worker in self._workers if worker.key == key))

    def news(self, seconds: float | None = None) -> list[tuple[Any, Work | Ended]]:
        """Start what can be started, and wait until something is reported; empty if nothing is in time."""
        self._begin()
        ends = [end for worker in self._workers for end in (worker.pipe, worker.process.sentinel)]
        ready = wait(ends, seconds)
        reports = (self._heard(w) for w in list(self._workers) if w.pipe in ready or w.process.sentinel in ready)
        return [one for one in reports if one is not None]

    def close(self) -> None:
        """Kill all processes; nothing else is started."""
        self._waiting.clear()
        self._running.clear()
        for worker in list(self._workers):
            self._remove(worker)

    def _begin(self) -> None:
        free = [worker for worker in self._workers if worker.key is None]
        while self._waiting and (free or len(self._workers) < self.processes):
            worker = free.pop() if free else self._started()
            worker.key = next(iter(self._waiting))
            task = self._running[worker.key] = self._waiting.pop(worker.key)
            with suppress(OSError):  # its sentinel shows a process that has just died
                worker.pipe.send(task)
        for worker in free:  # its memory is of use to others
            self._remove(worker)

    def _started(self) -> _Worker:
        ours, theirs = CONTEXT.Pipe()
        process = CONTEXT.Process(target=_serve, args=(theirs,), daemon=True)
        with _deaf_to_interrupts():
            process.start()
        theirs.close()
        self._workers.append(_Worker(process, ours))
        return self._workers[-1]

    def _remove(self, worker: _Worker) -> None:
        self._workers.remove(worker)
        worker.end()

    def _heard(self, worker: _Worker) -> tuple[Any, Work | Ended] | None:
        key = worker.key
        try:
            news = worker.pipe.recv()
        except (EOFError, OSError):
            news = Ended(died=worker.how_it_ended())
            self._remove(worker)
            if key is not None and self._again(key):
                return None
        if isinstance(news, Ended):
            worker.key = None
            self._running.pop(key, None)
        return None if key is None else (key, news)

    def _again(self, key: Hashable) -> bool:
        """Whether the task of a process that has died waits again."""
        self._deaths[key] = self._deaths.get(key, 0) + 1
        if self._deaths[key] < self.tries:
            self._waiting[key] = self._running.pop(key)
        return key in self._waiting


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Processes started inside ignore Ctrl-C, which a terminal sends to all of them; their parent handles it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


# --- in the process ---


def _serve(pipe: Connection) -> None:
    """Do the tasks that come through the pipe until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:  # whenever and however that ends
        parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            task = pipe.recv()
            pipe.send(Ended(result=task(_seldom(pipe.send))))


def _seldom(report: Report) -> Report:
    """The same report, at most twice a second within a step."""
    step, reported = "", 0.0

    def seldom(work: Work) -> None:
        nonlocal step, reported
        if work.step != step or time.monotonic() > reported + _BETWEEN:
            step, reported = work.step, time.monotonic()
            report(work)

    return seldom
