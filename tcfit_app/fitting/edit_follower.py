"""Live fitting: while a keypoint is dragged, and after edits."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import count

from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.results.given_start import GivenStart
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.fits import Fits, Shown
from tcfit_app.fitting.jobs import CorrectionJob, RerunFrames, around
from tcfit_app.fitting.live import LIVE_REACH, Correction, Target
from tcfit_app.fitting.reports import DragEnded, DragMoved, ErrandEnded, Notice
from tcfit_app.fitting.worker import LiveDrag, Worker
from tcfit_app.project.edits.edit_log import LogEntry
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Run

MOST_FOLLOWED = 60
"""Maximum number of frames refitted automatically after an edit; for more, the user starts it."""
SETTLING = 0.4
"""Seconds without further edits before the fit follows: holding a key down makes one job."""


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
class _Recent:
    """Edits that a run's fit will follow."""

    run: Run
    edits: dict[int, bool]
    """By id, and whether they stand: an undo is followed too."""
    since: float


class EditFollower:
    """Makes the fit follow drags and edits. For the drawing thread only."""

    def __init__(self, project: Project, bodies: Bodies, fits: Fits, worker: Worker) -> None:
        self._windows_of: dict[int, LiveWindow] = {}
        """The window of each drag, by its number: several tabs may drag at once. Previews have negative numbers."""
        self.after_edits = True
        """Whether the fit follows edits automatically."""
        self._project, self._bodies, self._fits, self._worker = project, bodies, fits, worker
        self._drags: dict[int, tuple[LiveDrag, Run]] = {}
        self._revisions = count(1)
        self._recent: dict[int, _Recent] = {}
        self._settled: dict[int, _Recent] = {}
        """Edits waiting for the run's previous corrections: one job then follows them all."""
        self._under_way: set[int] = set()
        """Runs whose corrections are being fitted or queued."""
        self._taking_back: set[int] = set()
        """Running errands of the worker."""

    @property
    def live(self) -> LiveWindow | None:
        """The newest window of any drag, if any."""
        return max(self._windows_of.values(), key=lambda window: window.revision, default=None)

    def window(self, run: int, frame: int) -> LiveWindow | None:
        """The newest window of a drag containing this frame, of a run or of the run that collects its corrections."""
        of = self._fits.corrections.of
        there = (w for w in self._windows_of.values() if frame in w.frames and run in (w.run, of(w.run).id))
        return max(there, key=lambda window: window.revision, default=None)

    @property
    def busy(self) -> bool:
        """Whether the fit is following a drag, or is about to follow an edit."""
        return bool(self._drags or self._recent or self._settled or self._taking_back)

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
        return f"B shows {shown.title}, but only the last phase of a whole fit follows edits"

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
        self._go_on_from(shown.run)

        def of(clip: Clip, params: BodyParams, given: GivenStart | None, seen: int = 0) -> Correction:
            return Correction(
                clip=clip,
                body=body,
                config=shown.run.config,
                params=params,
                start=given,
                frame=frame,
                keypoints=joints,
                in_depth=in_depth,
                origin=shown.run.id,
                edits_seen=seen,
                renewed=renewed,
            )

        def renewed() -> Correction:
            start = self._fits.fit(self._fits.corrections.of(shown.run.id))
            seen = self._project.last_edit
            return of(self._clip(start.camera), start.last.params, start.start, seen)

        # The worker renews it before it starts: corrections that are not in memory are read, and the current keypoints
        # assembled, on its thread.
        drag = self._worker.drag(of(replace(self._project.footage, camera=shown.camera), shown.params, None), target)
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
        if drag.released and drag.edit is not None and self.after_edits:
            self.follow(run, {drag.edit: True})

    def edited(self, entry: LogEntry, shown: Shown) -> None:
        """An edit was made while this fit was on show."""
        if not self.after_edits or shown.phase != 3 or shown.result is None:
            return
        self._go_on_from(shown.run)
        self.follow(shown.run, {entry.id: True})

    def went_back(self, edit: int, shown: Shown | None) -> None:
        """An edit was undone or redone while this fit was on show: restore the previous result.

        If the fit was made with the edit, there is no result without it, and the fit follows this as another edit.
        """
        waited = [waiting for waiting in (*self._recent.values(), *self._settled.values()) if edit in waiting.edits]
        for waiting in waited:
            del waiting.edits[edit]
        follows = self.after_edits and shown is not None and shown.phase == 3 and shown.result is not None
        run = shown.run.id if shown is not None and follows and not waited else None
        self._taking_back.add(self._worker.run_errand(lambda: self._fits.corrections.take_back(edit, run)))

    def take_errand(self, report: ErrandEnded) -> None:
        """Corrections were undone."""
        self._taking_back.discard(report.errand)

    def _go_on_from(self, run: Run) -> None:
        """Future corrections start from the run on show, except for corrections of it under way."""
        begun = {run.id for _, run in self._drags.values()} | {*self._recent, *self._settled} | self._under_way
        if run.id not in begun:
            self._fits.corrections.begin(run.id)

    def take_up(self) -> None:
        """Follow what the worker could not finish."""
        left = self._fits.corrections.to_follow
        while not left.empty():
            run, edits = left.get()
            if self.after_edits:
                self.follow(run, edits)

    def follow(self, run: Run, edits: dict[int, bool]) -> None:
        """Refit the frames around edits, soon."""
        before = self._recent.get(run.id)
        self._recent[run.id] = _Recent(run=run, edits=(before.edits if before else {}) | edits, since=time.monotonic())

    def ended(self, run: int, *, cancelled: bool) -> None:
        """A job that followed edits of a run has ended; if it was cancelled, so are waiting edits."""
        self._under_way.discard(run)
        if cancelled:
            self._recent.pop(run, None)
            self._settled.pop(run, None)

    def due(self, tell: Callable[[Notice], None]) -> CorrectionJob | None:
        """The job that refits the frames around recent edits, once these have settled. Further edits of a run whose
        corrections are under way wait, and are followed together.

        `tell` receives a notice if the fit cannot follow: too many edits, or no body model.
        """
        self._settle(tell)
        recent = next((recent for run, recent in self._settled.items() if run not in self._under_way), None)
        if recent is None:
            return None
        del self._settled[recent.run.id]
        if not recent.edits:
            return None
        try:
            job = self._job(recent.run, recent.edits)
        except InputError as error:
            tell(Notice(title="The fit cannot follow", text=str(error), kind="error"))
            return None
        self._under_way.add(recent.run.id)
        return job

    def _wanted(self, edits: dict[int, bool]) -> dict[int, bool]:
        """The edits whose state has not changed again."""
        return {edit: stands for edit, stands in edits.items() if self._project.stands(edit) == stands}

    def _frames(self, edits: Iterable[int]) -> set[int]:
        return {frame for edit in edits for frame in self._project.frames_changed(edit)}

    def _settle(self, tell: Callable[[Notice], None]) -> None:
        """Move runs that were not edited for a while to those waiting."""
        latest = time.monotonic() - SETTLING
        for recent in [recent for recent in self._recent.values() if recent.since <= latest]:
            del self._recent[recent.run.id]
            recent.edits = self._wanted(recent.edits)
            if not recent.edits:
                continue
            if sum(map(len, self._windows(recent.edits))) > MOST_FOLLOWED:
                text = f"{len(self._frames(recent.edits))} frames were edited: re-run them when you are done."
                tell(Notice(title="Too many edits to refit automatically", text=text))
            elif (waiting := self._settled.setdefault(recent.run.id, recent)) is not recent:
                waiting.edits |= recent.edits

    def _windows(self, edits: Iterable[int]) -> tuple[range, ...]:
        return around(self._frames(edits), LIVE_REACH, len(self._project.detections))

    def _job(self, run: Run, edits: dict[int, bool]) -> CorrectionJob:
        body = self._bodies.of(run.body)
        config = replace(run.config, solver="lm", temporal=replace(run.config.temporal, stages=(5,)))

        def renewed(job: CorrectionJob) -> tuple[RerunFrames, dict[int, bool], int]:
            seen, left = self._project.last_edit, self._wanted(job.edits)
            start = self._fits.fit(self._fits.corrections.of(run.id))
            clip = self._clip(start.camera)
            return (
                RerunFrames(clip=clip, body=body, config=config, start=start, windows=self._windows(left)),
                left,
                seen,
            )

        frames = sorted(frame for window in self._windows(edits) for frame in window)
        where = in_words(frames, self._project.footage.first_frame)
        return CorrectionJob(origin=run.id, edits=edits, title=f"Follow edits: re-run {where}", renewed=renewed)

    def _clip(self, camera: Camera) -> Clip:
        return replace(self._project.clip, camera=camera)
