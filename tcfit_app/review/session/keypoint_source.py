"""Keypoints for a project that was made without: one job at a time, for all browsers."""

from collections.abc import Callable

from fitting_core.errors import InputError
from fitting_core.lens import straightened_keypoints
from tcfit_app.fitting.jobs import Fresh
from tcfit_app.imports.found_people import FoundPeople
from tcfit_app.imports.keypoint_jobs import Detect, FoundKeypoints, KeypointJob
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

    def detect(self, detector: str, *, person: int | None = None) -> None:
        """Begin to find keypoints, or go on with it. Raises InputError as `begin`.

        Args:
            detector: A name in `DETECTORS`, or the path of a model.
            person: As of `read_clip`, as long as nobody clicks on another one.
        """
        people = FoundPeople()
        self.begin(Detect(detector=detector, person=person, people=people))
        self.people = people

    def feed(self) -> Callable[[], Fresh]:
        """What the detection that began last has found since it was asked last; see `FitAsFound.fresh`."""
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
                    straight, _ = straightened_keypoints(people.keypoints(frames), self._project.clip.camera.lens)
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

    def begin(self, job: KeypointJob) -> None:
        """Begin a job. Raises InputError if the project has keypoints or cannot be changed, or another job goes on."""
        self._project.refuse_read_only()
        if self._project.has_detections:
            raise InputError("This project has its keypoints already. Make a new project for others.")
        if self.busy:
            assert self.going is not None
            raise InputError(f"{self.going.title}: wait for it, or cancel it.")
        self.people = None
        self.going = self._tasks.submit(job.title, lambda report: self._found(job, report), then=self._ended)

    def _found(self, job: KeypointJob, report: Step) -> FoundKeypoints | None:
        """What a job finds, which is in the project when this returns."""
        found = job.run(self._project.clip, report)
        if found is not None:
            self._project.take_detections(
                found.keypoints,
                found.notes,
                detector=found.detector,
                silhouettes=found.silhouettes,
                camera=found.camera,
            )
        return found
