"""An open project with everything that works on it: what all browsers share."""

import logging
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Literal

from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.errors import InputError
from fitting_core.fit.events import FramesFitted, PhaseStarted
from fitting_core.fit.result import FitResult
from fitting_core.io.cameras.reading import CameraFile, read_camera
from tcfit_app.fitting.bodies import Bodies, record_of
from tcfit_app.fitting.edit_follower import EditFollower
from tcfit_app.fitting.fits import Fits, Shown
from tcfit_app.fitting.job_progress import RunningJob
from tcfit_app.fitting.jobs import FitEverything, FitShape, Job, RerunFrames, RunJob
from tcfit_app.fitting.reports import DragEnded, ErrandEnded, JobEnded, JobReported, JobStarted, Notice, Report
from tcfit_app.fitting.worker import Drag, Worker
from tcfit_app.imports.elan import ElanNotes, notes_of
from tcfit_app.imports.given import NOTHING, Known, read_given
from tcfit_app.imports.results import ImportChoices, import_run, kept_as, upload
from tcfit_app.project.edits.edit_log import LogEntry, Remark, WriteNote, WriteNotes
from tcfit_app.project.edits.kinds import Edit, MoveKeypoint, PlaceKey, SetDepth
from tcfit_app.project.project import Project
from tcfit_app.project.storage.names import name_of_file
from tcfit_app.project.storage.run_record import Given, Run, RunKind
from tcfit_app.review.session.keypoint_source import Going, KeypointSource
from tcfit_app.review.session.own_rig import OwnRig
from tcfit_app.review.session.stored_fits import StoredFits
from tcfit_app.review.session.tasks import Step, Tasks

_RETRY = 5.0
"""Seconds after which it is tried again to write what could not be written."""
_log = logging.getLogger(__name__)


