"""The fits of an open project: what can be shown, what is streaming in, and where the worker's results are kept."""

import threading
import time
from collections import OrderedDict
from collections.abc import Container
from dataclasses import dataclass, replace
from itertools import count
from queue import SimpleQueue

import numpy as np
from jaxtyping import Float

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.fit.events import PhaseFinished, WindowFinished
from fitting_core.fit.fitting import Refit, patched
from fitting_core.fit.provenance import Provenance
from fitting_core.fit.result import FitResult, PhaseResult
from tcfit_app.fitting.jobs import CorrectionJob, Job, RunJob, with_phases
from tcfit_app.fitting.live import Correction
from tcfit_app.project.edits.edit_log import frames_of
from tcfit_app.project.project import Project
from tcfit_app.project.storage.runs import Ended, Run, newest

KEPT_FITS = 8
"""Results held in memory: those of the runs that were shown last."""
IN_USE = 5.0
"""Seconds since it was last asked for until a result counts as not on show any more."""
TITLES = {1: "SMPLify-X", 2: "shared shape", 3: "temporal"}
"""What each phase is called where two of them stand side by side."""


@dataclass(frozen=True, kw_only=True)
class FitChoice:
    """What a browser wants to see, also while runs come and go."""

    run: int | None = None
    """None: the newest that has a result; one that was imported only if there is no other."""
    phase: int | None = None
    """None: the last that is finished."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """One phase of one run as it is now."""

    run: Run
    phase: int
    params: BodyParams
    """All frames."""
    result: PhaseResult | None
    """Its figures; None while its windows come in."""
    revision: int
    """Another number whenever `params` is another."""
    camera: Camera
    """The one that it was fitted with: its focal length may not be the clip's."""

    @property
    def title(self) -> str:
        """For the user."""
        return self.run.name if self.run.kind == "imported" else f"{self.run.name} · {TITLES[self.phase]}"


@dataclass(frozen=True, kw_only=True)
class _Version:
    """What a run has found so far."""

    fit: FitResult
    partial: BodyParams | None
    """Phase 3 while its windows come in, all frames."""
    revision: int


