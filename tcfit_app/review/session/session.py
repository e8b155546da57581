"""An open project with everything that works on it, shared by all browsers."""

import logging
import time
from collections.abc import Callable, Hashable
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting_core.camera import Camera
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.errors import InputError
from fitting_core.io.cameras.reading import CameraFile, read_camera
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting.bodies import Bodies, record_of
from tcfit_app.fitting.edit_follower import EditFollower
from tcfit_app.fitting.fits import FitChoice, Fits, Shown
from tcfit_app.fitting.jobs import FitEverything, FitShape, Job, RerunFrames, RunJob, warm_up
from tcfit_app.fitting.reports import (
    DragEnded,
    DragMoved,
    ErrandEnded,
    JobEnded,
    JobReported,
    JobStarted,
    Notice,
    Report,
    RunningJob,
)
from tcfit_app.fitting.worker import LiveDrag, Worker
from tcfit_app.imports.given import NOTHING, KnownInputs, read_given
from tcfit_app.imports.results import ImportChoices, import_run
from tcfit_app.imports.uploads import upload
from tcfit_app.project.edits.edit_log import LogEntry
from tcfit_app.project.edits.kinds import Edit, MoveKeypoint, PlaceKey, SetDepth
from tcfit_app.project.edits.remarks import Remark
from tcfit_app.project.other_view import ProjectView
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Given, Run, RunKind
from tcfit_app.review.session.keypoint_source import Going, KeypointSource
from tcfit_app.review.session.tasks import Step, Tasks

RETRY = 5.0
"""Seconds between attempts to write what could not be written."""
_log = logging.getLogger(__name__)


class StoredFits:
    """Fits for the drawing thread, which must not wait for the disk: those not in memory are read in another thread.

    See `Fits`. All methods raise InputError for what cannot be read.

    Args:
        fits: Of the project.
        tasks: Reads them.
    """

    def __init__(self, fits: Fits, tasks: Tasks) -> None:
        self._fits, self._tasks = fits, tasks

    def here(self, run: Run) -> bool:
        """Whether a run's fit is in memory; if not, reading it has been started."""
        if self._fits.held(run):
            return True
        key: Hashable = ("stored fit", run.id, self._fits.version)
        if self._tasks.get(key, lambda: bool(self._fits.phases(run)), lane="disk"):
            self._tasks.drop(key)  # it may have to be read again
        if problem := self._tasks.problem(key):
            raise InputError(problem)
        return self._fits.held(run)

    def reading(self, run: Run) -> bool:
        """Whether a run's fit is still being read."""
        try:
            return not self.here(run)
        except InputError:
            return False

    def show(self, choice: FitChoice) -> Shown | None:
        """What a choice refers to now; None if there is nothing, or nothing yet."""
        run = self._fits.meant(choice)
        return self._fits.show(choice) if run is not None and self.here(run) else None

    def fit(self, run: Run) -> FitResult | None:
        """The result of a run; None while it is being read."""
        return self._fits.fit(run) if self.here(run) else None

    def phases(self, run: Run) -> tuple[int, ...]:
        """Which phases of a run can be shown; none while it is being read."""
        return self._fits.phases(run) if self.here(run) else ()


