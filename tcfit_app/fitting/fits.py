"""The fits of an open project: which can be shown, which are in progress, and how the worker's results are stored."""

import threading
import time
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
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
from fitting_core.results.fit_result import FitResult, PhaseResult
from tcfit_app.fitting.jobs import CorrectionJob, FitEverything, Job, RunJob
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_files import OBSERVED
from tcfit_app.project.storage.run_record import Ended, Run, Source, newest

KEPT_FITS = 8
"""Number of results in memory: of the runs shown last."""
KEPT_EVERY = 20.0
"""Seconds between two times that phase 1 of a running fit is stored so far."""
IN_USE = 5.0
"""Seconds after its last request until a result counts as no longer on show."""
PASSES = {1: "first pass", 2: "one shape", 3: "final"}
"""What users call the phases, where two of them are compared."""


def pass_of(run: Run, phase: int) -> str:
    """What users call a run's phase."""
    return "SMPLify-X" if phase == 1 and fits_as_smplifyx(run.config) else PASSES[phase]


_OWN: dict[str, tuple[int, ...]] = {"frames": (3,), "shape": (2, 3), "corrections": (), "imported": ()}


def own_phases(run: Run) -> tuple[int, ...]:
    """Phases that a run computed itself, with its own times; the others are its parent's. Corrections are patches of
    their parent's phase 3."""
    return _OWN.get(run.kind, tuple(PASSES))


def passes_of(run: Run) -> tuple[int, ...]:
    """Phases that a run computed itself before its last one."""
    return tuple(phase for phase in own_phases(run) if phase < run.config.last_phase)


@dataclass(frozen=True, kw_only=True)
class FitChoice:
    """What a browser wants to see, independent of which runs exist."""

    run: int | None = None
    """None: the newest with a result; an imported one only if there is no other."""
    phase: int | None = None
    """None: the last finished phase."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """One phase of one run in its current state."""

    run: Run
    phase: int
    params: BodyParams
    """All frames."""
    result: PhaseResult | None
    """Its figures; None while it is in progress."""
    revision: int
    """Changes whenever `params` does."""
    camera: Camera
    """The camera it was fitted with: its focal length may differ from the clip's."""
    there: Bool[np.ndarray, "T"] | None = field(compare=False)
    """Frames with a body; None: all. The revision changes with it."""
    last: bool = True
    """Whether it is the last phase that the run has so far."""

    @property
    def version(self) -> tuple[int, int, int]:
        """Identifies `params`."""
        return self.run.id, self.phase, self.revision

    def has(self, frame: int) -> bool:
        """Whether there is a body in a frame: while phase 1 runs, only in frames already fitted."""
        return self.there is None or bool(self.there[frame])

    @property
    def title(self) -> str:
        """For users: the run's name, with the pass unless it is the last one."""
        return self.run.name if self.last else self.title_with_pass

    @property
    def title_with_pass(self) -> str:
        """Where two passes of one run are compared."""
        return self.run.name if self.run.kind == "imported" else f"{self.run.name} · {pass_of(self.run, self.phase)}"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Partial:
    phase: int
    params: BodyParams
    """All frames; those not fitted yet have an arbitrary body."""
    there: Bool[np.ndarray, "T"] | None
    """As in `Shown`."""
    previewed: Bool[np.ndarray, "T"] | None = None
    """Those of them that are only a preview while keypoints are being detected."""

    def with_frames(self, frames: range, params: BodyParams, *, preview: bool) -> "_Partial":
        there, previewed = (None if known is None else known.copy() for known in (self.there, self.previewed))
        if there is not None and previewed is not None:
            there[frames.start : frames.stop], previewed[frames.start : frames.stop] = True, preview
        return replace(self, params=self.params.with_frames(frames, params), there=there, previewed=previewed)

    @staticmethod
    def of(fit: FitResult) -> "_Partial":
        """What an interrupted phase 1 has found."""
        there = np.asarray(fit.observed.any(1))
        return _Partial(phase=1, params=fit.last.params, there=there, previewed=np.zeros_like(there))

    def stored(self, job: FitEverything, camera: Camera) -> FitResult:
        """What is stored of phase 1 before it has finished."""
        there = np.asarray(self.there) & ~np.asarray(self.previewed)
        unknown = np.full(len(there), np.nan)
        phase = PhaseResult(phase=1, params=self.params, objective={}, frame_cost=unknown, seconds=0.0, notes=())
        observed = np.repeat(there[:, None], OBSERVED, 1)
        return FitResult(phases=(phase,), camera=camera, config=job.config, observed=observed, start=job.begun_with)


