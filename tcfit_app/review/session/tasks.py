"""Slow work off the drawing thread: all of it except the fits themselves (`Worker`).

There are two kinds. Values are requested by key at every draw until they are ready, and computed one after the other:
curves and figures in one thread, fits from disk in another. Tasks are started by someone, report progress, can be
cancelled, and have a thread each: exports, imports, detections. Both end in `Tasks`, on the drawing thread.
"""

import logging
import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from queue import SimpleQueue
from typing import Any, Generic, Literal, TypeVar, get_args

import torch

from fitting_core.errors import InputError
from fitting_core.memory import give_back
from tcfit_app.fitting.fit_progress import Progress, in_words

KEPT = 64
"""Number of values kept, the most recently requested."""
IN_USE = 5.0
"""Seconds after its last request until a value counts as unwanted; tabs request several times a second."""
_PATIENCE = 10.0
"""How long `close` waits for work to notice that it was cancelled, seconds."""
Value = TypeVar("Value")
Step = Callable[[str, float | None], None]
"""Receives the current step and the progress (0 to 1; None: unknown). Raises to end the work."""
Work = Callable[[Step], Value]
Lane = Literal["figures", "disk"]
_log = logging.getLogger(__name__)


class _Cancelled(Exception):
    """Ends the work from inside."""


class Task(Generic[Value]):
    """Work from start to end: finished, cancelled, or failed with a reason."""

    def __init__(self, title: str, owner: object, then: "Callable[[Task[Value]], None]") -> None:
        self.title, self.owner, self.then = title, owner, then
        self.state: Literal["running", "finished", "cancelled", "failed"] = "running"
        self.text = ""
        self.share: float | None = None
        self.reason = ""
        """Why it failed, for users."""
        self.value: Value | None = None
        """What it produced, until `then` has returned; see `result`."""
        self._error: Exception | None = None
        self._cancelled = threading.Event()
        self._progress, self._began = Progress(), time.monotonic()

    def cancel(self) -> None:
        """Stop at the work's next step."""
        self._cancelled.set()

    @property
    def stopping(self) -> bool:
        """Whether it was cancelled but has not ended yet."""
        return self._cancelled.is_set() and self.state == "running"

    @property
    def words(self) -> str:
        """The current step, and the remaining time once it is known."""
        return in_words(self.text, None if self.share is None else self._progress.remaining)

    def result(self) -> Value:
        """What a finished task produced, until `then` has returned; raises the error of a failed one."""
        if self._error is not None:
            raise self._error
        assert self.state == "finished"
        return self.value  # pyright: ignore[reportReturnType]

    def report(self, text: str, share: float | None) -> None:
        """See `Step`."""
        if self._cancelled.is_set():
            raise _Cancelled
        self.text, self.share = text, share
        if share is not None:
            if share < self._progress.fraction:  # the next part of the work
                self._progress = Progress()
            self._progress.worked(time.monotonic() - self._began)
            self._progress.advance(share)

    def run(self, work: Work[Value]) -> None:
        """Do the work, on the task's own thread."""
        try:
            self.report("", None)
            self.value, self.state = work(self.report), "finished"
        except _Cancelled:
            self.state = "cancelled"
        except Exception as error:  # any error: reported to the user
            if not isinstance(error, InputError):
                _log.exception("%s failed", self.title)
            self.reason = reason_of(error)
            self._error, self.state = error, "failed"


def reason_of(error: Exception) -> str:
    """What went wrong, for users: only the kind of an unforeseen error; the log has the rest."""
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: {error.filename}" if error.filename else error.strerror
    kind = type(error).__name__
    return f"Something went wrong inside tcfit ({kind}). Its terminal has the details: please report them."


class _Made:
    """A value, or why it is missing."""

    def __init__(self, compute: Callable[[], Any]) -> None:
        self._compute: Callable[[], Any] | None = compute
        self.asked = time.monotonic()
        self.done = self.skipped = False
        self.value: Any = None
        self.problem = ""

    @property
    def in_use(self) -> bool:
        return time.monotonic() - self.asked < IN_USE

    def make(self) -> None:
        compute, self._compute = self._compute, None  # it refers to a whole fit
        assert compute is not None, "each value is computed once"
        try:
            self.value = compute()
        except Exception as error:
            _log.log(logging.INFO if isinstance(error, InputError) else logging.ERROR, "A value failed", exc_info=error)
            self.problem = reason_of(error)
        self.done = True


