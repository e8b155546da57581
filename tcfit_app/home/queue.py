"""The job queue: fits and exports in the background, one after the other."""

import logging
import threading
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

from tcfit_app.fitting.child_processes import Child
from tcfit_app.home import jobs
from tcfit_app.home.jobs import Job
from tcfit_app.home.messages import Work, failure

WAITING = Work(step="Waiting")
_log = logging.getLogger(__name__)
_LOOK = 0.5
"""Seconds between two checks whether a job was cancelled."""


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """A job, and its progress."""

    job: Job
    work: Work


class WorkQueue:
    """Thread-safe.

    Args:
        place: Returns the project folder when a job is due. Raises ValueError, with a message for the user, if the job
            cannot be done now.
        changed: Called with the keys of jobs that have changed, from the queue's own thread.
    """

    def __init__(self, place: Callable[[str, Job], Path], changed: Callable[[Collection[str]], None]) -> None:
        self._place, self._changed = place, changed
        self._guard = threading.Condition()
        self._entries: dict[str, dict[str, _Entry]] = {}
        """By key and kind of job: pending, running and finished ones, in order."""
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="tcfit works in the background")
        self._thread.start()

    def on(self, key: str) -> Work | None:
        """The job on a clip: the running one, else the next, else the one that ended last."""
        works = [entry.work for entry in list(self._entries.get(key, {}).values())]
        going = [work for work in works if not work.ended]
        return next((work for work in going if work != WAITING), None) or next(iter(going or works[-1:]), None)

    @property
    def busy(self) -> bool:
        """Whether anything waits or runs."""
        with self._guard:
            return any(not e.work.ended for of_key in self._entries.values() for e in of_key.values())

    def add(self, keys: Iterable[str], job: Job) -> None:
        """Append jobs."""
        with self._guard:
            new = [key for key in keys if self._is_new(key, job)]
            for key in new:
                others = {kind: e for kind, e in self._entries.get(key, {}).items() if not e.work.ended}
                if not others:
                    self._entries.pop(key, None)  # to the end
                self._entries[key] = others | {job.kind: _Entry(job=job, work=WAITING)}
            self._guard.notify()
        self._changed(new)

    def _is_new(self, key: str, job: Job) -> bool:
        known = self._entries.get(key, {}).get(job.kind)
        return known is None or bool(known.work.ended)

    def cancel(self, keys: Iterable[str]) -> None:
        """Cancel jobs, and clear messages of finished ones."""
        with self._guard:
            gone = [key for key in keys if self._entries.pop(key, None) is not None]
        self._changed(gone)

    def close(self) -> None:
        """End the running job, and start no other."""
        with self._guard:
            self._closed = True
            self._entries.clear()
            self._guard.notify()
        self._thread.join()

    def _run(self) -> None:
        while (turn := self._next()) is not None:
            key, job = turn
            try:
                ended = self._done(key, job, self._place(key, job))
            except ValueError as error:
                ended = Work(step=str(error), ended="failed")
            except Exception as error:
                _log.exception("The %s of a clip could not be started", job.kind)
                ended = failure(error)
            with self._guard:
                if self._is_on(key, job):
                    del self._entries[key][job.kind]
                    if ended is not None:
                        self._entries[key][job.kind] = _Entry(job=job, work=ended)
                    elif not self._entries[key]:
                        del self._entries[key]
            self._report([key])

    def _report(self, keys: Collection[str]) -> None:
        """Call `changed`, whose errors must not end this thread: the other jobs would wait for ever."""
        try:
            self._changed(keys)
        except Exception:
            _log.exception("News of a job could not be reported")

    def _next(self) -> tuple[str, Job] | None:
        """Wait for the next job; None at the end."""
        with self._guard:
            while not self._closed:
                for key, of_key in self._entries.items():
                    for kind, entry in of_key.items():
                        if not entry.work.ended:
                            of_key[kind] = _Entry(job=entry.job, work=Work(step="Starting"))
                            return key, entry.job
                self._guard.wait()
        return None

    def _is_on(self, key: str, job: Job) -> bool:
        """Whether it was not cancelled."""
        entry = self._entries.get(key, {}).get(job.kind)
        return entry is not None and entry.job is job

    def _done(self, key: str, job: Job, folder: Path) -> Work | None:
        """Do a job. Returns its end, None if there is nothing to report, or it was cancelled."""
        child = Child.started(jobs.serve, folder, job)
        try:
            while True:
                if not self._is_on(key, job):
                    return None
                if not child.pipe.poll(_LOOK):
                    continue
                news = child.pipe.recv()
                if news is None or news.ended:
                    return news
                with self._guard:
                    if self._is_on(key, job):
                        self._entries[key][job.kind] = _Entry(job=job, work=news)
                self._report([key])
        except (EOFError, OSError):
            step = f"Its process ended {child.how_it_ended()}. Memory may have run out."
            return Work(step=step, ended="failed")
        finally:
            child.end()
