"""Keypoints for a project created without any: one job at a time, for all browsers."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.lens import straightened_keypoints
from tcfit_app.fitting.jobs import Fresh
from tcfit_app.imports.found_people import FoundPeople
from tcfit_app.imports.keypoint_jobs import Detect, FoundKeypoints, KeypointJob
from tcfit_app.project.edits.remarks import Remark
from tcfit_app.project.project import Project
from tcfit_app.review.session.tasks import Step, Task, Tasks

Going = Task[FoundKeypoints | None]
"""A running or finished job."""


class KeypointSource:
    """Provides a project's keypoints. For the drawing thread only.

    Args:
        project: An open project.
        tasks: Runs the jobs.
        ended: Called when a job has ended; its keypoints are in the project by then.
    """

    def __init__(self, project: Project, tasks: Tasks, ended: Callable[[Going], None]) -> None:
        self._project, self._tasks, self._ended = project, tasks, ended
        self.going: Going | None = None
        """The job started last."""
        self.people: FoundPeople | None = None
        """The people found by the last detection; None without one."""
        self._detector = ""
        self._before: Clip | None = None
        """The clip before that detection."""
        self._beginning = threading.Lock()
        self._cameras = 0
        """Number of calibrations being read that may replace the project's camera."""
        self._camera: Camera | None = None
        """The clip's camera after that detection."""

    def detect(self, detector: str, *, person: int | None = None) -> None:
        """Start or resume detecting keypoints. Raises InputError as `begin`.

        Args:
            detector: A name in `DETECTORS`, or the path of a model.
            person: As in `read_clip`, until the user clicks on someone else.
        """
        people, before = FoundPeople(), self._project.clip
        self.begin(Detect(detector=detector, person=person, people=people))
        self.people, self._detector, self._before = people, detector, before

    @property
    def can_choose(self) -> bool:
        """Whether another of the detected people can be chosen, unless fits forbid it."""
        project, people = self._project, self.people
        if people is None or project.read_only or people.count < 2:
            return False
        if not project.has_detections:
            return True
        edited = any(not isinstance(entry.action, Remark) for entry in project.log)
        return not (edited or self.busy) and project.footage.camera == self._camera

    def choose(self, frame: int, place: int) -> None:
        """Choose one of the detected people; keypoints already in the project are replaced. Raises InputError if the
        project has edits or runs.

        Args:
            frame: From the clip's first frame.
            place: Index in the frame's list of people.
        """
        people, before = self.people, self._before
        if people is None or before is None or not self.can_choose:
            return
        people.choose(frame, place)
        if self._project.has_detections:
            self._begin(Detect(detector=self._detector, people=people), before)

    def feed(self) -> Callable[[], Fresh]:
        """What the last detection has found since the previous call; see `FitEverything.fresh`."""
        going, people = self.going, self.people
        assert going is not None and people is not None
        taken: set[int] = set()
        meant = people.seen

        def fresh() -> Fresh:
            nonlocal meant
            if going.state in ("failed", "cancelled"):
                raise InputError(f"{going.title}: {going.reason or 'cancelled'}.")
            if going.state == "finished":
                return self._project.clip
            if people.seen != meant:
                meant = people.seen
                taken.clear()
            for frames in people.done:
                if frames.start not in taken:
                    taken.add(frames.start)
                    straight, _ = straightened_keypoints(people.keypoints(frames), self._project.footage.camera.lens)
                    return frames, straight
            return None

        return fresh

    def cancel(self) -> None:
        """Stop the running job; a detection resumes from its results when restarted."""
        if self.going is not None:
            self.going.cancel()

    @property
    def busy(self) -> bool:
        """Whether a job is running."""
        return self.going is not None and self.going.state == "running"

    @contextmanager
    def camera_changes(self) -> Iterator[None]:
        """Blocks jobs, which would use the previous camera. For any thread. Raises InputError if a job is running."""
        with self._beginning:
            if self.busy:
                raise InputError(
                    "Keypoints are being read or detected with the current camera: wait for them, or cancel."
                )
            self._cameras += 1
        try:
            yield
        finally:
            with self._beginning:
                self._cameras -= 1

    def begin(self, job: KeypointJob) -> None:
        """Start a job. Raises InputError if the project has keypoints, cannot be changed, or has a running job."""
        self._project.refuse_read_only()
        if self._project.has_detections:
            raise InputError("This project already has keypoints. Make a new project for others.")
        if self.busy:
            assert self.going is not None
            raise InputError(f"{self.going.title}: wait for it, or cancel it.")
        self.people = None
        self._begin(job, None)

    def _begin(self, job: KeypointJob, before: Clip | None) -> None:
        with self._beginning:
            if self._cameras:
                raise InputError("The project's camera is being changed: wait, and start again.")
            self.going = self._tasks.submit(
                job.title, lambda report: self._found(job, before, report), then=self._ended
            )

    def _found(self, job: KeypointJob, before: Clip | None, report: Step) -> FoundKeypoints | None:
        """What a job finds; it is in the project when this returns."""
        found = job.run(before or self._project.clip, report)
        if found is not None:
            self._project.take_detections(
                found.keypoints,
                found.notes,
                detector=found.detector,
                silhouettes=found.silhouettes,
                camera=found.camera,
                before=before,
            )
            self._camera = self._project.footage.camera
        return found