class Tasks:
    """For the drawing thread only: all methods are called there, and results are delivered there."""

    def __init__(self) -> None:
        self.arrived: Callable[[], None] = lambda: None
        """Called from another thread when something has ended."""
        self.known: OrderedDict[Hashable, _Made] = OrderedDict()
        """Values by key, computed or pending."""
        self._running: dict[Task[Any], threading.Thread] = {}
        self._ended: SimpleQueue[Task[Any]] = SimpleQueue()
        self._waiting: dict[Lane, SimpleQueue[_Made | None]] = {lane: SimpleQueue() for lane in get_args(Lane)}
        self._makers = [
            threading.Thread(target=self._make_values, args=(waiting,), name=f"tcfit: {lane}", daemon=True)
            for lane, waiting in self._waiting.items()
        ]
        for maker in self._makers:
            maker.start()

    # --- values ---

    def get(self, key: Hashable, compute: Callable[[], Value], *, lane: Lane = "figures") -> Value | None:
        """The value of a key, or None while it is computed; a failed one stays None, and `problem` says why.

        Args:
            key: Identifies everything the value depends on.
            compute: Computes it.
            lane: In which thread: reads of milliseconds do not wait behind long computations.
        """
        made = self.known.get(key)
        if made is None:
            made = self.known[key] = _Made(compute)
            self._waiting[lane].put(made)
            self._forget()
        made.asked = time.monotonic()
        if made.skipped:
            made.skipped = False
            self._waiting[lane].put(made)
        self.known.move_to_end(key)
        return made.value if made.done else None

    def problem(self, key: Hashable) -> str:
        """Why a key has no value and will not get one; empty otherwise."""
        made = self.known.get(key)
        return made.problem if made is not None and made.done else ""

    def drop(self, key: Hashable) -> None:
        """Forget a value, so that it is recomputed on request."""
        self.known.pop(key, None)

    def _forget(self) -> None:
        """Evict values, but none in use: tabs that evicted each other's values would recompute them for ever."""
        while len(self.known) > KEPT and not next(iter(self.known.values())).in_use:
            self.known.popitem(last=False)

    def _make_values(self, waiting: "SimpleQueue[_Made | None]") -> None:
        torch.set_num_threads(1)
        while (made := waiting.get()) is not None:
            if made.in_use:
                made.make()
                self.arrived()
                if waiting.empty():
                    give_back()
            else:
                made.skipped = True

    # --- tasks ---

    def submit(
        self,
        title: str,
        work: Work[Value],
        *,
        owner: object = None,
        then: Callable[[Task[Value]], None] = lambda task: None,
    ) -> Task[Value]:
        """Start a task.

        Args:
            title: What it is, for users and the log.
            work: Given a `Step`, which it calls at every step.
            owner: Who started it; `leave` cancels the owner's tasks.
            then: Given the ended task, on the drawing thread; not called if the owner has left.
        """
        task = Task(title, owner, then)
        thread = threading.Thread(target=self._run, args=(task, work), name=f"tcfit: {title}", daemon=True)
        self._running[task] = thread
        thread.start()
        return task

    @property
    def busy(self) -> bool:
        """Whether any task is unfinished."""
        return bool(self._running)

    def _run(self, task: Task[Value], work: Work[Value]) -> None:
        task.run(work)
        self._ended.put(task)
        self.arrived()

    def take(self) -> None:
        """Deliver the tasks that have ended since the last call."""
        while not self._ended.empty():
            task = self._ended.get()
            if self._running.pop(task, None) is not None:
                try:
                    task.then(task)
                except Exception:
                    _log.exception("%s has ended, but its result could not be processed", task.title)
                task.value = None  # it may be a file of some 100 MB

    def leave(self, owner: object) -> None:
        """Cancel the tasks of an owner who is gone, and deliver nothing. They count as running until they have ended,
        because the project must stay open that long."""
        for task in self._running:
            if task.owner is owner:
                task.cancel()
                task.then = lambda task: None

    def close(self) -> None:
        """End everything, waiting a while for running work."""
        for waiting in self._waiting.values():
            waiting.put(None)
        for made in self.known.values():
            made.asked = -math.inf  # not needed any more
        for task in self._running:
            task.cancel()
        end = time.monotonic() + _PATIENCE
        for thread in (*self._running.values(), *self._makers):
            thread.join(max(0.0, end - time.monotonic()))
