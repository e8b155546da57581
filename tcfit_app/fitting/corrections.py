"""Corrections of runs: what drags and edits make of some frames, kept as runs of their own, and how undo takes it back.

Each run of corrections has its changes on the disk (`storage/changes.py`). A change belongs to the state of the
keypoints that it was fitted to. As soon as not all that stood then stands any more, it is taken back, and so are those
on top of it: the frames are again what they were, bit for bit.
"""

import threading
from dataclasses import replace
from itertools import count, takewhile
from queue import SimpleQueue
from typing import Protocol

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.fit.fitting import Refit
from fitting_core.fit.grounded import grounding_of_params
from fitting_core.fit.phase_figures import patched
from fitting_core.fit.provenance import Provenance
from fitting_core.fit.refitting import with_phases
from fitting_core.fit.result import FitResult
from tcfit_app.fitting.jobs import CorrectionJob
from tcfit_app.fitting.live import Correction, Target
from tcfit_app.project.project import Project
from tcfit_app.project.storage.changes import Changes, Frames
from tcfit_app.project.storage.run_record import Run

_NOTE = "keypoints were corrected, and the frames around them fitted again"


class Shelf(Protocol):
    """Where the fits of runs are; see `Fits`."""

    @property
    def runs(self) -> tuple[Run, ...]:
        """All that are not deleted."""
        ...

    def run(self, number: int) -> Run | None:
        """One that is not deleted."""
        ...

    def fit(self, run: Run) -> FitResult:
        """What it has found."""
        ...

    def publish(self, run: int, fit: FitResult) -> object:
        """That is this from now on."""
        ...

    def changed(self) -> None:
        """Runs are others than they were."""
        ...


