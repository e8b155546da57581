"""Slow work beside the thread that draws: the one way in which it is done, but for the fits themselves (`Worker`).

There are two kinds. Values are asked for by key at every draw until they are there, and made one after the other:
curves and figures by one thread, fits from the disk by another. Tasks are begun by somebody, say how far they are, can
be cancelled, and have a thread each: exports, imports, detections. Both end in `Tasks`, on the drawing thread.
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

KEPT = 64
"""Values that are remembered, those that were asked for last."""
IN_USE = 5.0
"""Seconds since it was last asked for until a value counts as not wanted any more; tabs ask several times a second."""
_PATIENCE = 10.0
"""Seconds for which `close` waits for work to notice that it was cancelled."""
Value = TypeVar("Value")
Step = Callable[[str, float | None], None]
"""Takes what is being done, and how far it is (0 to 1; None: unknown). Raises to end the work."""
Work = Callable[[Step], Value]
Lane = Literal["figures", "disk"]
_log = logging.getLogger(__name__)


class _Cancelled(Exception):
    """Ends the work from within."""


class Task(Generic[Value]):
    """Work from its start to its end, however that comes: finished, cancelled, or failed with a reason."""

    def __init__(self, title: str, owner: object, then: "Callable[[Task[Value]], None]") -> None:
        self.title, self.owner, self.then = title, owner, then
        self.state: Literal["running", "finished", "cancelled", "failed"] = "running"
        self.text = ""
        self.share: float | None = None
        self.reason = ""
        """Why it failed, for the user."""
        self.value: Value | None = None
        """What it has made, until `then` has returned; see `result`."""
        self._error: Exception | None = None
        self._cancelled = threading.Event()

    def cancel(self) -> None:
        """Stop at the work's next step."""
        self._cancelled.set()

    @property
    def stopping(self) -> bool:
        """Whether it was cancelled and has not ended yet."""
        return self._cancelled.is_set() and self.state == "running"

    def result(self) -> Value:
        """What a finished task has made, until `then` has returned; of one that failed, what went wrong is raised."""
        if self._error is not None:
            raise self._error
        assert self.state == "finished"
        return self.value  # pyright: ignore[reportReturnType]

    def report(self, text: str, share: float | None) -> None:
        """See `Step`."""
        if self._cancelled.is_set():
            raise _Cancelled
        self.text, self.share = text, share

    def run(self, work: Work[Value]) -> None:
        """Do it, on the task's own thread."""
        try:
            self.report("", None)
            self.value, self.state = work(self.report), "finished"
        except _Cancelled:
            self.state = "cancelled"
        except Exception as error:  # whatever it was: the user is told
            if not isinstance(error, InputError):
                _log.exception("%s failed", self.title)
            self.reason = reason_of(error)
            self._error, self.state = error, "failed"


def reason_of(error: Exception) -> str:
    """What went wrong, for the user: of an error that nobody foresaw only its kind; the log has the rest."""
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: {error.filename}" if error.filename else error.strerror
    kind = type(error).__name__
    return f"Something went wrong inside tcfit ({kind}). Its terminal has the details: please report them."


class _Made:
    """A value, or why there is none."""

    def __init__(self, compute: Callable[[], Any]) -> None:
        self.compute, self.asked = compute, time.monotonic()
        self.done = self.skipped = False
        self.value: Any = None
        self.problem = ""

    @property
    def in_use(self) -> bool:
        return time.monotonic() - self.asked < IN_USE

    def make(self) -> None:
        try:
            self.value = self.compute()
        except Exception as error:
            _log.log(logging.INFO if isinstance(error, InputError) else logging.ERROR, "A value failed", exc_info=error)
            self.problem = reason_of(error)
        self.done = True


class Tasks:
    """For the one thread that draws: all methods are called there, and what ends is told there."""

    def __init__(self) -> None:
        self.arrived: Callable[[], None] = lambda: None
        """Called, from another thread, when something has ended."""
        self.known: OrderedDict[Hashable, _Made] = OrderedDict()
        """Values by key, made and to be made."""
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
        """The value of a key, or None while it is made; what fails stays None, and `problem` says why.

        Args:
            key: Stands for everything that the value depends on.
            compute: Makes it.
            lane: Which thread does so: what comes from the disk in milliseconds does not wait for long computations.
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
        """Why a key has no value and will not get one; empty if that is not so."""
        made = self.known.get(key)
        return made.problem if made is not None and made.done else ""

    def drop(self, key: Hashable) -> None:
        """Forget a value: it is made again when it is asked for."""
        self.known.pop(key, None)

    def _forget(self) -> None:
        """Leave what is in use alone: tabs that evict each other's values would make them for ever."""
        while len(self.known) > KEPT and not next(iter(self.known.values())).in_use:
            self.known.popitem(last=False)

    def _make_values(self, waiting: "SimpleQueue[_Made | None]") -> None:
        torch.set_num_threads(1)
        while (made := waiting.get()) is not None:
            if made.in_use:
                made.make()
                self.arrived()
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
        """Begin some work.

        Args:
            title: What it is, for the user and the log.
            work: Is given a `Step`, which it calls at every step.
            owner: Who began it; `leave` ends it with them.
            then: Gets the task once it has ended, on the drawing thread; not if its owner has left.
        """
        task = Task(title, owner, then)
        thread = threading.Thread(target=self._run, args=(task, work), name=f"tcfit: {title}", daemon=True)
        self._running[task] = thread
        thread.start()
        return task

    @property
    def busy(self) -> bool:
        """Whether something that was begun has not ended."""
        return bool(self._running)

    def _run(self, task: Task[Value], work: Work[Value]) -> None:
        task.run(work)
        self._ended.put(task)
        self.arrived()

    def take(self) -> None:
        """Tell of the tasks that have ended since the last call."""
        while not self._ended.empty():
            task = self._ended.get()
            if self._running.pop(task, None) is not None:
                try:
                    task.then(task)
                except Exception:
                    _log.exception("%s has ended, and could not be taken up", task.title)
                task.value = None  # it may be a file of some 100 MB

    def leave(self, owner: object) -> None:
        """Cancel what somebody began who is gone, and tell nobody how it ends."""
        for task in [task for task in self._running if task.owner is owner]:
            task.cancel()
            del self._running[task]

    def close(self) -> None:
        """End everything; work that is being done is waited for, for a while."""
        for waiting in self._waiting.values():
            waiting.put(None)
        for made in self.known.values():
            made.asked = -math.inf  # nobody is there to look at it
        for task in self._running:
            task.cancel()
        end = time.monotonic() + _PATIENCE
        for thread in (*self._running.values(), *self._makers):
            thread.join(max(0.0, end - time.monotonic()))