class Session:
    """What browsers do to a project. All methods are for the drawing thread only.

    Args:
        project: an open project; `close` does not close it.
        bodies: the source of body models.
    """

    def __init__(self, project: Project, bodies: Bodies) -> None:
        self.project, self.bodies = project, bodies
        self.fits = Fits(project)
        self.worker = Worker(self.fits)
        self.edit_follower = EditFollower(project, bodies, self.fits, self.worker)
        """Makes the fit follow drags and edits."""
        self.tasks = Tasks()
        """All other slow work."""
        self.stored = StoredFits(self.fits, self.tasks)
        """The fits, for drawing."""
        self.source = KeypointSource(project, self.tasks, self._take_keypoints)
        """Provides keypoints for a project without any."""
        self._as_found: int | None = None
        """The run being fitted while its keypoints are detected."""
        self.jobs: dict[int, RunningJob] = {}
        """By number, in the order in which they run."""
        self._unended: list[RunningJob] = []
        """Runs whose end could not be written yet."""
        self._next_try = 0.0
        self.tell: Callable[[Notice], None] = lambda notice: None

    def close(self) -> None:
        """End all work; what has finished is on disk."""
        self.tasks.close()
        self.take_news()
        self.worker.close()
        while not self.worker.reports.empty():  # jobs that ended before they were cancelled
            report = self.worker.reports.get()
            if not (isinstance(report, JobEnded) and report.how == "cancelled"):
                self._take_whatever_comes(report)
        for job in self.jobs.values():
            job.outcome, job.reason = "cancelled", "tcfit was closed"
            self._end_run(job)
        self._end_late(0.0)

    # --- keypoints ---

    def edit(self, edit: Edit, *, author: str, shown: Shown | None = None) -> LogEntry:
        """Make an edit, which is on disk when this returns; the fit on show follows it. Raises InputError if the edit
        is invalid, or the project cannot be written."""
        self.refuse_without_keypoints()
        entry = self.project.append(edit, author=author)
        if shown is not None:
            self.edit_follower.edited(entry, shown)
        return entry

    def undo(self, *, author: str, shown: Shown | None = None) -> LogEntry | None:
        """Undo the project's last edit or remark, by any author; returns it, if any. Raises as `edit`."""
        return self._went_back(self.project.undo(author=author), shown)

    def redo(self, *, author: str, shown: Shown | None = None) -> LogEntry | None:
        """Redo what was undone last; None if there is nothing. Raises as `edit`."""
        return self._went_back(self.project.redo(author=author), shown)

    def _went_back(self, entry: LogEntry | None, shown: Shown | None) -> LogEntry | None:
        if entry is not None and not isinstance(entry.action, Remark):
            self.edit_follower.went_back(entry.id, shown)
        return entry

    @property
    def views(self) -> dict[int, ProjectView]:
        """The clip's other views, by their ids."""
        return {view.id: view for view in self.project.views}

    # --- fits ---

    def fit_everything(
        self, config: FitConfig, *, kind: str, gender: str, camera: Camera | None = None, known: KnownInputs = NOTHING
    ) -> Run:
        """Submit a whole fit. Raises InputError if the body model is missing, or the project cannot be written.

        Args:
            config: All settings.
            kind: The body model.
            gender: Its gender.
            camera: None: the clip's. Runs started from this one keep it.
            known: A start and a shape, for this body and camera.
        """
        self.refuse_without_keypoints()
        body = self.bodies.find(kind=kind, gender=gender)
        job = FitEverything(
            clip=self.project.clip_by(camera or self.project.footage.camera),
            body=body,
            config=config,
            begun_with=known.start,
            shape=known.shape,
        )
        return self._submit(job, kind="fit", start=None, given=known.given)

    def interrupted(self, run: Run) -> Callable[[], tuple[FitResult, KnownInputs]]:
        """A function that reads what `resume` needs, for another thread. Raises InputError if the run's body model is
        missing; it raises as `read_given`, and if the frames that phase 1 had fitted cannot be read."""
        self.refuse_without_keypoints()
        body, clip, only = self.bodies.of(run.body), self.project.footage, Given(shape=run.given.shape)
        return lambda: (
            self.project.runs.load_partial(run.id),
            read_given(only, self.project, clip, body, self.bodies),
        )

    def resume(self, run: Run, frames: FitResult, known: KnownInputs) -> None:
        """Continue a run that ended in phase 1, with the current keypoints. Raises InputError as `fit_everything`.

        Args:
            run: Which.
            frames: Those that phase 1 had fitted; those edited since are fitted again.
            known: Its shape.
        """
        self.project.refuse_read_only()
        observed = frames.observed.copy()
        observed[list(self.project.frames_edited_since(run.edits_seen))] = False
        job = FitEverything(
            clip=self.project.clip_by(frames.camera),
            body=self.bodies.of(run.body),
            config=run.config,
            begun_with=frames.start,
            shape=known.shape,
            known=(frames.last.params, np.asarray(observed.any(1))),
        )
        self.project.runs.resume(run.id, edits_seen=self.project.last_edit)
        self.fits.resume(run.id, replace(frames, observed=observed))
        self._enqueue(RunJob(run_id=run.id, job=job), run.id)

    def preset(self, name: str = DEFAULT_PRESET) -> FitConfig:
        """A preset, with the height of the project's person."""
        return replace(PRESETS[name], height=self.project.height)

    def warm_up(self) -> None:
        """Load what a fit needs, if none can have begun. For any thread; raises InputError as `find_and_fit` does."""
        if not self.project.has_detections:
            warm_up(self.bodies.find(), self.preset())

    def find_and_fit(self, detector: str, config: FitConfig | None = None, *, person: int | None = None) -> None:
        """Start detecting keypoints in the video, and fit them as they are found. Raises InputError as `fit_everything`
        and `KeypointSource.begin` do; neither is running then.

        Args:
            detector: As in `KeypointSource.detect`.
            config: All settings; None: the default preset's.
            person: As in `KeypointSource.detect`.
        """
        body = self.bodies.find()
        self.source.detect(detector, person=person)
        config, fresh = config or self.preset(), self.source.feed()
        job = FitEverything(clip=self.project.clip, body=body, config=config, fresh=fresh)
        try:
            self._as_found = self._submit(job, kind="fit", start=None).id
        except InputError:
            self.source.cancel()
            raise

    @property
    def can_choose_person(self) -> bool:
        """Whether another of the detected people can be chosen: without keypoints, or while nothing depends on them."""
        return self.source.can_choose and not (self.project.has_detections and self.fits.runs)

    def reading(
        self, given: Given, *, kind: str, gender: str, camera: Camera | None = None
    ) -> Callable[[], KnownInputs]:
        """A function that reads a start and a shape for a whole fit with that body and camera, for another thread.
        Raises InputError if the body model is missing, or nothing can be fitted. It raises as `read_given`."""
        self.refuse_without_keypoints()
        body, clip = (
            self.bodies.find(kind=kind, gender=gender),
            self.project.clip_by(camera or self.project.footage.camera),
        )
        return lambda: read_given(given, self.project, clip, body, self.bodies)

    def reading_shape(self, given: Given, shown: Shown) -> Callable[[], KnownInputs]:
        """The same for a shape with which a run is refitted."""
        body, clip, only = self.bodies.of(shown.run.body), self.project.clip_by(shown.camera), Given(shape=given.shape)
        return lambda: read_given(only, self.project, clip, body, self.bodies)

    def set_camera(self, file: CameraFile, *, sent_as: str = "") -> Camera:
        """Use a calibration as the project's camera. Slow: for `tasks`. Raises InputError if it cannot be read, does
        not fit this clip, or the project cannot be written.

        Args:
            file: On this computer.
            sent_as: Its name in the browser, if it was uploaded.
        """
        self.project.refuse_read_only()
        with self.source.camera_changes():
            camera = read_camera(file, self.project.footage.camera.size)
            notes = camera.notes
            if sent_as:
                camera = replace(camera, source=camera.source.replace(file.path.name, sent_as))
                notes = tuple(note.replace(file.path.name, sent_as) for note in notes)
            self.project.set_camera(camera, notes)
            return camera

    def import_run(self, path: Path, choices: ImportChoices, report: Step, *, sent_as: str = "") -> Run:
        """Store another program's result as a run to compare. Slow: for `tasks`. Raises InputError if it cannot be read
        or does not match the clip, its body model is missing, or the project cannot be written; nothing is stored then.

        Args:
            path: On this computer.
            choices: What its files do not say.
            report: Called before anything is written.
            sent_as: Its name in the browser, if it was uploaded.
        """
        self.project.refuse_read_only()
        return import_run(self.project, self.bodies, path, choices, source=sent_as, goes_on=lambda: report("", None))

    def import_upload(self, name: str, content: bytes, choices: ImportChoices, report: Step) -> Run:
        """The same for an uploaded file. Raises InputError as `import_run`."""
        with upload(name, content) as path:
            return self.import_run(path, choices, report, sent_as=name)

    def rerun_frames(self, shown: Shown, config: FitConfig, windows: tuple[range, ...]) -> Run:
        """Submit phase 3 of some frames again, as a new run; if this run is unfinished, once it has finished. Raises
        InputError as `fit_everything` does."""
        start = self._start_of(shown)
        if start.last.phase < 2 and shown.run.state != "running":
            raise InputError(
                f"{shown.run.name} ended after its first pass, in which each frame has its own shape. Fit "
                "the shape again for all frames, then fit frames of that fit."
            )
        body = self.bodies.of(shown.run.body)
        job = RerunFrames(
            clip=self.project.clip_by(start.camera), body=body, config=config, start=start, windows=windows
        )
        return self._submit(job, kind="frames", start=shown, windows=windows)

    def rerun_shape(self, shown: Shown, config: FitConfig, *, known: KnownInputs = NOTHING) -> Run:
        """Submit phases 2 and 3 again, as a new run, with any known shape. Raises InputError as `fit_everything`."""
        start = self._start_of(shown)
        body = self.bodies.of(shown.run.body)
        job = FitShape(
            clip=self.project.clip_by(start.camera), body=body, config=config, start=start, shape=known.shape
        )
        return self._submit(job, kind="shape", start=shown, given=known.given)

    def _start_of(self, shown: Shown) -> FitResult:
        if shown.run.kind == "imported":
            raise InputError(
                f"{shown.run.name} was imported: its frames and shape cannot be refitted. Choose it in "
                "Start from in the panel Fit, or show another fit."
            )
        return self.fits.fit(shown.run)

    def _submit(
        self,
        job: FitEverything | RerunFrames | FitShape,
        *,
        kind: RunKind,
        start: Shown | None,
        windows: tuple[range, ...] = (),
        given: Given = NOTHING.given,
    ) -> Run:
        self.project.refuse_read_only()
        seen, parent = self.project.last_edit, None if given.start is None else given.start.run
        if start is not None:  # same evidence, but a re-estimated shape is given again
            before, parent = start.run.given, start.run.id
            given = Given(start=before.start, shape=before.shape if windows else given.shape)
        if start is not None and windows:
            seen = self.edit_follower.edits_seen(start.run, windows, seen)
        run = self.project.runs.start(
            job.config,
            body=record_of(job.body),
            edits_seen=seen,
            kind=kind,
            parent=parent,
            given=given,
            frames=range(min(w.start for w in windows), max(w.stop for w in windows)) if windows else None,
        )
        self.fits.begin(run, start)
        waits_for = start.run.id if start and windows and start.run.state == "running" else None
        latest = None if waits_for is None else lambda: self._finished(waits_for)
        self._enqueue(RunJob(run_id=run.id, job=job, start=latest), run.id)
        return run

    def _finished(self, number: int) -> FitResult:
        run = self.project.runs.get(number)
        if run.state != "finished":
            raise InputError(f"{run.name}, whose frames were to be refitted, did not finish: choose another fit.")
        return self.fits.fit(run)

    def _enqueue(self, job: Job, run: int | None, *, follows: int | None = None) -> None:
        number = self.worker.submit(job)
        self.jobs[number] = RunningJob(number=number, run=run, follows=follows, title=job.title, phases=job.phases)

    def cancel(self, run: int | None = None) -> None:
        """Cancel a run's job, or all; what has finished stays."""
        for job in list(self.jobs.values()):
            if run in (None, job.run):
                self.worker.cancel(job.number)

    def delete(self, run: int) -> None:
        """Remove a run from the list; it can be restored. Raises InputError while it is running."""
        self.project.runs.delete(run)
        self.fits.forget(run)

    def edits_since(self, run: Run) -> int:
        """How many edits were made or undone since a run."""
        return self.project.standing.differing(run.edits_seen)

    def as_corrected(self, run: Run) -> Run:
        """The run that shows a run's current corrections; a run of corrections shows its own, and the run that they
        correct once none remain."""
        base = self.fits.run(run.parent) if run.kind == "corrections" and run.parent is not None else run
        if base is None:
            return run
        if not self.edits_since(base):
            return base
        return run if run.kind == "corrections" else self.edit_follower.of(base.id)

    # --- live correction ---

    def release(
        self, drag: LiveDrag | None, edit: MoveKeypoint | PlaceKey | SetDepth, *, author: str, shown: Shown | None
    ) -> None:
        """End a drag: store the edit first, then let the fit converge. Raises InputError as `edit`."""
        followed = drag is not None and not drag.failed
        try:
            entry = self.edit(edit, author=author, shown=None if followed else shown)
        except InputError:
            if drag:
                drag.abandon()
            raise
        if drag:
            drag.release(entry.id)
        others = drag is not None and set(edit.frames) != {drag.correction.frame}
        if followed and shown is not None and others:
            self.edit_follower.follow(shown.run, {entry.id: True})

    # --- news from the worker ---

    def take_news(self) -> None:
        """Process what the worker has reported since the last call."""
        while not self.worker.reports.empty():
            self._take_whatever_comes(self.worker.reports.get())
        self.tasks.take()
        self._end_late(time.monotonic())
        correction = self.edit_follower.due(self.tell)
        if correction is not None:
            self._enqueue(correction, None, follows=correction.origin)

    def _take_keypoints(self, ended: Going) -> None:
        if ended.state != "finished" and self._as_found is not None:
            self.cancel(self._as_found)
        if ended.state == "failed":
            self.tell(Notice(title=f"{ended.title} failed", text=ended.reason, kind="error"))
        elif ended.state == "finished" and (found := ended.result()) is not None:
            self.tell(Notice(title="Keypoints ready", text="\n".join(found.notes), kind="done"))

    def _take_whatever_comes(self, report: Report) -> None:
        """Process a report; a failure must not take later ones with it, or jobs would seem to run for ever."""
        try:
            self._take(report)
        except Exception as error:
            _log.exception("A report of the worker could not be processed: %s", type(report).__name__)
            text = f"{type(error).__name__}: {error}. Nothing is lost; tcfit's terminal has the details."
            self.tell(Notice(title="Something went wrong in tcfit", text=text, kind="error"))

    def _take(self, report: Report) -> None:
        if isinstance(report, DragMoved):
            return self.edit_follower.take_move(report)
        if isinstance(report, DragEnded):
            self.edit_follower.take_end(report)
            if report.how == "failed":
                self.tell(Notice(title="The fit could not follow", text=report.reason, kind="error"))
            return
        if isinstance(report, ErrandEnded):
            self.edit_follower.take_errand(report)
            if report.reason:
                self.tell(
                    Notice(title="The edit's effect on the fit could not be undone", text=report.reason, kind="error")
                )
            return
        job = self.jobs.get(report.job)
        if job is None:
            return
        if isinstance(report, JobStarted):
            job.started = True
        elif isinstance(report, JobReported):
            job.take(report.event, report.worked)
        else:
            self._take_end(job, report)

    def _take_end(self, job: RunningJob, report: JobEnded) -> None:
        del self.jobs[job.number]
        job.outcome, job.reason = report.how, report.reason
        as_found = job.run is not None and job.run == self._as_found
        if as_found:
            self._as_found = None
        if report.how != "finished":
            self._end_run(job)
            if as_found and self._drop_empty(job):
                return
        elif job.run is not None:
            self.tell(Notice(title=f"{job.title}: done", text="", kind="done"))
        if report.how == "failed":
            how = "not saved yet" if job.run in self.fits.unwritten else "failed"
            self.tell(Notice(title=f"{job.title}: {how}", text=report.reason, kind="error"))
        if job.follows is not None:
            self.edit_follower.ended(job.follows, cancelled=report.how == "cancelled")

    def _drop_empty(self, job: RunningJob) -> bool:
        """Remove a run whose keypoints were not found, which has already been reported; returns whether it was one."""
        going = self.source.going
        if job.run is None or going is None or going.state == "finished" or self.project.runs.get(job.run).stored:
            return False
        self.delete(job.run)
        return True

    def _end_run(self, job: RunningJob) -> None:
        """Record that a run was cancelled or failed; what cannot be written now is retried."""
        if job.run is not None and (problem := self._ended(job)):
            self._unended.append(job)
            self.tell(Notice(title="The project cannot be written", text=problem, kind="error"))

    def _ended(self, job: RunningJob) -> str:
        """Write the end of a job's run; returns why that failed, or an empty text."""
        assert job.run is not None and job.outcome in ("cancelled", "failed")
        try:
            self.fits.end(job.run, job.outcome, job.reason)
        except Exception as error:  # a full disk, or anything else: no run may seem to run for ever
            _log.warning("Run %d could not be ended", job.run, exc_info=not isinstance(error, InputError))
            return str(error) or type(error).__name__
        return ""

    def _end_late(self, now: float) -> None:
        """Write what could not be written before, if possible now."""
        if not (self._unended or self.fits.unwritten) or 0 < now < self._next_try:
            return
        self._next_try = now + RETRY
        while self._unended:
            if self._ended(self._unended[0]):
                return
            self._unended.pop(0)
        for run in self.fits.write_late():
            self.tell(Notice(title=f"{run.name} was saved after all", text="", kind="done"))

    def refuse_without_keypoints(self) -> None:
        """Raises InputError if there is nothing yet to correct or fit."""
        if not self.project.has_detections:
            raise InputError("This project has no keypoints yet: detect them first, in the panel Start.")
