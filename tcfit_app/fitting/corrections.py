"""Corrections of runs: drags and edits refit some frames, stored as separate runs; undo restores them.

Each run of corrections has its changes on disk (`storage/changes.py`). A change belongs to the state of the keypoints
that it was fitted to. As soon as any edit in that state no longer stands, the change is undone together with those
after it: the frames become what they were, bit for bit.
"""

import threading
from contextlib import AbstractContextManager
from itertools import count, takewhile
from queue import SimpleQueue
from typing import Protocol

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.fit.fitting import Refit
from fitting_core.fit.refitting import with_windows
from fitting_core.results.fit_result import FitResult
from fitting_core.results.provenance import Provenance
from tcfit_app.fitting.jobs import CorrectionJob
from tcfit_app.fitting.live import Correction, Target
from tcfit_app.project.project import Project
from tcfit_app.project.storage.changes import Changes, Frames
from tcfit_app.project.storage.run_record import Run

_NOTE = "keypoints were corrected, and the frames around them refitted"


class Shelf(Protocol):
    """The storage of runs' fits; see `Fits`."""

    @property
    def runs(self) -> tuple[Run, ...]:
        """All that are not deleted."""
        ...

    def run(self, number: int) -> Run | None:
        """A run that is not deleted."""
        ...

    def fit(self, run: Run) -> FitResult:
        """Its result."""
        ...

    def publish(self, run: int, fit: FitResult) -> object:
        """Replace its result."""
        ...

    def unseen(self) -> AbstractContextManager[None]:
        """Runs written inside become visible at its end."""
        ...


