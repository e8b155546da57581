"""The fit follows the hand: while a keypoint is dragged, and after edits."""

import time
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass, replace
from itertools import count

from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.fit.evidence.given_start import GivenStart
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.fits import Fits, Shown
from tcfit_app.fitting.jobs import CorrectionJob, RerunFrames, around
from tcfit_app.fitting.live import REACH, Correction, Target
from tcfit_app.fitting.reports import DragEnded, DragMoved, Notice
from tcfit_app.fitting.worker import Drag, Worker
from tcfit_app.project.edits.edit_log import LogEntry
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Run

MOST_FOLLOWED = 60
"""Frames that follow an edit by themselves; more are fitted again when the user says so."""
SETTLING = 0.4
"""Seconds without a further edit after which the fit follows: a key held down makes one job."""


@dataclass(frozen=True, kw_only=True)
class LiveWindow:
    """The frames around a keypoint that is being dragged."""

    run: int
    frames: range
    params: BodyParams
    """Of these frames."""
    revision: int
    """Another number for every window, also of later drags: meshes are kept by it."""


@dataclass(kw_only=True)
class _Recent:
    """Edits that a run's fit is going to follow."""

    run: Run
    frames: set[int]
    since: float


class EditFollower:
    """Lets the fit follow drags and edits. For the one thread that draws.

    Args:
        project: whose keypoints are corrected.
        bodies: where body models come from.
        fits: of the project.
        worker: does it.
    """

    def __init__(self, project: Project, bodies: Bodies, fits: Fits, worker: Worker) -> None:
        self._windows_of: dict[int, LiveWindow] = {}
        """What each drag has led to so far, by its number: several tabs may drag at once."""
        self.after_edits = True
        """Whether the fit follows edits by itself."""
        self._project, self._bodies, self._fits, self._worker = project, bodies, fits, worker
        self._drags: dict[int, tuple[Drag, Run]] = {}
        self._revisions = count(1)
        self._recent: dict[int, _Recent] = {}
        self._settled: dict[int, _Recent] = {}
        """Held until the run's corrections before them are through: then one job follows them all."""

    @property
    def live(self) -> LiveWindow | None:
        """What a drag has led to last; None while there is none."""
        return max(self._windows_of.values(), key=lambda window: window.revision, default=None)

    def window(self, run: int, frame: int) -> LiveWindow | None:
        """What a drag has led to last in a frame of a run."""
        there = (w for w in self._windows_of.values() if w.run == run and frame in w.frames)
        return max(there, key=lambda window: window.revision, default=None)

    @property
    def busy(self) -> bool:
        """Whether the fit follows a drag, or is about to follow an edit."""
        return bool(self._drags or self._recent or self._settled)

    @staticmethod
    def obstacle(shown: Shown | None) -> str:
        """Why a fit does not follow edits, for the user; empty if it does, or if there is none."""
        if shown is None or (shown.phase == 3 and shown.result is not None):
            return ""
        if shown.run.kind == "imported":
            return f"{shown.run.name} was imported"
        if shown.run.state == "running":
            return f"{shown.run.name} is still being fitted"
        return f"B shows {shown.title}, and only the last phase of a whole fit follows"

    def begin_drag(
        self, shown: Shown, frame: int, joints: tuple[int, ...], target: Target, *, in_depth: bool = False
    ) -> Drag | None:
        """Let the fit follow a drag; None if this fit cannot: it has no temporal phase, or its body is not there."""
        if shown.phase != 3 or shown.result is None or self._project.read_only:
            return None
        try:
            body = self._bodies.of(shown.run.body)
        except InputError:
            return None  # the picture says so

        def of(camera: Camera, params: BodyParams, given: GivenStart | None) -> Correction:
            seen = self._project.last_edit
            return Correction(
                clip=self._clip(camera),
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
            start = self._fits.fit(self._fits.corrections_of(shown.run.id))
            return of(start.camera, start.last.params, start.start)

        # The worker renews it before it begins: corrections that are not in memory are read on its thread.
        drag = self._worker.drag(of(shown.camera, shown.params, None), target)
        self._drags[drag.number] = (drag, shown.run)
        return drag

    def take_move(self, moved: DragMoved) -> None:
        """A drag has led to another fit."""
        if moved.drag in self._drags:
            run = self._drags[moved.drag][1]
            self._windows_of[moved.drag] = LiveWindow(
                run=run.id, frames=moved.frames, params=moved.params, revision=next(self._revisions)
            )

    def take_end(self, report: DragEnded) -> None:
        """A drag has ended; one that failed is followed as other edits are, now or once it is released."""
        drag, run = self._drags.pop(report.drag, (None, None))
        self._windows_of.pop(report.drag, None)
        if drag is None or run is None or report.how != "failed":
            return
        drag.failed = True
        if drag.released and self.after_edits:
            self.follow(run, {drag.correction.frame})

    def edited(self, entry: LogEntry, shown: Shown) -> None:
        """An edit was made while this fit was on show."""
        if not self.after_edits or shown.phase != 3 or shown.result is None:
            return
        self.follow(shown.run, getattr(entry.action, "frames", ()))

    def follow(self, run: Run, frames: Iterable[int]) -> None:
        """Fit the surroundings of frames of a run again, soon."""
        before = self._recent.get(run.id)
        found = set(frames) | (before.frames if before else set())
        self._recent[run.id] = _Recent(run=run, frames=found, since=time.monotonic())

    def forget(self, run: int) -> None:
        """Do not follow the edits that wait for a run's corrections: the user cancelled those."""
        self._recent.pop(run, None)
        self._settled.pop(run, None)

    def due(self, tell: Callable[[Notice], None], under_way: Container[int] = ()) -> CorrectionJob | None:
        """Fits the surroundings of recent edits again, once these have settled.

        Args:
            tell: gets to know of edits that the fit does not follow by itself: too many, or without the body model.
            under_way: Runs whose corrections are being fitted, or wait for it: their further edits wait, and are
                followed together.
        """
        self._settle(tell)
        recent = next((recent for run, recent in self._settled.items() if run not in under_way), None)
        if recent is None:
            return None
        del self._settled[recent.run.id]
        try:
            return self._job(recent.run, frozenset(recent.frames), self._windows(recent.frames))
        except InputError as error:
            tell(Notice(title="The fit cannot follow", text=str(error), kind="error"))
            return None

    def _settle(self, tell: Callable[[Notice], None]) -> None:
        """Edits that nothing was added to for a while go to those that wait."""
        latest = time.monotonic() - SETTLING
        for recent in [recent for recent in self._recent.values() if recent.since <= latest]:
            del self._recent[recent.run.id]
            if sum(map(len, self._windows(recent.frames))) > MOST_FOLLOWED:
                text = f"{len(recent.frames)} frames were edited: re-run them when you are done."
                tell(Notice(title="The fit does not follow by itself", text=text))
            elif (waiting := self._settled.setdefault(recent.run.id, recent)) is not recent:
                waiting.frames |= recent.frames

    def _windows(self, frames: Iterable[int]) -> tuple[range, ...]:
        return around(frames, REACH, len(self._project.detections))

    def _job(self, run: Run, frames: frozenset[int], windows: tuple[range, ...]) -> CorrectionJob:
        body = self._bodies.of(run.body)
        config = replace(run.config, solver="lm", temporal=replace(run.config.temporal, stages=(5,)))

        def renewed() -> tuple[RerunFrames, int]:
            seen = self._project.last_edit
            start = self._fits.fit(self._fits.corrections_of(run.id))
            clip = self._clip(start.camera)
            return RerunFrames(clip=clip, body=body, config=config, start=start, windows=windows), seen

        where = in_words(sorted(frame for window in windows for frame in window), self._project.clip.first_frame)
        return CorrectionJob(origin=run.id, frames=frames, title=f"Follow edits: re-run {where}", renewed=renewed)

    def _clip(self, camera: Camera) -> Clip:
        return replace(self._project.clip, camera=camera)