class Session:
    """What browsers do to a project. All methods are for the one thread that draws.

    Args:
        project: open; `close` does not close it.
        bodies: where body models come from.
    """

    def __init__(self, project: Project, bodies: Bodies) -> None:
        self.project, self.bodies = project, bodies
        self.fits = Fits(project)
        self.worker = Worker(self.fits)
        self.edit_follower = EditFollower(project, bodies, self.fits, self.worker)
        """Lets the fit follow drags and edits."""
        self.tasks = Tasks()
        """Whatever else is slow."""
        self.stored = StoredFits(self.fits, self.tasks)
        """The fits, for whoever draws."""
        self.source = KeypointSource(project, self.tasks, self._take_keypoints)
        """Gets keypoints for a project that has none."""
        self.rig = OwnRig(project.folder)
        """The user's own, which exports can move."""
        self._as_found: int | None = None
        """The run that is fitted while its keypoints are found."""
        self.jobs: dict[int, RunningJob] = {}
        """By number, in the order in which they run."""
        self._unended: list[RunningJob] = []
        """Runs whose end could not be written yet."""
        self._next_try = 0.0
        self.ended: RunningJob | None = None
        """The run's job that ended last."""
        self.changes = 0
        """Another number whenever anything about jobs is another."""
        self.tell: Callable[[Notice], None] = lambda notice: None

    def close(self) -> None:
        """End all work; what had finished is on the disk."""
        self.tasks.close()
        self.take_news()
        self.worker.close()
        for report in self.worker.reports.take().reports:  # what ended by itself before it was cancelled
            if not (isinstance(report, JobEnded) and report.how == "cancelled"):
                self._take_whatever_comes(report)
        for job in self.jobs.values():
            job.outcome, job.reason = "cancelled", "tcfit was closed"
            self._end_run(job)
        self._end_late(0.0)

    @property
    def edits(self) -> int:
        """Another number whenever the keypoints are others."""
        return self.project.keypoints_version

    @property
    def marked(self) -> int:
        """Another number whenever a frame's mark or note is another."""
        return self.project.marks_version

    @property
    def referenced(self) -> int:
        """Another number whenever fits are compared with something else."""
        return self.project.reference_version

    # --- keypoints ---

    def edit(self, edit: Edit, *, author: str, shown: Shown | None = None) -> LogEntry:
        """Make an edit, which is on the disk when this returns; the fit on show follows it.

        Raises:
            InputError: It makes no sense, or the project cannot be written.
        """
        self.refuse_without_keypoints()
        entry = self.project.append(edit, author=author)
        if shown is not None:
            self.edit_follower.edited(entry, shown)
        return entry

    def undo(self, *, author: str, shown: Shown | None = None) -> LogEntry | None:
        """Take back the project's last edit or remark, whoever made it; None if there is none. Raises as `edit`."""
        return self._went_back(self.project.undo(author=author), shown)

    def redo(self, *, author: str, shown: Shown | None = None) -> LogEntry | None:
        """Bring back what was undone last; None if there is nothing. Raises as `edit`."""
        return self._went_back(self.project.redo(author=author), shown)

    def _went_back(self, entry: LogEntry | None, shown: Shown | None) -> LogEntry | None:
        if entry is not None and not isinstance(entry.action, Remark):
            self.edit_follower.went_back(entry.id, shown)
        return entry

    def mark(self, frames: Iterable[int], state: Literal["checked", "flag"] | None, *, author: str) -> None:
        """Say that frames look fine, need attention, or neither. Raises InputError if that cannot be stored."""
        self.project.marks.set(frames, state, author=author)

    def write_note(self, frames: Iterable[int], text: str, *, author: str, replaces: int | None = None) -> None:
        """Keep a note on frames that follow each other.

        Args:
            frames: which.
            text: what it says; empty takes the note away that it replaces.
            author: who says it.
            replaces: the `Note.id` of the one whose place it takes.

        Raises:
            InputError: It makes no sense, or the project cannot be written.
        """
        note = WriteNote(frames=tuple(frames), text=text.strip(), replaces=replaces)
        self.project.append(note, author=author)

    def read_elan(self, name: str, content: bytes, tiers: tuple[str, ...]) -> tuple[WriteNotes | None, ElanNotes]:
        """The notes in an .eaf file that a browser has sent, for `keep_notes`. Slow: for `tasks`.

        Raises:
            InputError: As `import_notes`; nothing is kept yet.
        """
        with kept_as("upload.eaf", content, name_of_file(name)) as path:
            return notes_of(path, self.project, tiers)

    def keep_notes(self, notes: WriteNotes, *, author: str) -> None:
        """Keep several notes at once. Raises InputError as `write_note`."""
        self.project.append(notes, author=author)

    # --- fits ---

    def clip_of(self, camera: Camera) -> Clip:
        """The clip with its keypoints as they stand, and the camera of a run."""
        return replace(self.project.clip, camera=camera)

    def fit_everything(
        self, config: FitConfig, *, kind: str, gender: str, camera: Camera | None = None, known: Known = NOTHING
    ) -> Run:
        """Submit a whole fit.

        Args:
            config: All settings.
            kind: Of the body model.
            gender: Of the body model.
            camera: None: the clip's. Runs that start from this one keep it.
            known: A start and a shape, of this body and this camera.

        Raises:
            InputError: The body is not there, or the project cannot be written.
        """
        self.refuse_without_keypoints()
        body = self.bodies.find(kind=kind, gender=gender)
        job = FitEverything(
            clip=self.clip_of(camera or self.project.footage.camera),
            body=body,
            config=config,
            begun_with=known.start,
            shape=known.shape,
        )
        return self._submit(job, kind="fit", start=None, given=known.given)

    def find_and_fit(
        self,
        detector: str,
        config: FitConfig = PRESETS[DEFAULT_PRESET],
        *,
        person: int | None = None,
        kind: str = "smplx",
        gender: str = "neutral",
    ) -> None:
        """Begin to find keypoints in the video, and to fit them as they are found.

        Args:
            detector: As of `KeypointSource.detect`.
            config: All settings.
            person: As of `KeypointSource.detect`.
            kind: Of the body model.
            gender: Of the body model.

        Raises:
            InputError: As `fit_everything` and `KeypointSource.begin`; nothing has begun then.
        """
        body = self.bodies.find(kind=kind, gender=gender)
        self.source.detect(detector, person=person)
        job = FitEverything(clip=self.project.clip, body=body, config=config, fresh=self.source.feed())
        self._as_found = self._submit(job, kind="fit", start=None).id

    @property
    def can_choose_person(self) -> bool:
        """Whether another one of the people who were found can be taken: there are no keypoints, or nothing stands on
        them yet."""
        return self.source.can_choose and not (self.project.has_detections and self.fits.runs)

    def reading(self, given: Given, *, kind: str, gender: str, camera: Camera | None = None) -> Callable[[], Known]:
        """What reads a start and a shape for a whole fit of that body and camera, in a thread of its own.

        Raises:
            InputError: The body is not there, or nothing can be fitted. The function as `read_given`.
        """
        self.refuse_without_keypoints()
        body, clip = self.bodies.find(kind=kind, gender=gender), self.clip_of(camera or self.project.footage.camera)
        return lambda: read_given(given, self.project, clip, body, self.bodies)

    def reading_shape(self, given: Given, shown: Shown) -> Callable[[], Known]:
        """The same for a shape with which a run is fitted again."""
        body, clip, only = self.bodies.of(shown.run.body), self.clip_of(shown.camera), Given(shape=given.shape)
        return lambda: read_given(only, self.project, clip, body, self.bodies)

    def set_camera(self, file: CameraFile, *, sent_as: str = "") -> Camera:
        """Take a calibration as the project's camera. Slow: for `tasks`.

        Args:
            file: On this computer.
            sent_as: What a browser calls it, if it has sent it.

        Raises:
            InputError: It cannot be read, is of no use for this clip, or the project cannot be written.
        """
        self.project.refuse_read_only()
        with self.source.camera_changes():
            camera, notes = read_camera(file, self.project.footage.camera.size)
            if sent_as:
                camera = replace(camera, source=camera.source.replace(file.path.name, sent_as))
                notes = tuple(note.replace(file.path.name, sent_as) for note in notes)
            self.project.set_camera(camera, notes)
            return camera

    def import_run(self, path: Path, choices: ImportChoices, report: Step, *, sent_as: str = "") -> Run:
        """Keep another program's result as a run to compare with. Slow: for `tasks`.

        Args:
            path: On this computer.
            choices: What its files do not tell.
            report: Called before anything is written.
            sent_as: What a browser calls the file, if it has sent it.

        Raises:
            InputError: It cannot be read or does not fit the clip, its body is not there, or the project cannot be
                written; nothing is kept then.
        """
        self.project.refuse_read_only()
        name = name_of_file(sent_as) if sent_as else ""
        run = import_run(
            self.project, self.bodies, path, choices, name=name, source=sent_as, goes_on=lambda: report("", None)
        )
        self.fits.changed()
        return run

    def import_upload(self, name: str, content: bytes, choices: ImportChoices, report: Step) -> Run:
        """The same with a file that a browser has sent. Raises InputError as `import_run`."""
        with upload(name, content) as path:
            return self.import_run(path, choices, report, sent_as=name)

    def rerun_frames(self, shown: Shown, config: FitConfig, windows: tuple[range, ...]) -> Run:
        """Submit phase 3 of some frames again, as a new run; of one that is not finished, once it is.

        Raises:
            InputError: As `fit_everything`.
        """
        start = self._start_of(shown)
        if start.last.phase < 2 and shown.run.state != "running":
            raise InputError(
                f"{shown.run.name} ended after its first phase, in which each frame has a shape of its own. Find one "
                "that all share with Re-run shape, and re-run frames of that."
            )
        body = self.bodies.of(shown.run.body)
        job = RerunFrames(clip=self.clip_of(start.camera), body=body, config=config, start=start, windows=windows)
        return self._submit(job, kind="frames", start=shown, windows=windows)

    def rerun_shape(self, shown: Shown, config: FitConfig, *, known: Known = NOTHING) -> Run:
        """Submit phases 2 and 3 again, as a new run, by a known shape if there is one. Raises InputError as
        `fit_everything`."""
        start = self._start_of(shown)
        body = self.bodies.of(shown.run.body)
        job = FitShape(
            clip=self.clip_of(start.camera),
            body=body,
            config=config,
            start=start,
            shape=known.shape,
        )
        return self._submit(job, kind="shape", start=shown, given=known.given)

    def _start_of(self, shown: Shown) -> FitResult:
        if shown.run.kind == "imported":
            raise InputError(
                f"{shown.run.name} was imported: its frames and its shape cannot be fitted again. Refine it in the "
                "panel Runs, or show another run as B."
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
        if start is not None:  # It has the same evidence; a shape that is found again is told anew.
            before, parent = start.run.given, start.run.id
            given = Given(start=before.start, shape=before.shape if windows else given.shape)
        if start is not None and windows:
            seen = self.fits.corrections.edits_seen(start.run, windows, seen)
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
            raise InputError(f"{run.name}, in which frames were to be fitted again, did not finish: take another run.")
        return self.fits.fit(run)

    def _enqueue(self, job: Job, run: int | None, *, follows: int | None = None) -> None:
        number = self.worker.submit(job)
        self.jobs[number] = RunningJob(number=number, run=run, follows=follows, title=job.title, phases=job.phases)
        self.changes += 1

    def cancel(self, run: int | None = None) -> None:
        """Cancel a run's job, or all; what has finished stays."""
        for job in list(self.jobs.values()):
            if run in (None, job.run):
                self.worker.cancel(job.number)

    def rename(self, run: int, name: str) -> None:
        """Give a run another name. Raises InputError if it cannot have it."""
        self.project.runs.rename(run, name)
        self.fits.changed()

    def delete(self, run: int) -> None:
        """Take a run out of the list; it can be restored. Raises InputError while it is running."""
        self.project.runs.delete(run)
        self.fits.forget(run)

    def restore(self, run: int) -> None:
        """Bring a deleted run back. Raises InputError if it is gone for good."""
        self.project.runs.undelete(run)
        self.fits.changed()

    def purge(self) -> int:
        """Remove deleted runs for good; how many. Raises InputError if the project cannot be written."""
        gone = self.project.runs.purge()
        self.fits.changed()
        return len(gone)

    def edits_since(self, run: Run) -> int:
        """How many edits were made or taken back since a run."""
        return self.project.edits_since(run.edits_seen)

    def as_corrected(self, run: Run) -> Run:
        """What shows a run, or one of corrections, as it is corrected now: the run itself once no correction stands."""
        base = run if run.kind != "corrections" or run.parent is None else self.fits.run(run.parent)
        if base is None:
            return run
        return self.fits.corrections.of(base.id) if self.edits_since(base) else base

    def frames_edited_since(self, run: Run) -> frozenset[int]:
        """Their frames."""
        return self.project.frames_edited_since(run.edits_seen)

    # --- live correction ---

    def release(
        self, drag: Drag | None, edit: MoveKeypoint | PlaceKey | SetDepth, *, author: str, shown: Shown | None
    ) -> None:
        """End a drag: the edit is on the disk first, then the fit converges. Raises InputError as `edit`."""
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
        if followed and shown is not None and others and self.edit_follower.after_edits:
            self.edit_follower.follow(shown.run, {entry.id: True})

    # --- news from the worker ---

    def take_news(self) -> None:
        """Take up what the worker has done since the last call."""
        news = self.worker.reports.take()
        for report in news.reports:
            self._take_whatever_comes(report)
        if news.progress is not None and (job := self.jobs.get(news.progress.job)):
            job.take(news.progress)
            self.changes += 1
        for moved in news.moved:
            self.edit_follower.take_move(moved)
        self.tasks.take()
        self._end_late(time.monotonic())
        self.edit_follower.take_up()
        correction = self.edit_follower.due(self.tell)
        if correction is not None:
            self._enqueue(correction, None, follows=correction.origin)

    def _take_keypoints(self, ended: Going) -> None:
        """Take up what has ended of getting keypoints."""
        self.changes += 1
        if ended.state != "finished" and self._as_found is not None:
            self.cancel(self._as_found)
        if ended.state == "failed":
            self.tell(Notice(title=f"{ended.title} failed", text=ended.reason, kind="error"))
        elif ended.state == "finished" and (found := ended.result()) is not None:
            self.tell(Notice(title="This project has its keypoints", text="\n".join(found.notes), kind="done"))

    def _take_whatever_comes(self, report: Report) -> None:
        """A report that cannot be taken up must not take those after it along: jobs would seem to run for ever."""
        try:
            self._take(report)
        except Exception as error:
            _log.exception("News of the worker could not be taken up: %s", type(report).__name__)
            text = f"{type(error).__name__}: {error}. Nothing is lost; tcfit's terminal has the details."
            self.tell(Notice(title="Something went wrong in tcfit", text=text, kind="error"))

    def _take(self, report: Report) -> None:
        self.changes += 1
        if isinstance(report, DragEnded):
            self.edit_follower.take_end(report)
            if report.how == "failed":
                self.tell(Notice(title="The fit could not follow", text=report.reason, kind="error"))
            return
        if isinstance(report, ErrandEnded):
            self.edit_follower.take_errand(report)
            if report.reason:
                self.tell(Notice(title="The fit could not be taken back", text=report.reason, kind="error"))
            return
        job = self.jobs.get(report.job)
        if job is None:
            return
        if isinstance(report, JobStarted):
            job.started = True
        elif isinstance(report, JobReported):
            if isinstance(report.event, PhaseStarted):
                job.phase = report.event.phase
                job.windows.clear()
            elif isinstance(report.event, FramesFitted):
                job.windows.append(report.event.frames)
        else:
            self._take_end(job, report)

    def _take_end(self, job: RunningJob, report: JobEnded) -> None:
        del self.jobs[job.number]
        job.outcome, job.reason = report.how, report.reason
        self.ended = self.ended if job.run is None else job
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
            self.tell(Notice(title=f"{job.title} failed", text=report.reason, kind="error"))
        if job.follows is not None:
            self.edit_follower.ended(job.follows, cancelled=report.how == "cancelled")

    def _drop_empty(self, job: RunningJob) -> bool:
        """Take a run away whose keypoints were not found, which is told already. Whether it was so."""
        going = self.source.going
        if job.run is None or going is None or going.state == "finished" or self.project.runs.get(job.run).stored:
            return False
        self.delete(job.run)
        return True

    def _end_run(self, job: RunningJob) -> None:
        """Keep that a run was cancelled or has failed; what cannot be written now is tried again."""
        if job.run is not None and (problem := self._ended(job)):
            self._unended.append(job)
            self.tell(Notice(title="The project cannot be written", text=problem, kind="error"))

    def _ended(self, job: RunningJob) -> str:
        """Write the end of a job's run; why that is impossible, empty if it is done."""
        assert job.run is not None and job.outcome in ("cancelled", "failed")
        try:
            self.fits.end(job.run, job.outcome, job.reason)
        except Exception as error:  # a full disk, or whatever it was: no run may seem to go on for ever
            _log.warning("Run %d could not be ended", job.run, exc_info=not isinstance(error, InputError))
            return str(error) or type(error).__name__
        return ""

    def _end_late(self, now: float) -> None:
        """Write what could not be written, if that is possible by now."""
        if not (self._unended or self.fits.unwritten) or 0 < now < self._next_try:
            return
        self._next_try = now + _RETRY
        while self._unended:
            if self._ended(self._unended[0]):
                return
            self._unended.pop(0)
        for run in self.fits.write_late():
            if self.ended is not None and self.ended.run == run.id:
                self.ended.outcome, self.ended.reason = "finished", ""
            self.changes += 1
            self.tell(Notice(title=f"{run.name} is written after all", text="", kind="done"))

    def refuse_without_keypoints(self) -> None:
        """Raises InputError where there is nothing yet to correct or fit."""
        if not self.project.has_detections:
            raise InputError("This project has no keypoints yet: have them found first, in the panel Start.")