class Fits:
    """Results by run. Thread-safe; the worker's sink.

    What a run has finished is on the disk before anybody is shown it.
    """

    def __init__(self, project: Project) -> None:
        self._project = project
        self._lock = threading.RLock()
        self._correcting = threading.Lock()
        """Held from the reading of a run's corrections until they are stored with a change."""
        self._versions: OrderedDict[int, _Version] = OrderedDict()
        self._asked: dict[int, float] = {}
        """When each was asked for last."""
        self._revisions = count(1)
        self._runs: tuple[Run, ...] | None = None
        self._unwritten: dict[int, FitResult] = {}
        """Finished fits that the disk had no room for."""
        self.overtaken: SimpleQueue[tuple[Run, set[int]]] = SimpleQueue()
        """Edited frames of a run whose fit was overtaken by further edits: they are to be followed again."""
        self.changes = 0
        """Another number whenever a run appeared, changed or went."""

    @property
    def runs(self) -> tuple[Run, ...]:
        """All runs that are not deleted, oldest first."""
        with self._lock:
            if self._runs is None:
                self._runs = tuple(self._project.runs.all())
            return self._runs

    def run(self, number: int) -> Run | None:
        """A run that is not deleted."""
        return next((run for run in self.runs if run.id == number), None)

    def changed(self) -> None:
        """Rows of runs are others than they were."""
        with self._lock:
            self._runs = None
            self.changes += 1

    def showable(self) -> list[Run]:
        """Runs with at least one phase, oldest first."""
        with self._lock:
            return [
                run
                for run in self.runs
                if run.stored or (run.id in self._versions and self._versions[run.id].fit.phases)
            ]

    def phases(self, run: Run) -> tuple[int, ...]:
        """Which phases of a run can be shown."""
        version = self._version(run)
        return tuple(p.phase for p in version.fit.phases) + ((3,) if version.partial is not None else ())

    def fit(self, run: Run) -> FitResult:
        """Everything that a run has found.

        Raises:
            InputError: It cannot be read.
        """
        return self._version(run).fit

    def meant(self, choice: FitChoice) -> Run | None:
        """The run that a choice means now."""
        runs = [run for run in self.showable() if choice.run in (None, run.id)]
        return newest(runs) if runs else None

    def held(self, run: Run) -> bool:
        """Whether what a run has found is in memory: nothing that is asked of it waits for the disk then."""
        with self._lock:
            return run.id in self._versions

    def show(self, choice: FitChoice) -> Shown | None:
        """The run and phase that a choice means now; a phase that is not there yet becomes the last one before it.

        Raises:
            InputError: Its file cannot be read.
        """
        run = self.meant(choice)
        if run is None:
            return None
        version = self._version(run)
        if version.partial is not None and choice.phase in (None, 3):
            return self._shown(run, version, 3, version.partial, None)
        there = [p for p in version.fit.phases if choice.phase is None or p.phase <= choice.phase]
        if not there:
            return None
        last = there[-1]
        return self._shown(run, version, last.phase, last.params, last)

    @staticmethod
    def _shown(run: Run, version: _Version, phase: int, params: BodyParams, result: PhaseResult | None) -> Shown:
        camera = version.fit.camera
        return Shown(run=run, phase=phase, params=params, result=result, revision=version.revision, camera=camera)

    def _version(self, run: Run) -> _Version:
        with self._lock:
            version = self._versions.get(run.id)
            if version is not None:
                self._versions.move_to_end(run.id)
                self._asked[run.id] = time.monotonic()
                return version
        fit = self._project.runs.load(run.id)
        with self._lock:  # another thread may have published a newer one meanwhile
            return self._versions.get(run.id) or self._publish(run.id, fit)

    def _publish(self, run: int, fit: FitResult, partial: BodyParams | None = None) -> _Version:
        with self._lock:
            version = _Version(fit=fit, partial=partial, revision=next(self._revisions))
            self._versions[run] = version
            self._versions.move_to_end(run)
            self._asked[run] = time.monotonic()
            self._forget()
            return version

    def _forget(self) -> None:
        """Leave what is running or on show alone: tabs that evict each other's fits would read them for ever."""
        since = time.monotonic() - IN_USE
        running = {r.id for r in self.runs if r.state == "running"}
        idle = [run for run in self._versions if run not in running and self._asked.get(run, 0.0) < since]
        for old in idle[: max(0, len(self._versions) - KEPT_FITS)]:
            del self._versions[old]
            self._asked.pop(old, None)

    def begin(self, run: Run, start: Shown | None) -> None:
        """A run was submitted that goes on from another one's fit, or from nothing. Raises InputError as `fit`."""
        if start is not None:
            fit = self.fit(start.run)
            kept = tuple(p for p in fit.phases if p.phase < (2 if run.kind == "shape" else 3))
            # Frames that are fitted again stand as they were until they come in, and all others for good.
            partial = start.params if run.kind == "frames" else None
            self._publish(run.id, replace(fit, phases=kept, config=run.config), partial)
        self.changed()

    def end(self, run: int, state: Ended, message: str = "") -> None:
        """A run was cancelled or has failed; what it has stored stays.

        Raises:
            InputError: The project cannot be written.
        """
        self._project.runs.end(run, state, message)
        with self._lock:
            if (version := self._versions.pop(run, None)) is not None and self._project.runs.get(run).stored:
                self._publish(run, version.fit)
        self.changed()

    def forget(self, run: int) -> None:
        """A run was deleted."""
        with self._lock:
            self._versions.pop(run, None)
        self.changed()

    def keep(self, job: Job, result: PhaseFinished | WindowFinished | FitResult) -> None:
        """Store what a run's job found; see `worker.Sink`."""
        if isinstance(job, CorrectionJob):
            if isinstance(result, FitResult):
                self._keep_followed(job, result)
            return
        assert isinstance(job, RunJob)
        if isinstance(result, FitResult):
            try:
                self._project.runs.finish(job.run_id, result)
            except InputError as error:
                self._unwritten[job.run_id] = result
                raise InputError(
                    f"{error} The fit is not lost: leave tcfit running, it is written as soon as that is possible."
                ) from error
            self._publish(job.run_id, result)
            self.changed()
        elif isinstance(result, PhaseFinished):
            self._project.runs.store(job.run_id, result.so_far)
            self._publish(job.run_id, result.so_far)
            self.changed()
        else:
            self._put_window(job, result)

    @property
    def unwritten(self) -> bool:
        """Whether there are finished fits that could not be written."""
        return bool(self._unwritten)

    def write_late(self) -> list[Run]:
        """Try again to write those; which runs have finished so."""
        written = []
        for number, found in list(self._unwritten.items()):
            if self.run(number) is not None:  # it may have been deleted meanwhile
                try:
                    written.append(self._project.runs.finish(number, found, state="failed"))
                except InputError:
                    break
                self._publish(number, found)
                self.changed()
            del self._unwritten[number]
        return written

    def _put_window(self, job: RunJob, window: WindowFinished) -> None:
        with self._lock:
            version = self._versions[job.run_id]
            before = version.fit.last.params if version.partial is None else version.partial
            self._publish(job.run_id, version.fit, before.with_frames(window.frames, window.params))

    def keep_correction(self, correction: Correction, xy: Float[np.ndarray, "n 2"], refit: Refit) -> None:
        """Store a released drag in the run's corrections, which are a run of their own; see `worker.Sink`."""
        assert correction.origin is not None
        # Its own edit is among them: it was on the disk before the drag was released.
        seen = {entry.id for entry in self._project.log if entry.id <= correction.edits_seen}
        clip = correction.edited(xy)
        with self._correcting:
            self._correct(correction.origin, (correction.frames,), refit, clip, correction.body, seen)

    def _keep_followed(self, job: CorrectionJob, fit: FitResult) -> None:
        """What is newer than the job stays: frames that were edited meanwhile are left to be followed again."""
        log, inner = self._project.log, job.job
        assert inner is not None, "it has run"
        later = {f for number, frames in frames_of(log).items() if number > job.edits_seen for f in frames}
        windows = tuple(window for window in inner.windows if later.isdisjoint(window))
        if late := {f for window in inner.windows if window not in windows for f in job.frames.intersection(window)}:
            self.overtaken.put((self._project.runs.get(job.origin), late))
        if windows:
            seen = {entry.id for entry in log if entry.id <= job.edits_seen}
            provenance = fit.last.provenance or Provenance.unknown(len(fit.last.params))
            refit = Refit(params=fit.last.params, provenance=provenance)
            with self._correcting:
                self._correct(job.origin, windows, refit, inner.clip, inner.body, seen)

    def _correct(
        self, run: int, windows: tuple[range, ...], refit: Refit, clip: Clip, body: BodyModel, seen: set[int]
    ) -> None:
        """Put windows of a fit into a run's corrections: that run may have changed since they were begun."""
        base = self.corrections_of(run)
        fit = self.fit(base)
        whole = fit.last.params
        for window in windows:
            whole = whole.with_frames(window, refit.params[slice(window.start, window.stop)])
        note = "keypoints were corrected, and the frames around them fitted again"
        phase = patched(fit.last, clip, body, fit.config, whole, windows, provenance=refit.provenance, note=note)
        config = self._project.runs.get(run).config
        self._store_corrections(base, with_phases(fit, (phase,), config), self.edits_seen(base, windows, seen))

    def corrections_of(self, run: int) -> Run:
        """The run in which corrections of a run are collected, or the run itself if there is none yet."""
        children = [r for r in self.runs if r.parent == run and r.kind == "corrections" and r.state == "finished"]
        return children[-1] if children else self._project.runs.get(run)

    def edits_seen(self, base: Run, windows: tuple[range, ...], seen: Container[int]) -> int:
        """Up to which log entry a run has seen all edits once windows of it are fitted again.

        Args:
            base: The run before.
            windows: Fitted again.
            seen: The log entries that this took into account.
        """
        fitted, last = {frame for window in windows for frame in window}, base.edits_seen
        for number, frames in frames_of(self._project.log).items():
            if number > last:
                if number not in seen or not fitted.issuperset(frames):
                    break
                last = number
        return last

    def _store_corrections(self, base: Run, fit: FitResult, seen: int) -> None:
        runs = self._project.runs
        if runs.get(base.id).deleted:
            raise InputError(f"{base.name} was deleted: what followed its corrections is not kept.")
        if base.kind == "corrections":
            run = runs.amend(base.id, fit, edits_seen=seen)
        else:
            name = f"{base.name} corrected"
            run = runs.start(fit.config, body=base.body, edits_seen=seen, kind="corrections", parent=base.id, name=name)
            runs.finish(run.id, fit)
        self._publish(run.id, fit)
        self.changed()
