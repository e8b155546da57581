"""The fits of an open project: what can be shown, what is streaming in, and where the worker's results are kept."""

import threading
import time
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.config.schema import fits_as_smplifyx
from fitting_core.errors import InputError
from fitting_core.fit.events import FramesFitted, PhaseFinished
from fitting_core.fit.fitting import Refit
from fitting_core.fit.result import FitResult, PhaseResult
from tcfit_app.fitting.corrections import Corrections
from tcfit_app.fitting.jobs import CorrectionJob, Job, RunJob
from tcfit_app.fitting.live import Correction, Target
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Ended, Run, Source, newest

KEPT_FITS = 8
"""Results held in memory: those of the runs that were shown last."""
IN_USE = 5.0
"""Seconds since it was last asked for until a result counts as not on show any more."""
TITLES = {1: "per frame", 2: "shared shape", 3: "temporal"}
"""What each phase is called, whatever run it is of."""


def phase_title(run: Run, phase: int) -> str:
    """What a phase of a run is called, on buttons and legends and in names of files."""
    return "SMPLify-X" if phase == 1 and run.kind != "imported" and fits_as_smplifyx(run.config) else TITLES[phase]


_OWN: dict[str, tuple[int, ...]] = {"frames": (3,), "shape": (2, 3), "corrections": (), "imported": ()}


def own_phases(run: Run) -> tuple[int, ...]:
    """Phases that a run did itself, and whose seconds are its own; the others are its parent's. Corrections are patches
    of their parent's phase 3."""
    return _OWN.get(run.kind, tuple(TITLES))


@dataclass(frozen=True, kw_only=True)
class FitChoice:
    """What a browser wants to see, even while runs come and go."""

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
    """Its figures; None while its frames come in."""
    revision: int
    """Changes whenever `params` does."""
    camera: Camera
    """The one that it was fitted with: its focal length may not be the clip's."""
    there: Bool[np.ndarray, "T"] | None = field(compare=False)
    """Frames that have a body; None: all. Where they are others, the revision is."""

    def has(self, frame: int) -> bool:
        """Whether there is a body in a frame: while phase 1 runs, not in those that it has not come to."""
        return self.there is None or bool(self.there[frame])

    @property
    def title(self) -> str:
        """For the user."""
        name = self.run.name
        return name if self.run.kind == "imported" else f"{name} · {phase_title(self.run, self.phase)}"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Partial:
    """A phase whose frames come in."""

    phase: int
    params: BodyParams
    """All frames; those that are not there yet are any body."""
    there: Bool[np.ndarray, "T"] | None
    """As of `Shown`."""

    def with_frames(self, frames: range, params: BodyParams) -> "_Partial":
        there = None if self.there is None else self.there.copy()
        if there is not None:
            there[frames.start : frames.stop] = True
        return replace(self, params=self.params.with_frames(frames, params), there=there)


@dataclass(frozen=True, kw_only=True)
class _Version:
    """What a run has found so far."""

    fit: FitResult | None
    """None: no phase is finished."""
    camera: Camera
    partial: _Partial | None
    """The phase that is running, if frames of it can be looked at."""
    revision: int

    @property
    def finished(self) -> tuple[PhaseResult, ...]:
        """Phases with all figures."""
        return () if self.fit is None else self.fit.phases


def _begun(version: _Version, found: FramesFitted, length: int) -> _Partial:
    """A phase of which the first frames come: the others are those of the phase before, if there is one."""
    if version.finished:
        return _Partial(phase=found.phase, params=version.finished[-1].params, there=None)
    return _Partial(phase=found.phase, params=found.params[[0] * length], there=np.zeros(length, bool))


def _told(run: Run, fit: FitResult | None) -> Bool[np.ndarray, "T"] | None:
    """Frames that another program's result covers; None: all."""
    if fit is None or run.kind != "imported":
        return None
    there = np.asarray(fit.observed.any(1))
    return None if there.all() else there


