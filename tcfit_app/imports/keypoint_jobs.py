"""What gets keypoints for a project that has none: each job runs on a thread of its own and reports how far it is."""

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.keypoints import Keypoints

Report = Callable[[str, float | None], None]
"""Takes what is being done, and how far it is (0 to 1, or unknown). Raises to end the job."""


@dataclass(frozen=True, kw_only=True)
class FoundKeypoints:
    """What a job has found."""

    keypoints: Keypoints
    """Of every frame of the clip."""
    notes: tuple[str, ...]
    """For the user."""


class KeypointJob(Protocol):
    """A job; its arguments are checked where they are used, in `run`."""

    @property
    def title(self) -> str:
        """For the user."""
        ...

    def run(self, clip: Clip, report: Report) -> FoundKeypoints | None:
        """Do it, and return the keypoints, if this is what it is for. Raises InputError."""
        ...


@dataclass(frozen=True, kw_only=True)
class ImportFiles:
    """Reads keypoints from this computer."""

    path: Path

    @property
    def title(self) -> str:
        """For the user."""
        return "Importing keypoints"

    def run(self, clip: Clip, report: Report) -> FoundKeypoints:
        """See `KeypointJob.run`."""
        from fitting_core.io.clip_reader import read_keypoints

        report(f"Reading {self.path.name}", None)
        keypoints, notes = read_keypoints(self.path, clip)
        return FoundKeypoints(keypoints=keypoints, notes=notes)


@dataclass(frozen=True, kw_only=True)
class ImportUpload:
    """Reads keypoints that a browser has sent."""

    name: str
    content: bytes

    @property
    def title(self) -> str:
        """For the user."""
        return "Importing keypoints"

    def run(self, clip: Clip, report: Report) -> FoundKeypoints:
        """See `KeypointJob.run`."""
        from tcfit_app.imports.keypoint_uploads import received

        report("Unpacking the upload", None)
        with tempfile.TemporaryDirectory(prefix="tcfit-upload-") as folder:
            path = received(self.name, self.content, Path(folder))
            return ImportFiles(path=path).run(clip, report)


@dataclass(frozen=True, kw_only=True)
class Detect:
    """Finds keypoints in the clip's video. What it had found when it ended is gone on with."""

    pose: str
    """Path of a whole-body model, or the name of a known one."""
    boxes: str = ""
    """The same for a model that finds people; empty: without one."""
    parts: Path
    """Folder for what has been found so far."""
    provider: str = "cpu"

    @property
    def title(self) -> str:
        """For the user."""
        return "Detecting keypoints"

    def run(self, clip: Clip, report: Report) -> FoundKeypoints:
        """See `KeypointJob.run`."""
        from fitting_core.detect import load_box_model, load_pose_model
        from fitting_core.detect.detecting import Detected, Detection
        from fitting_core.detect.known_models import find_model
        from fitting_core.detect.stored import StoredDetection
        from fitting_core.video.frames import FrameSource

        if clip.source is None:
            raise InputError("The project's video is not there: say where it is, or import keypoints.")
        report("Opening the models", None)
        # The browser's pictures need a core, too.
        threads = max(1, (os.cpu_count() or 1) - 1)
        pose = load_pose_model(find_model(self.pose), provider=self.provider, threads=threads)
        boxes = load_box_model(find_model(self.boxes), provider=self.provider, threads=threads) if self.boxes else None
        store = StoredDetection(self.parts)
        with FrameSource(clip.source) as source:
            frames = range(clip.first_frame, clip.first_frame + len(clip))
            detection = Detection(source=source, frames=frames, pose=pose, boxes=boxes)
            if store.settings() != detection.settings():
                store.discard()  # of other models
            for event in detection.events(store):
                if isinstance(event, Detected):
                    notes = (f"Keypoints were detected by {self._models()}.", *([event.note] if event.note else []))
                    return FoundKeypoints(keypoints=event.keypoints, notes=notes)
                what = {"people": "Looking for people", "keypoints": "Detecting keypoints"}[event.step]
                report(f"{what}: {event.done} of {event.total} frames", event.share)
        raise AssertionError("a detection ends with what it found")

    def _models(self) -> str:
        return " and ".join(Path(given).name for given in (self.pose, self.boxes) if given)


@dataclass(frozen=True, kw_only=True)
class Download:
    """Fetches a known model, which the user has agreed to."""

    name: str

    @property
    def title(self) -> str:
        """For the user."""
        return f"Downloading {self.name}"

    def run(self, clip: Clip, report: Report) -> None:
        """See `KeypointJob.run`."""
        from fitting_core.detect.download import Downloaded, download
        from fitting_core.detect.known_models import KNOWN_MODELS

        report("Connecting", None)
        for event in download(KNOWN_MODELS[self.name]):
            if not isinstance(event, Downloaded):
                total = f" of {event.total / 1e6:.0f}" if event.total else ""
                report(f"{event.done / 1e6:.1f}{total} MB", event.share if event.total else None)
