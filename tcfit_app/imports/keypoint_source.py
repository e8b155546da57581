"""Keypoints for a project that was made without: one job at a time, on a thread, for all browsers."""

import shutil
from pathlib import Path

from fitting_core.errors import InputError
from tcfit_app.imports.job_thread import JobThread
from tcfit_app.imports.keypoint_jobs import Detect, Download, FoundKeypoints, ImportFiles, ImportUpload, KeypointJob
from tcfit_app.project.project import Project

PARTS = "detection"
"""The project's folder of what a detection has found so far."""
_PATIENCE = 10.0
"""Seconds for which a closing app waits for a job to notice that it was cancelled."""


class Going(JobThread):
    """A job from its start to its end. Begins at once."""

    def __init__(self, job: KeypointJob, project: Project) -> None:
        super().__init__(job.title)
        self.job = job
        self.text, self.share = "", None
        self.found: FoundKeypoints | None = None
        self._clip = project.clip
        self.start()

    def _report(self, text: str, share: float | None) -> None:
        self._go_on()
        self.text, self.share = text, share

    def _work(self) -> None:
        self.found = self.job.run(self._clip, self._report)
        self._report(self.text, 1.0)


class KeypointSource:
    """Gets a project its keypoints. For the one thread that draws.

    Args:
        project: Open.
    """

    def __init__(self, project: Project) -> None:
        self._project = project
        self.going: Going | None = None
        """The job that began last."""
        self._taken: Going | None = None

    def import_path(self, path: Path) -> None:
        """Begin to read keypoints of this computer. Raises InputError if that cannot begin."""
        self._begin(ImportFiles(path=path))

    def import_upload(self, name: str, content: bytes) -> None:
        """Begin to read keypoints that a browser has sent. Raises InputError as `import_path`."""
        self._begin(ImportUpload(name=name, content=content))

    def detect(self, pose: str, boxes: str = "", *, provider: str = "cpu") -> None:
        """Begin to detect keypoints, or go on with it. Raises InputError as `import_path`.

        Args:
            pose: Path of a whole-body model, or the name of a known one.
            boxes: The same for a model that finds people; empty: without one.
            provider: Where they run.
        """
        if not pose.strip():
            raise InputError("No model is given; expected the path of a whole-body ONNX model.")
        parts = self._project.folder / PARTS
        self._begin(Detect(pose=pose.strip(), boxes=boxes.strip(), parts=parts, provider=provider))

    def download(self, name: str) -> None:
        """Begin to fetch a known model. Raises InputError as `import_path`."""
        self._begin(Download(name=name))

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

    def _begin(self, job: KeypointJob) -> None:
        if self._project.read_only:
            raise InputError("This project is open read-only: it cannot get keypoints.")
        if self._project.has_detections:
            raise InputError("This project has its keypoints already. Make a new project for others.")
        if self.busy:
            assert self.going is not None
            raise InputError(f"{self.going.job.title}: wait for it, or cancel it.")
        self.going = Going(job, self._project)

    def take(self) -> Going | None:
        """The job that has ended since the last call, once; keypoints that it found are in the project then."""
        going = self.going
        if going is None or going.state == "running" or going is self._taken:
            return None
        self._taken = going
        if going.found is not None and going.state == "finished":
            try:
                self._project.take_detections(going.found.keypoints, going.found.notes)
            except InputError as error:
                going.reason, going.state = str(error), "failed"
                return going
            shutil.rmtree(self._project.folder / PARTS, ignore_errors=True)
        return going

    def close(self) -> None:
        """End the job that is running."""
        if self.going is not None:
            self.going.cancel()
            self.going.join(_PATIENCE)