class Corrections:
    """The corrections of a project's runs. Thread-safe."""

    def __init__(self, project: Project, fits: Shelf) -> None:
        self._project, self._fits = project, fits
        self._changing = threading.Lock()
        """Held from the reading of a run's corrections until they are stored with a change."""
        self._collected: dict[int, int] = {}
        """The run in which the corrections of a run are collected since `begin`."""
        self._changes: dict[int, Changes] = {}
        """By run, those that were asked for."""
        self.to_follow: SimpleQueue[tuple[Run, dict[int, bool]]] = SimpleQueue()
        """Edits that a run's fit is to follow, or to follow again, by their ids, and whether they stand."""

    def begin(self, run: int) -> None:
        """What is corrected from now on goes on from this run itself, and not from earlier corrections of it."""
        self._collected.pop(run, None)

    def of(self, run: int) -> Run:
        """The run in which corrections of a run are collected, or the run itself if there is none yet."""
        return self._fits.run(self._collected.get(run, run)) or self._project.runs.get(run)

    def keep_drag(self, correction: Correction, target: Target, refit: Refit) -> None:
        """Store a released drag, unless its edit was undone meanwhile."""
        assert correction.origin is not None
        clip, edit, now = correction.edited(target), correction.edit, self._project.last_edit
        with self._changing:
            if edit is not None and not self._project.stood(edit, now):
                return
            edits = {} if edit is None else {edit: True}
            seen = self._seen(correction.edits_seen, now)
            self._put(correction.origin, (correction.frames,), refit, clip, correction.body, seen, edits)

    def keep_followed(self, job: CorrectionJob, fit: FitResult) -> None:
        """Store what has followed edits. What is newer stays: frames that were edited meanwhile are followed again."""
        inner, now = job.job, self._project.last_edit
        assert inner is not None, "it has run"
        later = {f for frames in self._project.frames_changed_after(job.edits_seen).values() for f in frames}
        windows = tuple(window for window in inner.windows if later.isdisjoint(window))
        dropped = {frame for window in inner.windows if window not in windows for frame in window}
        followed = {
            edit: stands for edit, stands in job.edits.items() if dropped.isdisjoint(self._project.frames_of(edit))
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
        """The log entry to whose keypoints a change belongs that was fitted to those after the entry `seen`, and that
        nothing has contradicted up to the entry `now`."""
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
        """Put windows of a fit into a run's corrections: that run may have changed since they were begun."""
        base = self.of(run)
        fit = self._fits.fit(base)
        whole = fit.last.params
        for window in windows:
            whole = whole.with_frames(window, refit.params[slice(window.start, window.stop)])
        config = self._project.runs.get(run).config
        grounding = grounding_of_params(clip, body, whole, unswap=config.unswap_sides)
        phase = patched(
            fit.last,
            clip,
            body,
            fit.config,
            whole,
            windows,
            grounding=grounding,
            start=fit.start,
            provenance=refit.provenance,
            note=_NOTE,
        )
        found = replace(with_phases(fit, (phase,), config), grounding=grounding)
        if self._project.runs.get(base.id).deleted:
            raise InputError(f"{base.name} was deleted: what followed its corrections is not kept.")
        now_seen = self.edits_seen(base, windows, seen)
        new = base.kind != "corrections"
        collected = self._begun(base, found, now_seen) if new else base
        changes = self._changes_of(collected.id)
        if self._project.redoable is None:
            changes.forget(changes.taken_back)
        changes.add(
            Frames.of(fit, windows, base.edits_seen),
            # What it stands on may have overtaken it.
            seen=max([seen, *(change.about.seen for change in changes.made[-1:])]),
            edits=edits,
            frames=len(clip),
        )
        if new:
            self._project.runs.finish(collected.id, found)
            self._collected[run] = collected.id
        else:
            self._project.runs.amend(base.id, found, edits_seen=now_seen)
        self._fits.publish(collected.id, found)
        self._fits.changed()

    def _begun(self, base: Run, fit: FitResult, seen: int) -> Run:
        name, taken = f"{base.name} corrected", {run.name for run in self._fits.runs}
        names = (name if number == 1 else f"{name} {number}" for number in count(1))
        return self._project.runs.start(
            fit.config,
            body=base.body,
            edits_seen=seen,
            kind="corrections",
            parent=base.id,
            given=base.given,
            name=next(name for name in names if name not in taken),
        )

    def _changes_of(self, run: int) -> Changes:
        if run not in self._changes:
            self._changes[run] = self._project.runs.changes(run)
        return self._changes[run]

    def edits_seen(self, base: Run, windows: tuple[range, ...], seen: int) -> int:
        """Up to which log entry a run has seen all edits once windows of it are fitted again that took the entries up
        to `seen` into account."""
        fitted, last = {frame for window in windows for frame in window}, base.edits_seen
        for number, frames in self._project.frames_changed_after(last).items():
            if number > seen or not fitted.issuperset(frames):
                break
            last = number
        return last

    def take_back(self, edit: int, run: int | None) -> None:
        """After an undo or a redo: all corrections are again what they were when the same edits stood.

        Args:
            edit: The log entry that was undone or redone.
            run: The one whose fit is to follow that, if it was fitted to other keypoints and has no such correction;
                None: none is.

        Raises:
            InputError: The project cannot be written, or a fit not be read.
        """
        with self._changing:
            collected = [one for one in self._fits.runs if one.kind == "corrections" and one.state == "finished"]
            changed = {one.id for one in collected if self._brought_back(one)}
            if run is None:
                return
            now, stands = self.of(run), self._project.stands(edit)
            unknown = now.kind == "corrections" and not self._changes_of(now.id)
            if now.id not in changed and (unknown or self._project.stood(edit, now.edits_seen) != stands):
                self.to_follow.put((self._project.runs.get(run), {edit: stands}))

    def _brought_back(self, run: Run) -> bool:
        """Take changes back that are not to stand, or make them again; whether there were some."""
        changes, stood_by = self._changes_of(run.id), self._project.stood_by
        gone = list(takewhile(lambda change: not stood_by(change.about.seen), reversed(changes.made)))
        again = [] if gone else list(takewhile(lambda change: stood_by(change.about.seen), changes.taken_back))
        if not gone and not again:
            return False
        fit, seen, turned = self._fits.fit(run), run.edits_seen, []
        for change in gone or again:
            other = changes.frames(change)
            if other is None:
                changes.forget(changes.made + changes.taken_back)
                return False
            turned.append((change, Frames.of(fit, other.windows, seen)))
            fit, seen = other.put_into(fit), other.edits_seen
        self._project.runs.amend(run.id, fit, edits_seen=seen)
        for change, other in turned:
            (changes.take_back if gone else changes.make_again)(change, other)
        self._fits.publish(run.id, fit)
        self._fits.changed()
        edits = {edit: stood for change in gone for edit, stood in change.about.edits.items()}
        if left := {edit: stood for edit, stood in edits.items() if self._project.stands(edit) == stood}:
            self.to_follow.put((run, left))
        return True
