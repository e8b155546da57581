"""The fitting thread: jobs from a queue, and live corrections between two iterations of a job."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import closing
from itertools import count
from queue import SimpleQueue
from typing import Protocol

import numpy as np
import torch

from fitting_core.errors import InputError
from fitting_core.fit.events import Finished, FitEvent, FramesFitted, PhaseFinished
from fitting_core.fit.fitting import Refit
from fitting_core.memory import give_back
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting.jobs import Job
from tcfit_app.fitting.live import Correction, LiveCorrection, Target
from tcfit_app.fitting.reports import DragEnded, DragMoved, ErrandEnded, JobEnded, JobReported, JobStarted, Report

LINGER = 2.0
"""Seconds for which a job waits for a resting pointer before it continues under the drag."""
_log = logging.getLogger(__name__)


class Sink(Protocol):
    """Stores results before they are reported; called on the worker's thread."""

    def keep(self, job: Job, result: PhaseFinished | FramesFitted | FitResult) -> None:
        """Store a job's result. An exception makes the job fail."""
        ...


KeepDrag = Callable[[Correction, Target, Refit, int | None], None]
"""Stores a released drag, on the worker's thread: the correction, its keypoints' positions, all frames, and the log
entry of the release. An exception makes it fail."""


class LiveDrag:
    """A drag in progress. Only the newest move counts."""

    def __init__(
        self, number: int, correction: Correction, target: Target, keep: KeepDrag, changed: threading.Condition
    ) -> None:
        self.number, self.correction, self.keep = number, correction, keep
        self.live: LiveCorrection | None = None
        """The worker's own; created when it first handles the drag."""
        self._changed = changed
        self._target: Target | None = np.array(target, dtype=float)
        self.released = self.abandoned = False
        self.edit: int | None = None
        self.failed = False
        """Set by the caller: the fit no longer follows."""

    def move(self, target: Target) -> None:
        """Move the keypoints to `target`, in the order of the correction's."""
        with self._changed:
            self._target = np.array(target, dtype=float)
            self._changed.notify_all()

    def release(self, edit: int | None = None) -> None:
        """Converge the window at the current positions, and store it; `edit` is the log entry of the release."""
        with self._changed:
            self.released, self.edit = True, edit
            self._changed.notify_all()

    def abandon(self) -> None:
        """End without a result; too late once the release is stored."""
        with self._changed:
            self.abandoned = True
            self._changed.notify_all()

    def taken(self) -> Target | None:
        """The target, if it is new; call with the lock held."""
        target, self._target = self._target, None
        return target

    @property
    def wants(self) -> bool:
        """Whether there is something to do; call with the lock held."""
        unsettled = self.live is None or not self.live.settled
        return unsettled or self.released or self.abandoned or self._target is not None


