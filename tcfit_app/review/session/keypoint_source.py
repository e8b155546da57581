"""Keypoints for a project that was made without: one job at a time, for all browsers."""

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
from tcfit_app.project.edits.edit_log import Remark
from tcfit_app.project.project import Project
from tcfit_app.review.session.tasks import Step, Task, Tasks

Going = Task[FoundKeypoints | None]
"""A job from its start to its end."""


class KeypointSource:
    """Gets a project its keypoints. For the one thread that draws.

    Args:
        project: Open.
        tasks: Do the jobs.
        ended: Is called when a job has ended; what it found is in the project then.
    """

    def __init__(self, project: Project, tasks: Tasks, ended: Callable[[Going], None]) -> None:
        self._project, self._tasks, self._ended = project, tasks, ended
        self.going: Going | None = None
        """The job that began last."""
        self.people: FoundPeople | None = None
        """Whom the detection that began last has found; None without one."""
        self._detector = ""
        self._before: Clip | None = None
        """The clip as the detection that began last found it."""
        self._beginning = threading.Lock()
        self._cameras = 0
        """How many calibrations are being read that may become the project's camera."""
        self._camera: Camera | None = None
        """The clip's, as that detection left it."""

    def detect(self, detector: str, *, person: int | None = None) -> None:
        """Begin to find keypoints, or go on with it. Raises InputError as `begin`.

        Args:
            detector: A name in `DETECTORS`, or the path of a model.
            person: As of `read_clip`, as long as nobody clicks on another one.
        """
        people, before = FoundPeople(), self._project.clip
        self.begin(Detect(detector=detector, person=person, people=people))
        self.people, self._detector, self._before = people, detector, before

    @property
    def can_choose(self) -> bool:
        """Whether another one of the people who were found can be taken, as far as fits do not forbid it."""
        project, people = self._project, self.people
        if people is None or project.read_only or people.count < 2:
            return False
        if not project.has_detections:
            return True
        edited = any(not isinstance(entry.action, Remark) for entry in project.log)
        return not (edited or self.busy) and project.footage.camera == self._camera

    def choose(self, frame: int, place: int) -> None:
        """Say who is meant of those who were found; keypoints that the project has got already are replaced.

        Args:
            frame: Counted from the clip's first.
            place: In the list of the frame's people.

        Raises:
            InputError: The project has edits or runs.
        """
        people, before = self.people, self._before
        if people is None or before is None or not self.can_choose:
            return
        people.choose(frame, place)
        if self._project.has_detections:
            self._begin(Detect(detector=self._detector, people=people), before)

    def feed(self) -> Callable[[], Fresh]:
        """What the detection that began last has found since it was asked last; see `FitEverything.fresh`."""
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
        """Stop what is going on; a detection goes on with what it has when it begins again."""
        if self.going is not None:
            self.going.cancel()

    @property
    def busy(self) -> bool:
        """Whether a job is running."""
        return self.going is not None and self.going.state == "running"

    @contextmanager
    def camera_changes(self) -> Iterator[None]:
        """No job begins meanwhile, whose keypoints would be those of the camera before. For any thread.

        Raises:
            InputError: A job is running.
        """
        with self._beginning:
            if self.busy:
                raise InputError(
                    "Keypoints are being read or found with the camera as it is: wait for them, or cancel."
                )
            self._cameras += 1
        try:
            yield
        finally:
            with self._beginning:
                self._cameras -= 1

    def begin(self, job: KeypointJob) -> None:
        """Begin a job. Raises InputError if the project has keypoints or cannot be changed, or another job goes on."""
        self._project.refuse_read_only()
        if self._project.has_detections:
            raise InputError("This project has its keypoints already. Make a new project for others.")
        if self.busy:
            assert self.going is not None
            raise InputError(f"{self.going.title}: wait for it, or cancel it.")
        self.people = None
        self._begin(job, None)

    def _begin(self, job: KeypointJob, before: Clip | None) -> None:
        with self._beginning:
            if self._cameras:
                raise InputError("The project's camera is being changed: wait for that, and begin again.")
            self.going = self._tasks.submit(
                job.title, lambda report: self._found(job, before, report), then=self._ended
            )

    def _found(self, job: KeypointJob, before: Clip | None, report: Step) -> FoundKeypoints | None:
        """What a job finds, which is in the project when this returns."""
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
