"""The fit follows edits: while keypoints are dragged, after edits, and back when these are undone.

What follows is stored as a run of corrections beside the corrected one: that run's fit, with changes of frames that
each belong to an entry of the edit log (`Changes`). Undo restores the frames bit for bit, because the changes whose
edits no longer stand are simply left out.
"""

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from itertools import count

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.fit.fitting import Refit
from fitting_core.fit.refitting import with_windows
from fitting_core.results.fit_result import FitResult
from fitting_core.results.provenance import Provenance
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.fits import Fits, Shown
from tcfit_app.fitting.jobs import CorrectionJob, RerunFrames, around
from tcfit_app.fitting.live import LIVE_REACH, Correction, Target
from tcfit_app.fitting.reports import DragEnded, DragMoved, ErrandEnded, Notice
from tcfit_app.fitting.worker import LiveDrag, Worker
from tcfit_app.project.edits.edit_log import LogEntry
from tcfit_app.project.edits.kinds import AddView, Keep, Release, RemoveView
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.project import Project
from tcfit_app.project.storage.changes import Changes, Frames
from tcfit_app.project.storage.run_record import Run

MOST_FOLLOWED = 60
"""Maximum number of frames refitted automatically after an edit; for more, the user starts it, except for an offset,
which is of many frames by nature."""
SETTLING = 0.4
"""Seconds without further edits before the fit follows: holding a key down makes one job."""
_NOTE = "keypoints were corrected, and the frames around them refitted"


@dataclass(frozen=True, kw_only=True)
class LiveWindow:
    """The frames around a keypoint being dragged."""

    run: int
    frames: range
    params: BodyParams
    """For these frames."""
    revision: int
    """Unique per window, even across drags: meshes are cached by it."""


@dataclass(kw_only=True)
class _Pending:
    """Edits that a run's fit will follow, by id, and whether they stand: an undo is followed too."""

    run: Run
    recent: dict[int, bool] = field(default_factory=dict)
    since: float = 0.0
    """When the last of them was made."""
    settled: dict[int, bool] = field(default_factory=dict)
    """They wait for the run's previous corrections: one job then follows them all."""


