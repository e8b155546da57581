"""The job queue: fits and exports in the background, one after the other.

Each is done in a process of its own: a crash does not affect the list and the reviews, and a job can be cancelled at
any moment. What it has stored by then stays.
"""

import logging
import threading
from collections.abc import Callable, Collection, Iterable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fitting_core.errors import InputError
from tcfit_app.fitting.process_queue import Ended, ProcessQueue, Report, Work
from tcfit_app.home.messages import Export, unforeseen

WAITING = Work(step="Waiting")
_log = logging.getLogger(__name__)
_LOOK = 0.5
"""Seconds between two checks whether a job was cancelled."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is done with a clip."""

    kind: str
    """A clip waits for one job of a kind at most."""
    writes: bool
    """Whether it writes into the project, which must then be closed."""
    run: Callable[[Path, Report], str]
    """Does it, in the process, with the project's folder. Returns the final message, which may be empty. Raises
    InputError if it cannot be done."""


def fit_job(models: Path | None) -> Job:
    """Find missing keypoints, and fit; `models` is the folder of body models."""
    return Job(kind="fit", writes=True, run=partial(_fit, models=models))


def export_job(asked: Export, models: Path | None) -> Job:
    """Write the last fit for other programs."""
    return Job(kind="export", writes=False, run=partial(_export, asked=asked, models=models))


def _fit(folder: Path, report: Report, *, models: Path | None) -> str:
    from tcfit_app.home.fitting import fit_project  # torch's two seconds are not for the list

    fit_project(folder, report, models=models)
    return ""


def _export(folder: Path, report: Report, *, asked: Export, models: Path | None) -> str:
    from tcfit_app.home.exporting import export_project

    return export_project(folder, report, formats=asked.formats, axes=asked.axes, view=asked.view, models=models)


def _done(job: Job, folder: Path, report: Report) -> Work | None:
    """Do a job, in the process. Returns its end, None if there is nothing to report."""
    try:
        said = job.run(folder, report)
        return Work(step=said, ended="done") if said else None
    except InputError as error:
        return Work(step=str(error), ended="failed")
    except (Exception, KeyboardInterrupt) as error:  # a plugin may raise the latter: this process is deaf to Ctrl-C
        _log.exception("%s: the %s went wrong", folder, job.kind)
        return Work(step=unforeseen(error), ended="failed")


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """A job, and its progress."""

    job: Job
    work: Work


class JobQueue:
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
                ended = self._end_of(key, job, self._place(key, job))
            except ValueError as error:
                ended = Work(step=str(error), ended="failed")
            except Exception as error:
                _log.exception("The %s of a clip could not be started", job.kind)
                ended = Work(step=unforeseen(error), ended="failed")
            self._set(key, job, ended)

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

    def _end_of(self, key: str, job: Job, folder: Path) -> Work | None:
        """Do a job. Returns its end, None if there is nothing to report, or it was cancelled."""
        with closing(ProcessQueue()) as processes:
            processes.add(key, partial(_done, job, folder))
            while self._is_on(key, job):
                for _, news in processes.news(_LOOK):
                    if not isinstance(news, Ended):
                        self._set(key, job, news)
                    elif news.died:
                        step = f"Its process ended {news.died}. Memory may have run out."
                        return Work(step=step, ended="failed")
                    else:
                        return news.result
        return None

    def _is_on(self, key: str, job: Job) -> bool:
        """Whether it was not cancelled."""
        entry = self._entries.get(key, {}).get(job.kind)
        return entry is not None and entry.job is job

    def _set(self, key: str, job: Job, work: Work | None) -> None:
        """Store the progress of a job that was not cancelled, None if it has ended without a message; and report it."""
        with self._guard:
            if self._is_on(key, job):
                del self._entries[key][job.kind]
                if work is not None:
                    self._entries[key][job.kind] = _Entry(job=job, work=work)
                elif not self._entries[key]:
                    del self._entries[key]
        try:
            self._changed([key])
        except Exception:  # it must not end this thread: the other jobs would wait for ever
            _log.exception("News of a job could not be reported")