class Worker:
    """A daemon thread that does one thing at a time. Methods return immediately and may be called from any thread."""

    def __init__(self, sink: Sink) -> None:
        self.reports: SimpleQueue[Report] = SimpleQueue()
        """For the drawing thread, in order."""
        self.arrived: Callable[[], None] = lambda: None
        """Called from any thread after each report."""
        self._sink = sink
        self._changed = threading.Condition()
        self._numbers = count(1)
        self._queue: deque[tuple[int, Job]] = deque()
        self._drags: deque[LiveDrag] = deque()
        self._errands: deque[tuple[int, Callable[[], None]]] = deque()
        self._running: int | None = None
        self._cancelled = self._closing = False
        self._thread = threading.Thread(target=self._serve, name="tcfit fits", daemon=True)
        self._thread.start()

    def _report(self, report: Report) -> None:
        self.reports.put(report)
        self.arrived()

    def submit(self, job: Job) -> int:
        """Append a job to the queue; returns its number, used in reports."""
        with self._changed:
            self._refuse_if_closing()
            number = next(self._numbers)
            self._queue.append((number, job))
            self._changed.notify_all()
        return number

    def cancel(self, job: int | None = None) -> None:
        """Cancel a job, queued or running, or all of them; ended jobs are unchanged."""
        with self._changed:
            self._cancelled |= self._running is not None and job in (None, self._running)
            dropped = [number for number, _ in self._queue if job in (None, number)]
            self._queue = deque(entry for entry in self._queue if entry[0] not in dropped)
            for number in dropped:
                self._report(JobEnded(job=number, how="cancelled"))
            self._changed.notify_all()

    def run_errand(self, errand: Callable[[], None]) -> int:
        """Do something short, before all drags and queued jobs, and between two iterations of the running one.

        Returns:
            The number used to report its end, even if the worker is closed.
        """
        with self._changed:
            self._refuse_if_closing()
            number = next(self._numbers)
            self._errands.append((number, errand))
            self._changed.notify_all()
        return number

    def drag(self, correction: Correction, target: Target, keep: KeepDrag) -> LiveDrag:
        """Start following a drag, which `keep` stores; a running job waits for it."""
        with self._changed:
            self._refuse_if_closing()
            drag = LiveDrag(next(self._numbers), correction, target, keep, self._changed)
            self._drags.append(drag)
            self._changed.notify_all()
        return drag

    def close(self, timeout: float = 30.0) -> bool:
        """Cancel everything and wait for the thread to end; False if it still runs after `timeout` seconds."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self.cancel()
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _refuse_if_closing(self) -> None:
        if self._closing:
            raise RuntimeError("the worker is closed")

    def _serve(self) -> None:
        torch.set_num_threads(1)  # a second thread hardly helps a fit, and the drawing loop needs it
        while not self._closing:
            self._follow_drags()
            with self._changed:
                self._changed.wait_for(lambda: self._closing or self._errands or self._waiting_drag() or self._queue)
                idle = self._closing or self._errands or self._waiting_drag() or not self._queue
                entry = None if idle else self._queue.popleft()
                if entry is not None:
                    self._running, self._cancelled = entry[0], False
            if entry is not None:
                self._run(*entry)
        self._run_errands()
        for drag in self._drags:
            self._report(DragEnded(drag=drag.number, how="abandoned"))

    def _run_errands(self) -> None:
        while self._errands:
            number, errand = self._errands.popleft()
            reason = ""
            try:
                errand()
            except Exception as error:  # any error: reported to the user, and the worker continues
                reason = _reason(error)
                _log.warning("An errand failed", exc_info=not isinstance(error, InputError))
            self._report(ErrandEnded(errand=number, reason=reason))

    def _waiting_drag(self) -> LiveDrag | None:
        return None if self._closing else next((drag for drag in self._drags if drag.wants), None)

    def _run(self, number: int, job: Job) -> None:
        self._report(JobStarted(job=number))
        try:
            ended = self._outcome(number, job)
        except InputError as error:
            ended = JobEnded(job=number, how="failed", reason=_reason(error))
            _log.warning("%s failed: %s", job.title, error)
        except Exception as error:  # any error: reported to the user, and the worker continues
            ended = JobEnded(job=number, how="failed", reason=_reason(error))
            _log.exception("Job %d (%s) failed", number, job.title)
        with self._changed:
            self._running = None
        self._report(ended)
        give_back()

    def _outcome(self, number: int, job: Job) -> JobEnded:
        worked = 0.0
        with closing(job.run()) as events:
            while self._may_go_on():
                begin = time.perf_counter()
                try:
                    event = next(events)
                except StopIteration as stop:
                    outcome = stop.value
                    break
                worked += time.perf_counter() - begin
                if event is not None:
                    self._pass_on(number, job, event, worked)
            else:
                return JobEnded(job=number, how="cancelled")
        # Not within the handler: if storing failed, the log would show the whole result as the cause.
        self._sink.keep(job, outcome)
        return JobEnded(job=number, how="finished")

    def _may_go_on(self) -> bool:
        """Follow drags between two iterations; False if the job was cancelled."""
        if not self._cancelled:
            self._follow_drags()
        return not (self._closing or self._cancelled)

    def _pass_on(self, number: int, job: Job, event: FitEvent, worked: float) -> None:
        if isinstance(event, PhaseFinished | FramesFitted):
            self._sink.keep(job, event)
        if not isinstance(event, Finished):  # reported as the outcome
            self._report(JobReported(job=number, event=event, worked=worked))

    def _follow_drags(self) -> None:
        """Take a step for each drag in turn, until they have ended or their pointers have rested for a while."""
        while True:
            self._run_errands()
            with self._changed:
                self._changed.wait_for(
                    lambda: self._closing or self._errands or self._waiting_drag() or not self._drags, LINGER
                )
                if self._errands:
                    continue
                drag = self._waiting_drag()
                if drag is None:
                    return
                self._drags.remove(drag)
                self._drags.append(drag)
                target = drag.taken()
            if (ended := self._followed(drag, target)) is not None:
                with self._changed:
                    self._drags.remove(drag)
                self._report(ended)

    def _followed(self, drag: LiveDrag, target: Target | None) -> DragEnded | None:
        """One step of a drag; returns its end, if it has ended."""
        try:
            if drag.abandoned:
                return DragEnded(drag=drag.number, how="abandoned")
            live = self._aimed(drag, target)
            if drag.released:
                return self._released(drag, live)
            params = live.resolve()
        except InputError as error:
            _log.warning("Following drag %d failed: %s", drag.number, error)
            return DragEnded(drag=drag.number, how="failed", reason=_reason(error))
        except Exception as error:  # any error: reported to the user, and a running job continues
            _log.exception("Following drag %d failed", drag.number)
            return DragEnded(drag=drag.number, how="failed", reason=_reason(error))
        self._report(DragMoved(drag=drag.number, frames=drag.correction.frames, params=params))
        return None

    def _aimed(self, drag: LiveDrag, target: Target | None) -> LiveCorrection:
        """The drag's correction, created on first use."""
        if drag.live is None:
            assert target is not None, "a drag begins somewhere"
            drag.live = LiveCorrection(drag.correction.now, target)
        elif target is not None:
            drag.live.move(target)
        return drag.live

    def _released(self, drag: LiveDrag, live: LiveCorrection) -> DragEnded:
        """The window converged, unless the drag is abandoned meanwhile."""
        with closing(live.release()) as events:
            while not (self._closing or drag.abandoned):
                try:
                    next(events)
                except StopIteration as stop:
                    refit: Refit = stop.value
                    break
            else:
                return DragEnded(drag=drag.number, how="abandoned")
        # Not within the handler: if storing failed, the log would show the whole result as the cause.
        drag.keep(live.correction, live.target, refit, drag.edit)
        return DragEnded(drag=drag.number, how="finished")


def _reason(error: Exception) -> str:
    """One line for users: an InputError's advice, or any other error with its type."""
    return str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