class EditFollower:
    """Makes the fits follow drags and edits. For the drawing thread, but for what the worker's thread stores."""

    def __init__(self, project: Project, bodies: Bodies, fits: Fits, worker: Worker) -> None:
        self._windows_of: dict[int, LiveWindow] = {}
        """The window of each drag, by its number: several tabs may drag at once. Previews have negative numbers."""
        self.after_edits = True
        """Whether the fit follows edits automatically."""
        self._project, self._bodies, self._fits, self._worker = project, bodies, fits, worker
        self._drags: dict[int, tuple[LiveDrag, Run]] = {}
        self._revisions = count(1)
        self._lock = threading.Lock()
        """Guards `_pending`, to which both threads add."""
        self._pending: dict[int, _Pending] = {}
        self._under_way: set[int] = set()
        """Runs whose corrections are being fitted or queued."""
        self._taking_back: set[int] = set()
        """Running errands of the worker."""

    # --- the runs that collect corrections ---

    def of(self, run: int) -> Run:
        """The run that shows a run's current corrections, or the run itself without any."""
        found = [one for one in self._fits.runs if one.id == run or _corrects(one, run)]
        return found[-1] if found else self._project.runs.get(run)

    def edits_seen(self, base: Run, windows: tuple[range, ...], seen: int) -> int:
        """The log entry up to which a run includes all edits once windows are refitted with those up to `seen`."""
        fitted, last = {frame for window in windows for frame in window}, base.edits_seen
        for number, frames in self._project.frames_changed_after(last).items():
            if number > seen or not fitted.issuperset(frames):
                break
            last = number
        return last

    # --- drags ---

    @property
    def live(self) -> LiveWindow | None:
        """The newest window of any drag, if any."""
        return max(self._windows_of.values(), key=lambda window: window.revision, default=None)

    def window(self, run: int, frame: int) -> LiveWindow | None:
        """The newest window of a drag containing this frame, of a run or of the run that collects its corrections."""
        there = (w for w in self._windows_of.values() if frame in w.frames and run in (w.run, self.of(w.run).id))
        return max(there, key=lambda window: window.revision, default=None)

    @property
    def busy(self) -> bool:
        """Whether the fit is following a drag, or is about to follow an edit."""
        return bool(self._drags or self._pending or self._taking_back)

    @property
    def lags(self) -> bool:
        """Whether a fit that follows edits does not show all of them yet."""
        return self.busy or bool(self._under_way)

    @staticmethod
    def obstacle(shown: Shown | None) -> str:
        """Why a fit does not follow edits, for users; empty if it does, or without a fit."""
        if shown is None or (shown.phase == 3 and shown.result is not None):
            return ""
        if shown.run.kind == "imported":
            return f"{shown.run.name} was imported"
        if shown.run.state == "running":
            return f"{shown.run.name} is still being fitted"
        return f"only the final pass of a fit follows edits, and this is {shown.title}"

    def begin_drag(
        self, shown: Shown, frame: int, joints: tuple[int, ...], target: Target, *, in_depth: bool = False
    ) -> LiveDrag | None:
        """Make the fit follow a drag; None if it cannot: without a temporal phase, or if its body model is missing."""
        if shown.phase != 3 or shown.result is None or self._project.read_only:
            return None
        try:
            body = self._bodies.of(shown.run.body)
        except InputError:
            return None  # the picture says so

        def of(clip: Clip, params: BodyParams, fit: FitResult | None = None, seen: int = 0) -> Correction:
            return Correction(
                clip=clip,
                body=body,
                config=shown.run.config,
                params=params,
                start=None if fit is None else fit.start,
                size=None if fit is None else fit.size,
                frame=frame,
                keypoints=joints,
                in_depth=in_depth,
                edits_seen=seen,
                renewed=renewed,
            )

        def renewed() -> Correction:
            start = self._fits.fit(self.of(shown.run.id))
            seen = self._project.last_edit
            return of(self._project.related_clip(start.camera), start.last.params, start, seen)

        def keep(correction: Correction, target: Target, refit: Refit, edit: int | None) -> None:
            self._keep_drag(shown.run.id, correction, target, refit, edit)

        # The worker renews it before it starts: corrections that are not in memory are read, and the current keypoints
        # assembled, on its thread.
        begun = of(replace(self._project.footage, camera=shown.camera), shown.params)
        drag = self._worker.drag(begun, target, keep)
        self._drags[drag.number] = (drag, shown.run)
        return drag

    def take_move(self, moved: DragMoved) -> None:
        """A drag has changed the fit."""
        if moved.drag in self._drags:
            run = self._drags[moved.drag][1]
            self._windows_of[moved.drag] = LiveWindow(
                run=run.id, frames=moved.frames, params=moved.params, revision=next(self._revisions)
            )

    def preview(self, number: int, run: Run, frame: int, params: BodyParams) -> None:
        """Show a body in place of a run's in one frame, like that of a drag.

        Args:
            number: Of the preview: whose it is.
            run: Which run.
            frame: In which frame.
            params: Of that frame.
        """
        self._windows_of[-1 - number] = LiveWindow(
            run=run.id, frames=range(frame, frame + 1), params=params, revision=next(self._revisions)
        )

    def end_preview(self, number: int) -> None:
        """Show the run again."""
        self._windows_of.pop(-1 - number, None)

    def take_end(self, report: DragEnded) -> None:
        """A drag has ended; a failed one is followed like other edits, now or once it is released."""
        drag, run = self._drags.pop(report.drag, (None, None))
        self._windows_of.pop(report.drag, None)
        if drag is None or run is None or report.how != "failed":
            return
        drag.failed = True
        if drag.released and drag.edit is not None:
            self.follow(run, {drag.edit: True})

    # --- edits ---

    def edited(self, entry: LogEntry, shown: Shown) -> None:
        """An edit was made while this fit was on show."""
        if not self.after_edits or shown.phase != 3 or shown.result is None:
            return
        self.follow(shown.run, {entry.id: True})

    def went_back(self, edit: int, shown: Shown | None) -> None:
        """An edit was undone or redone while this fit was on show: restore the previous result.

        If the fit was made with the edit, there is no result without it, and the fit follows this as another edit.
        """
        with self._lock:
            pending = [edits for one in self._pending.values() for edits in (one.recent, one.settled)]
            waited = [edits.pop(edit) for edits in pending if edit in edits]
        follows = self.after_edits and shown is not None and shown.phase == 3 and shown.result is not None
        run = shown.run.id if shown is not None and follows and not waited else None
        self._taking_back.add(self._worker.run_errand(lambda: self._take_back(edit, run)))

    def take_errand(self, report: ErrandEnded) -> None:
        """Corrections were undone."""
        self._taking_back.discard(report.errand)

    def follow(self, run: Run, edits: dict[int, bool]) -> None:
        """Refit the frames around edits, soon, unless the user has turned that off. For any thread."""
        if edits and self.after_edits:
            with self._lock:
                pending = self._pending.setdefault(run.id, _Pending(run=run))
                pending.recent |= edits
                pending.since = time.monotonic()

    def ended(self, run: int, *, cancelled: bool) -> None:
        """A job that followed edits of a run has ended; if it was cancelled, so are pending edits."""
        self._under_way.discard(run)
        if cancelled:
            with self._lock:
                self._pending.pop(run, None)

    def due(self, tell: Callable[[Notice], None]) -> CorrectionJob | None:
        """The job that refits the frames around recent edits, once these have settled. Further edits of a run whose
        corrections are under way wait, and are followed together.

        `tell` receives a notice if the fit cannot follow: too many edits, or no body model.
        """
        with self._lock:
            latest = time.monotonic() - SETTLING
            for one in self._pending.values():
                if one.recent and one.since <= latest:
                    one.settled |= self._accepted(one.recent, tell)
                    one.recent = {}
            ready = [one for one in self._pending.values() if one.settled and one.run.id not in self._under_way]
            run, edits = (ready[0].run, ready[0].settled) if ready else (None, {})
            if ready:
                ready[0].settled = {}
            self._pending = {number: one for number, one in self._pending.items() if one.recent or one.settled}
        if run is None:
            return None
        try:
            job = self._job(run, edits)
        except InputError as error:
            tell(Notice(title="The fit cannot follow", text=str(error), kind="error"))
            return None
        self._under_way.add(run.id)
        return job

    def _accepted(self, recent: dict[int, bool], tell: Callable[[Notice], None]) -> dict[int, bool]:
        """Recent edits that the fit follows; none if they are too many. Whole views need a new fit."""
        edits = self._wanted(recent)
        if views := [edit for edit in edits if isinstance(self._project.standing.said(edit), AddView | RemoveView)]:
            tell(Notice(title="Fit the clip again", text="The fits on show were made with other views than these."))
            edits = {edit: stands for edit, stands in edits.items() if edit not in views}
        counted = [edit for edit in edits if not isinstance(self._project.standing.said(edit), Keep | Release)]
        if sum(map(len, self._windows(counted))) <= MOST_FOLLOWED:
            return edits
        text = f"{len(self._frames(counted))} frames were edited: re-run them when you are done."
        tell(Notice(title="Too many edits to refit automatically", text=text))
        return {}

    def _wanted(self, edits: dict[int, bool]) -> dict[int, bool]:
        """The edits whose state has not changed again."""
        return {edit: stands for edit, stands in edits.items() if self._project.standing.stood(edit) == stands}

    def _frames(self, edits: Iterable[int]) -> set[int]:
        return {frame for edit in edits for frame in self._project.standing.said(edit).frames}

    def _windows(self, edits: Iterable[int]) -> tuple[range, ...]:
        return around(self._frames(edits), LIVE_REACH, len(self._project.detections))

    def _job(self, run: Run, edits: dict[int, bool]) -> CorrectionJob:
        body = self._bodies.of(run.body)
        config = replace(run.config, solver="lm", temporal=replace(run.config.temporal, stages=(5,)))

        def renewed(job: CorrectionJob) -> tuple[RerunFrames, dict[int, bool], int]:
            seen, left = self._project.last_edit, self._wanted(job.edits)
            start = self._fits.fit(self.of(run.id))
            clip, windows = self._project.related_clip(start.camera), self._windows(left)
            return RerunFrames(clip=clip, body=body, config=config, start=start, windows=windows), left, seen

        frames = sorted(frame for window in self._windows(edits) for frame in window)
        title = f"Follow edits: re-run {in_words(frames, self._project.footage.first_frame)}"
        return CorrectionJob(origin=run.id, edits=edits, title=title, renewed=renewed, keep=self._keep_followed)

    # --- storing, on the worker's thread ---

    def _keep_drag(self, run: int, correction: Correction, target: Target, refit: Refit, edit: int | None) -> None:
        """Store a released drag, unless its edit has been undone meanwhile."""
        now = self._catch_up()
        if edit is None or self._project.standing.stood(edit, now):
            edits, seen = {} if edit is None else {edit: True}, correction.edits_seen
            self._put(run, (correction.frames,), refit, correction.edited(target), correction.body, seen, edits)

    def _keep_followed(self, job: CorrectionJob, fit: FitResult) -> None:
        """Store a fit that followed edits. Newer frames stay: those edited meanwhile are followed again."""
        self._catch_up()
        inner, project = job.job, self._project
        assert inner is not None, "it has run"
        later = {frame for frames in project.frames_changed_after(job.edits_seen).values() for frame in frames}
        windows = tuple(window for window in inner.windows if later.isdisjoint(window))
        dropped = {frame for window in inner.windows if window not in windows for frame in window}
        again = {
            edit: on for edit, on in job.edits.items() if not dropped.isdisjoint(project.standing.said(edit).frames)
        }
        self.follow(project.runs.get(job.origin), again)
        if windows:
            provenance = fit.last.provenance or Provenance.unknown(len(fit.last.params))
            refit = Refit(params=fit.last.params, provenance=provenance)
            followed = {edit: on for edit, on in job.edits.items() if edit not in again}
            self._put(job.origin, windows, refit, inner.clip, inner.body, job.edits_seen, followed)

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
        project, now = self._project, self._fits.at
        base = self._collecting(run)
        if project.runs.get(base.id).deleted:
            raise InputError(f"{base.name} was deleted, so its refitted corrections were not stored.")
        fit, config = self._fits.fit(base), project.runs.get(run).config
        whole = fit.last.params
        for window in windows:
            whole = whole.with_frames(window, refit.params[slice(window.start, window.stop)])
        found = with_windows(fit, clip, body, whole, windows, config=config, provenance=refit.provenance, note=_NOTE)
        frames = Frames.of(found, windows, self.edits_seen(base, windows, seen))
        if not project.standing.stood_by(seen, now):  # keypoints of other frames have changed since
            seen = now

        def change(changes: Changes) -> None:
            changes.add(frames, seen=seen, edits=edits)

        with self._fits.unseen():
            if base.kind == "corrections":
                if project.redoable is None:
                    project.runs.changes(base.id).forget_undone()
                project.runs.change(base.id, change)
            else:
                base = project.runs.start(
                    fit.config,
                    fit=fit,
                    body=base.body,
                    edits_seen=base.edits_seen,
                    kind="corrections",
                    parent=base.id,
                    given=base.given,
                    change=change,
                )
            self._fits.advance(now, {base.id: frames.put_into(fit)})

    def _collecting(self, run: int) -> Run:
        """The run that receives new corrections, possibly one whose corrections were all undone; without corrections,
        the run itself."""
        base = self.of(run)
        undone = [one for one in self._project.runs.corrections(self._fits.at) if _corrects(one, base.id)]
        return undone[-1] if undone else base

    def _take_back(self, edit: int, run: int | None) -> None:
        """After an undo or a redo, show all corrections as the edits stand now. Raises InputError if a fit cannot be
        read.

        Args:
            edit: The log entry undone or redone.
            run: The run whose fit follows it if it was fitted to other keypoints and has no change for it; None: no
                run.
        """
        self._catch_up()
        stands = bool(self._project.standing.stood(edit))
        if run is not None and self._includes(self.of(run), edit) != stands:
            self.follow(self._project.runs.get(run), {edit: stands})

    def _includes(self, run: Run, edit: int) -> bool | None:
        """Whether a run's fit was made with an edit; None: unknown, because its changes are missing."""
        changes = self._project.runs.changes(run.id)
        for change in reversed(changes.standing()):
            if edit in change.about.edits:
                return change.about.edits[edit]
        return None if run.kind == "corrections" and not changes else self._project.standing.stood(edit, run.edits_seen)

    def _catch_up(self) -> int:
        """Show all corrections as the edits stand now; returns the last log entry. Raises InputError if a fit cannot be
        read."""
        now, then = self._project.last_edit, self._fits.at
        changed: dict[int, FitResult | None] = {}
        problem: InputError | None = None
        with self._fits.unseen():
            for run in self._project.runs.corrections():
                changes = self._project.runs.changes(run.id)
                if changes.applied(then) == changes.applied(now):
                    continue
                try:
                    changed[run.id] = self._project.runs.load(run.id, now) if self._fits.held(run) else None
                except InputError as error:
                    changed[run.id], problem = None, error
                gone = [change for change in changes.standing(then) if change not in changes.standing(now)]
                self.follow(run, self._wanted({edit: on for change in gone for edit, on in change.about.edits.items()}))
            self._fits.advance(now, changed)
        if problem is not None:
            raise problem
        return now


def _corrects(run: Run, corrected: int) -> bool:
    """Whether a run has the corrections of another one."""
    return run.kind == "corrections" and run.parent == corrected
