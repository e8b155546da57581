"""Keypoints for a project that was made without: one job at a time, for all browsers."""

import shutil
from collections.abc import Callable

from fitting_core.errors import InputError
from tcfit_app.imports.keypoint_jobs import Detect, FoundKeypoints, KeypointJob
from tcfit_app.project.project import Project
from tcfit_app.review.session.tasks import Step, Task, Tasks

Going = Task[FoundKeypoints | None]
"""A job from its start to its end."""
PARTS = "detection"
"""The project's folder of what a detection has found so far."""


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

    def detect(self, pose: str, boxes: str = "") -> None:
        """Begin to detect keypoints, or go on with it. Raises InputError as `begin`.

        Args:
            pose: Path of a whole-body model, or the name of a known one.
            boxes: The same for a model that finds people; empty: without one.
        """
        if not pose.strip():
            raise InputError("No model is given; expected the path of a whole-body ONNX model.")
        parts = self._project.folder / PARTS
        self.begin(Detect(pose=pose.strip(), boxes=boxes.strip(), parts=parts))

    def cancel(self) -> None:
        """Stop what is going on; a detection or download goes on with what it has when it begins again."""
        if self.going is not None:
            self.going.cancel()

    @property
    def busy(self) -> bool:
        """Whether a job is running."""
        return self.going is not None and self.going.state == "running"

    @property
    def begun(self) -> bool:
        """Whether there is the beginning of a detection."""
        return (self._project.folder / PARTS).is_dir()

    def begin(self, job: KeypointJob) -> None:
        """Begin a job. Raises InputError if the project has keypoints or cannot be changed, or another job goes on."""
        self._project.refuse_read_only()
        if self._project.has_detections:
            raise InputError("This project has its keypoints already. Make a new project for others.")
        if self.busy:
            assert self.going is not None
            raise InputError(f"{self.going.title}: wait for it, or cancel it.")
        self.going = self._tasks.submit(job.title, lambda report: self._found(job, report), then=self._ended)

    def _found(self, job: KeypointJob, report: Step) -> FoundKeypoints | None:
        """What a job finds, which is in the project when this returns."""
        found = job.run(self._project.clip, report)
        if found is not None:
            self._project.take_detections(found.keypoints, found.notes, detector=found.detector)
            shutil.rmtree(self._project.folder / PARTS, ignore_errors=True)
        return found