class Corrections:
    """The corrections of a project's runs. Thread-safe."""

    def __init__(self, project: Project, fits: Shelf) -> None:
        self._project, self._fits = project, fits
        self._changing = threading.Lock()
        """Held from reading a run's corrections until they are stored with a change."""
        self._collected: dict[int, int] = {}
        """By run, the run that collects its corrections since `begin`."""
        self._changes: dict[int, Changes] = {}
        """By run, those requested."""
        self.emptied: dict[int, int] = {}
        """By run of corrections that is hidden because every one was undone, the run that it corrects."""
        self.to_follow: SimpleQueue[tuple[Run, dict[int, bool]]] = SimpleQueue()
        """Edits that a run's fit still has to follow, by id, and whether they stand."""

    def begin(self, run: int) -> None:
        """Future corrections start from this run itself, not from earlier corrections of it."""
        self._collected.pop(run, None)

    def of(self, run: int) -> Run:
        """The run that collects a run's corrections, or the run itself before the first one."""
        return self._fits.run(self._collected.get(run, run)) or self._project.runs.get(run)

    def keep_drag(self, correction: Correction, target: Target, refit: Refit) -> None:
        """Store a released drag, unless its edit has been undone meanwhile."""
        assert correction.origin is not None
        clip, edit, now = correction.edited(target), correction.edit, self._project.last_edit
        with self._changing:
            if edit is not None and not self._project.stood(edit, now):
                return
            edits = {} if edit is None else {edit: True}
            seen = self._seen(correction.edits_seen, now)
            self._put(correction.origin, (correction.frames,), refit, clip, correction.body, seen, edits)

    def keep_followed(self, job: CorrectionJob, fit: FitResult) -> None:
        """Store a fit that followed edits. Newer frames stay: those edited meanwhile are followed again."""
        inner, now = job.job, self._project.last_edit
        assert inner is not None, "it has run"
        later = {f for frames in self._project.frames_changed_after(job.edits_seen).values() for f in frames}
        windows = tuple(window for window in inner.windows if later.isdisjoint(window))
        dropped = {frame for window in inner.windows if window not in windows for frame in window}
        followed = {
            edit: stands for edit, stands in job.edits.items() if dropped.isdisjoint(self._project.frames_changed(edit))
        }
        if again := {edit: stands for edit, stands in job.edits.items() if edit not in followed}:
            self.to_follow.put((self._project.runs.get(job.origin), again))
        if windows:
            provenance = fit.last.provenance or Provenance.unknown(len(fit.last.params))
            refit = Refit(params=fit.last.params, provenance=provenance)
            with self._changing:
                seen = self._seen(job.edits_seen, now)
                self._put(job.origin, windows, refit, inner.clip, inner.body, seen, followed)

    def _seen(self, seen: int, now: int) -> int:
        """The latest log entry, up to `now`, whose keypoints are those of the entry `seen` as far as a change fitted to
        those is concerned."""
        return seen if self._project.stood_by(seen, now) else now

    def _put(
        self,
        run: int,
        windows: tuple[range, ...],
        refit: Refit,
        clip: Clip,
        body: BodyModel,
        seen: int,
        edits: dict[int, bool],
    ) -> None:
        """Put windows of a fit into a run's corrections, which may have changed since the fit was started."""
        base = self.of(run)
        hidden = base.kind == "corrections" and self._is_empty(base)
        if self._project.runs.get(base.id).deleted and not hidden:
            raise InputError(f"{base.name} was deleted, so its refitted corrections were not stored.")
        if base.kind != "corrections" and (emptied := self._last_emptied(base)) is not None:
            self._collected[run], base = emptied.id, emptied
        fit = self._fits.fit(base)
        whole = fit.last.params
        for window in windows:
            whole = whole.with_frames(window, refit.params[slice(window.start, window.stop)])
        config = self._project.runs.get(run).config
        found = with_windows(fit, clip, body, whole, windows, config=config, provenance=refit.provenance, note=_NOTE)
        now_seen = self.edits_seen(base, windows, seen)
        before = Frames.of(fit, windows, base.edits_seen)

        def change(changes: Changes) -> None:
            if self._project.redoable is None:
                changes.forget(changes.taken_back)
            # The run it is based on may already include later edits.
            latest = max([seen, *(change.about.seen for change in changes.made[-1:])])
            changes.add(before, seen=latest, edits=edits, frames=len(clip))

        with self._fits.unseen():
            if base.kind == "corrections":
                changes = self._changes_of(base.id)
                change(changes)
                try:
                    self._project.runs.amend(base.id, found, edits_seen=now_seen)
                except InputError:
                    changes.forget(changes.made[-1:])
                    raise
            else:
                base = self._project.runs.add(
                    found,
                    body=base.body,
                    edits_seen=now_seen,
                    kind="corrections",
                    parent=base.id,
                    given=base.given,
                    name=self._name(base),
                    change=change,
                )
                self._collected[run] = base.id
            self._fits.publish(base.id, found)

    def _last_emptied(self, base: Run) -> Run | None:
        """The last run of corrections of a run of which every one was undone: it is what that run is."""
        emptied = [run for run in self._runs_to_bring_back() if run.parent == base.id and self._is_empty(run)]
        return emptied[-1] if emptied else None

    def _is_empty(self, run: Run) -> bool:
        changes = self._changes_of(run.id)
        return bool(changes.taken_back) and not changes.made

    def _runs_to_bring_back(self) -> list[Run]:
        """The runs of corrections, with those that are hidden because every correction was undone."""
        everything = [*self._fits.runs, *self._project.runs.all(deleted=True)]
        collected = [run for run in everything if run.kind == "corrections" and run.state == "finished"]
        return [run for run in collected if not run.deleted or self._is_empty(run)]

    def _name(self, base: Run) -> str:
        name, taken = f"{base.name} corrected", {run.name for run in self._fits.runs}
        names = (name if number == 1 else f"{name} {number}" for number in count(1))
        return next(name for name in names if name not in taken)

    def _changes_of(self, run: int) -> Changes:
        if run not in self._changes:
            self._changes[run] = self._project.runs.changes(run)
        return self._changes[run]

    def edits_seen(self, base: Run, windows: tuple[range, ...], seen: int) -> int:
        """The log entry up to which a run includes all edits once windows are refitted with those up to `seen`."""
        fitted, last = {frame for window in windows for frame in window}, base.edits_seen
        for number, frames in self._project.frames_changed_after(last).items():
            if number > seen or not fitted.issuperset(frames):
                break
            last = number
        return last

    def take_back(self, edit: int, run: int | None) -> None:
        """After an undo or a redo, restore all corrections to their state when the same edits stood. Raises InputError
        if the project cannot be written, or a fit cannot be read.

        Args:
            edit: The log entry undone or redone.
            run: The run whose fit is to follow if it was fitted to other keypoints and has no such correction; None: no
                run.
        """
        with self._changing:
            changed = {one.id for one in self._runs_to_bring_back() if self._brought_back(one)}
            if run is None:
                return
            now, stands = self.of(run), self._project.stands(edit)
            unknown = now.kind == "corrections" and not self._changes_of(now.id)
            if now.id not in changed and (unknown or self._project.stood(edit, now.edits_seen) != stands):
                self.to_follow.put((self._project.runs.get(run), {edit: stands}))

    def _brought_back(self, run: Run) -> bool:
        """Undo or redo changes that no longer match the edits; returns whether there were any."""
        changes, stood_by = self._changes_of(run.id), self._project.stood_by
        gone = list(takewhile(lambda change: not stood_by(change.about.seen), reversed(changes.made)))
        again = [] if gone else list(takewhile(lambda change: stood_by(change.about.seen), changes.taken_back))
        if not gone and not again:
            return False
        fit, seen, frames = self._fits.fit(run), run.edits_seen, []
        for change in gone or again:
            other = changes.frames(change)
            if other is None:
                changes.forget(changes.made + changes.taken_back)
                return False
            frames.append(Frames.of(fit, other.windows, seen))
            fit, seen = other.put_into(fit), other.edits_seen
        with self._fits.unseen():
            turning = changes.turning(gone or again, frames)
            emptied = len(gone) == len(changes.made) > 0
            self._project.runs.amend(run.id, fit, edits_seen=seen, hidden=emptied)
            changes.turn(turning)
            if run.parent is not None and emptied:
                self.emptied[run.id] = run.parent
            elif run.parent is not None and run.deleted:
                self._collected[run.parent] = run.id
            self._fits.publish(run.id, fit)
        edits = {edit: stood for change in gone for edit, stood in change.about.edits.items()}
        if left := {edit: stood for edit, stood in edits.items() if self._project.stands(edit) == stood}:
            self.to_follow.put((run, left))
        return True