@dataclass(frozen=True, kw_only=True)
class _Version:
    """What a run has found so far."""

    fit: FitResult | None
    """None: no phase is finished."""
    camera: Camera
    partial: _Partial | None
    """The running phase, if frames of it can be shown."""
    revision: int

    @property
    def finished(self) -> tuple[PhaseResult, ...]:
        return () if self.fit is None else self.fit.phases


def _begun(version: _Version, found: FramesFitted, length: int) -> _Partial:
    """A phase with its first frames; the others are those of the previous phase, if any."""
    if version.finished:
        return _Partial(phase=found.phase, params=version.finished[-1].params, there=None)
    none = np.zeros(length, bool)
    return _Partial(phase=found.phase, params=found.params[[0] * length], there=none, previewed=none)


def _told(run: Run, fit: FitResult | None) -> Bool[np.ndarray, "T"] | None:
    """Frames covered by another program's result; None: all."""
    if fit is None or run.kind != "imported":
        return None
    there = np.asarray(fit.observed.any(1))
    return None if there.all() else there


class Fits:
    """Results by run. Thread-safe; the worker's sink.

    A run's results are on disk before they are shown.
    """

    def __init__(self, project: Project) -> None:
        self._project = project
        self._lock = threading.RLock()
        self._versions: OrderedDict[int, _Version] = OrderedDict()
        self._asked: dict[int, float] = {}
        """When each was last requested."""
        self._revisions = count(1)
        self.at = project.last_edit
        """The log entry after which corrections are as they are shown; see `Changes`."""
        self._runs: tuple[object, tuple[Run, ...]] = (None, ())
        """The runs, with the version of their rows."""
        self._emptied: dict[int, int | None] = {}
        """The run that each run of corrections corrects, if all of its corrections were undone."""
        self._unseen = 0
        """Number of writers whose runs are not visible yet."""
        self._partly_stored: dict[int, float] = {}
        """When the first phase of each running fit was stored last."""
        self._unwritten: dict[int, FitResult] = {}
        """Finished fits that could not be written."""

    @property
    def runs(self) -> tuple[Run, ...]:
        """All runs that are not deleted, oldest first."""
        with self._lock:
            version = self.version, self.at  # taken first: what is written meanwhile is read the next time
            if self._runs[0] != version and (not self._unseen or self._runs[0] is None):
                self._runs = version, tuple(self._project.runs.all(at=self.at))
                self._emptied = {run.id: run.parent for run in self._project.runs.corrections(self.at) if run.emptied}
            return self._runs[1]

    @contextmanager
    def unseen(self) -> Iterator[None]:
        """Runs written inside become visible at its end: otherwise their fits would be looked up on disk before they
        are published."""
        with self._lock:
            self._unseen += 1
        try:
            yield
        finally:
            with self._lock:
                self._unseen -= 1

    @property
    def version(self) -> int:
        """Changes whenever a run is added, changed or removed."""
        return self._project.runs.version

    def run(self, number: int) -> Run | None:
        """A run that is not deleted."""
        return next((run for run in self.runs if run.id == number), None)

    def named(self, source: Source) -> str:
        """The short name of a run or file."""
        if source.run is None:
            return Path(source.path).name or "a file"
        run = self.run(source.run)
        return f"run {source.run}, which was deleted" if run is None else run.name

    def showable(self) -> list[Run]:
        """Runs that can be shown, oldest first."""
        with self._lock:
            there = {number for number, v in self._versions.items() if v.finished or v.partial is not None}
            return [run for run in self.runs if run.stored or run.partial or run.id in there]

    def phases(self, run: Run) -> tuple[int, ...]:
        """Which phases of a run can be shown."""
        version = self._version(run)
        return tuple(p.phase for p in version.finished) + (() if version.partial is None else (version.partial.phase,))

    def fit(self, run: Run) -> FitResult:
        """The result of a run. Raises InputError if it cannot be read, or no phase is finished."""
        fit = self._version(run).fit
        if fit is None and run.state == "running":
            raise InputError(f"{run.name} is in its first pass: wait until that has finished.")
        if fit is None:
            raise InputError(f"{run.name} was stopped in its first pass. Continue it in Fit, or choose another fit.")
        return fit

    def standing(self, choice: FitChoice) -> FitChoice:
        """The choice, with a deleted run replaced by the newest one, and one whose corrections were all undone by the
        run that they corrected."""
        if choice.run is None or self.run(choice.run) is not None:
            return choice
        corrected = self._emptied.get(choice.run)
        return replace(choice, run=None if corrected is None or self.run(corrected) is None else corrected)

    def meant(self, choice: FitChoice) -> Run | None:
        """The run that a choice refers to now."""
        number = self.standing(choice).run
        runs = [run for run in self.showable() if number in (None, run.id)]
        whole = [run for run in runs if not run.partial]
        return newest(whole or runs) if runs else None

    def before(self, run: Run | None) -> FitChoice:
        """What a run is compared with by default: the one that it started from, or the last one before a whole fit;
        otherwise its own first pass."""
        earlier = [one for one in self.showable() if run is not None and one.id < run.id]
        found = [one for one in earlier if run is not None and one.id == run.parent]
        if run is not None and not found and run.kind in ("fit", "imported"):
            found = [one for one in earlier if one.kind != "imported"]
        if found:
            return FitChoice(run=found[-1].id)
        return FitChoice(run=None if run is None else run.id, phase=1)

    def held(self, run: Run) -> bool:
        """Whether a run's result is in memory, so that no access waits for the disk."""
        with self._lock:
            return run.id in self._versions

    def show(self, choice: FitChoice) -> Shown | None:
        """The run and phase that a choice refers to now; for a phase not available yet, the last one before it. Raises
        InputError if its file cannot be read."""
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
            last=last is phases[-1],
        )

    def _version(self, run: Run) -> _Version:
        with self._lock:
            version = self._versions.get(run.id)
            if version is not None:
                self._versions.move_to_end(run.id)
                self._asked[run.id] = time.monotonic()
                return version
        if run.partial:
            found = self._project.runs.load_partial(run.id)
            with self._lock:
                return self._versions.get(run.id) or self._put(run.id, None, found.camera, _Partial.of(found))
        while True:
            at = self.at
            fit = self._project.runs.load(run.id, at)
            with self._lock:  # another thread may have published a newer one meanwhile
                if run.id in self._versions or at == self.at:
                    return self._versions.get(run.id) or self.publish(run.id, fit)

    def advance(self, at: int, changed: Mapping[int, FitResult | None]) -> None:
        """Show corrections as they are after a log entry.

        Args:
            at: The entry.
            changed: The runs that differ there, and their results; None: it is read on demand.
        """
        with self._lock:
            self.at = at
            for run, fit in changed.items():
                if fit is None:
                    self._versions.pop(run, None)
                else:
                    self.publish(run, fit)

    def publish(self, run: int, fit: FitResult, partial: _Partial | None = None) -> _Version:
        """Replace a run's result."""
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
        """Evicts results, but none that are running or on show: tabs evicting each other's would keep reading them."""
        since = time.monotonic() - IN_USE
        running = {r.id for r in self.runs if r.state == "running"}
        idle = [run for run in self._versions if run not in running and self._asked.get(run, 0.0) < since]
        for old in idle[: max(0, len(self._versions) - KEPT_FITS)]:
            del self._versions[old]
            self._asked.pop(old, None)

    def begin(self, run: Run, start: Shown | None) -> None:
        """A run was submitted that starts from another one's fit, or from nothing. Raises InputError as `fit`."""
        if start is not None:
            fit = self.fit(start.run)
            kept = tuple(p for p in fit.phases if p.phase < (2 if run.kind == "shape" else 3))
            # Frames to be refitted keep their previous values until then, all others keep them permanently.
            partial = _Partial(phase=3, params=start.params, there=None) if run.kind == "frames" else None
            self.publish(run.id, replace(fit, phases=kept, config=run.config), partial)

    def resume(self, run: int, frames: FitResult) -> None:
        """Continue a run that ended in phase 1, from these frames."""
        self._put(run, None, frames.camera, _Partial.of(frames))

    def end(self, run: int, state: Ended, message: str = "") -> None:
        """A run was cancelled or has failed; what it has stored stays. Raises InputError if that cannot be written."""
        self._project.runs.end(run, state, message)
        with self._lock:
            version = self._versions.pop(run, None)
            # A write that failed may have replaced the file: what is stored is read again then.
            if state != "failed" and version and version.fit and self._project.runs.get(run).stored:
                self.publish(run, version.fit)

    def forget(self, run: int) -> None:
        """A run was deleted."""
        with self._lock:
            self._versions.pop(run, None)

    def keep(self, job: Job, result: PhaseFinished | FramesFitted | FitResult) -> None:
        """Store the result of a job; see `worker.Sink`."""
        if isinstance(job, CorrectionJob):
            return job.keep(job, result) if isinstance(result, FitResult) else None
        assert isinstance(job, RunJob)
        if isinstance(result, FitResult):
            try:
                self._project.runs.finish(job.run_id, result)
            except InputError as error:
                self._unwritten[job.run_id] = result
                raise InputError(
                    f"The fit is done, and is saved as soon as possible: keep tcfit running. {error}"
                ) from error
            self.publish(job.run_id, result)
        elif isinstance(result, PhaseFinished):
            self._project.runs.store(job.run_id, result.so_far)
            self.publish(job.run_id, result.so_far)
        else:
            self._put_frames(job, result)

    @property
    def unwritten(self) -> tuple[int, ...]:
        """Runs whose finished fits could not be written yet."""
        return tuple(self._unwritten)

    def write_late(self) -> list[Run]:
        """Retry writing them; returns the runs finished by that."""
        written = []
        for number, found in list(self._unwritten.items()):
            if self.run(number) is not None:  # it may have been deleted meanwhile
                try:
                    written.append(self._project.runs.finish(number, found, state="failed"))
                except InputError:
                    break
                self.publish(number, found)
            del self._unwritten[number]
        return written

    def _put_frames(self, job: RunJob, found: FramesFitted) -> None:
        with self._lock:
            version = self._versions.get(job.run_id) or self._put(job.run_id, None, job.clip.camera, None)
            before, camera = version.partial, version.camera if version.fit else job.clip.camera
            if before is None or before.phase != found.phase or camera != version.camera:
                before = _begun(version, found, len(job.clip))
            fit = job.job if isinstance(job.job, FitEverything) else None
            preview = fit is not None and fit.fresh is not None
            partial = before.with_frames(found.frames, found.params, preview=preview)
            self._put(job.run_id, version.fit, camera, partial)
            since = self._partly_stored.setdefault(job.run_id, time.monotonic())
        if fit is None or preview or found.phase != 1 or time.monotonic() - since < KEPT_EVERY:
            return
        self._partly_stored[job.run_id] = time.monotonic()
        with suppress(InputError):  # a full disk: the fit continues
            self._project.runs.store_partial(job.run_id, partial.stored(fit, camera))