class Fits:
    """Results by run. Thread-safe; the worker's sink.

    What a run has finished is on the disk before anybody is shown it.
    """

    def __init__(self, project: Project) -> None:
        self._project = project
        self._lock = threading.RLock()
        self._versions: OrderedDict[int, _Version] = OrderedDict()
        self._asked: dict[int, float] = {}
        """When each was asked for last."""
        self._revisions = count(1)
        self._runs: tuple[Run, ...] | None = None
        self._unwritten: dict[int, FitResult] = {}
        """Finished fits that could not be written."""
        self.corrections = Corrections(project, self)
        """Of keypoints, which are runs of their own."""
        self.changes = 0
        """Changes whenever a run appears, changes or goes."""

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

    def named(self, source: Source) -> str:
        """The short name of a run or file."""
        if source.run is None:
            return Path(source.path).name or "a file"
        run = self.run(source.run)
        return f"run {source.run}, which was deleted" if run is None else run.name

    def changed(self) -> None:
        """Rows of runs are others than they were."""
        with self._lock:
            self._runs = None
            self.changes += 1

    def showable(self) -> list[Run]:
        """Runs of which there is something to look at, oldest first."""
        with self._lock:
            there = {number for number, v in self._versions.items() if v.finished or v.partial is not None}
            return [run for run in self.runs if run.stored or run.id in there]

    def phases(self, run: Run) -> tuple[int, ...]:
        """Which phases of a run can be shown."""
        version = self._version(run)
        return tuple(p.phase for p in version.finished) + (() if version.partial is None else (version.partial.phase,))

    def fit(self, run: Run) -> FitResult:
        """Everything that a run has found.

        Raises:
            InputError: It cannot be read, or no phase is finished.
        """
        fit = self._version(run).fit
        if fit is None:
            raise InputError(f"{run.name} is in its first phase: wait until that is done.")
        return fit

    def standing(self, choice: FitChoice) -> FitChoice:
        """The choice, with the newest run in the place of one that was deleted."""
        gone = choice.run is not None and self.run(choice.run) is None
        return replace(choice, run=None) if gone else choice

    def meant(self, choice: FitChoice) -> Run | None:
        """The run that a choice means now."""
        number = self.standing(choice).run
        runs = [run for run in self.showable() if number in (None, run.id)]
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
        phases = [*version.finished, *([] if version.partial is None else [version.partial])]
        wanted = None if run.kind == "imported" else choice.phase  # another program's result has no phases to choose
        last = next((p for p in reversed(phases) if wanted is None or p.phase <= wanted), None)
        if last is None:
            return None
        return Shown(
            run=run,
            phase=last.phase,
            params=last.params,
            result=last if isinstance(last, PhaseResult) else None,
            revision=version.revision,
            camera=version.camera,
            there=last.there if isinstance(last, _Partial) else _told(run, version.fit),
        )

    def _version(self, run: Run) -> _Version:
        with self._lock:
            version = self._versions.get(run.id)
            if version is not None:
                self._versions.move_to_end(run.id)
                self._asked[run.id] = time.monotonic()
                return version
        fit = self._project.runs.load(run.id)
        with self._lock:  # another thread may have published a newer one meanwhile
            return self._versions.get(run.id) or self.publish(run.id, fit)

    def publish(self, run: int, fit: FitResult, partial: _Partial | None = None) -> _Version:
        """What a run has found is this from now on."""
        return self._put(run, fit, fit.camera, partial)

    def _put(self, run: int, fit: FitResult | None, camera: Camera, partial: _Partial | None) -> _Version:
        with self._lock:
            version = _Version(fit=fit, camera=camera, partial=partial, revision=next(self._revisions))
            self._versions[run] = version
            self._versions.move_to_end(run)
            self._asked[run] = time.monotonic()
            self._forget()
            return version

    def _forget(self) -> None:
        """Keeps what is running or on show: tabs that evicted each other's fits would keep reading them from disk."""
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
            partial = _Partial(phase=3, params=start.params, there=None) if run.kind == "frames" else None
            self.publish(run.id, replace(fit, phases=kept, config=run.config), partial)
        self.changed()

    def end(self, run: int, state: Ended, message: str = "") -> None:
        """A run was cancelled or has failed; what it has stored stays.

        Raises:
            InputError: The project cannot be written.
        """
        self._project.runs.end(run, state, message)
        with self._lock:
            version = self._versions.pop(run, None)
            if version is not None and version.fit is not None and self._project.runs.get(run).stored:
                self.publish(run, version.fit)
        self.changed()

    def forget(self, run: int) -> None:
        """A run was deleted."""
        with self._lock:
            self._versions.pop(run, None)
        self.changed()

    def keep(self, job: Job, result: PhaseFinished | FramesFitted | FitResult) -> None:
        """Store what a run's job found; see `worker.Sink`."""
        if isinstance(job, CorrectionJob):
            if isinstance(result, FitResult):
                self.corrections.keep_followed(job, result)
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
            self.publish(job.run_id, result)
            self.changed()
        elif isinstance(result, PhaseFinished):
            self._project.runs.store(job.run_id, result.so_far)
            self.publish(job.run_id, result.so_far)
            self.changed()
        else:
            self._put_frames(job, result)

    @property
    def unwritten(self) -> bool:
        """Whether there are finished fits that could not be written."""
        return bool(self._unwritten)

    def write_late(self) -> list[Run]:
        """Try again to write these; the runs that have finished by it."""
        written = []
        for number, found in list(self._unwritten.items()):
            if self.run(number) is not None:  # it may have been deleted meanwhile
                try:
                    written.append(self._project.runs.finish(number, found, state="failed"))
                except InputError:
                    break
                self.publish(number, found)
                self.changed()
            del self._unwritten[number]
        return written

    def _put_frames(self, job: RunJob, found: FramesFitted) -> None:
        with self._lock:
            version = self._versions.get(job.run_id) or self._put(job.run_id, None, job.clip.camera, None)
            before, camera = version.partial, version.camera if version.fit else job.clip.camera
            if before is None or before.phase != found.phase or camera != version.camera:
                before = _begun(version, found, len(job.clip))
            partial = before.with_frames(found.frames, found.params)
            self._put(job.run_id, version.fit, camera, partial)
        if len(version.finished) == 0 and version.partial is None:
            self.changed()  # there is something to look at

    def keep_correction(self, correction: Correction, target: Target, refit: Refit) -> None:
        """Store a released drag; see `worker.Sink`."""
        self.corrections.keep_drag(correction, target, refit)
