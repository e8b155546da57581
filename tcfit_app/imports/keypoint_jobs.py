"""Jobs that provide a project's keypoints: each runs on its own thread and reports its progress."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from fitting_core.camera import Camera, FocalFrom
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.io.keypoints.openpose import SUFFIX
from fitting_core.keypoints import Keypoints
from fitting_core.silhouettes import Silhouettes
from tcfit_app.imports.found_people import FoundPeople
from tcfit_app.imports.uploads import kept_as
from tcfit_app.project.storage.names import name_of_file

if TYPE_CHECKING:
    from fitting_core.detect.detecting import Detected
    from fitting_core.video.sampled import SampledPictures

ProgressReport = Callable[[str, float | None], None]
"""Receives the current step and the progress (0 to 1, or unknown). Raises to end the job."""
_SUFFIXES = (SUFFIX, ".json", ".pose")
"""Of uploaded keypoints."""


@dataclass(frozen=True, kw_only=True)
class FoundKeypoints:
    """The result of a job."""

    keypoints: Keypoints
    """For every frame of the clip."""
    notes: tuple[str, ...]
    """For users."""
    detector: str = ""
    """The detector's name in `keypoint_noise.DETECTORS`."""
    silhouettes: Silhouettes | None = None
    """For every frame, if the detector provides them."""
    camera: Camera | None = None
    """With a focal length derived from the keypoints, if it was unknown; None: the clip's."""


class KeypointJob(Protocol):
    """A job; its arguments are checked where they are used, in `run`."""

    @property
    def title(self) -> str:
        """For the user."""
        ...

    def run(self, clip: Clip, report: ProgressReport) -> FoundKeypoints | None:
        """Do it, and return the keypoints if that is its purpose. Raises InputError."""
        ...


@dataclass(frozen=True, kw_only=True)
class ImportFiles:
    """Reads keypoints from files on this computer."""

    path: Path

    title: str = field(default="Importing keypoints", init=False)

    def run(self, clip: Clip, report: ProgressReport) -> FoundKeypoints:
        """See `KeypointJob.run`."""
        from fitting_core.clips.reading import read_keypoints
        from fitting_core.video.sampled import SampledPictures

        report(f"Reading {self.path.name}", None)
        keypoints, notes, detector = read_keypoints(self.path, clip)
        pictures = None if clip.source is None else SampledPictures(clip.source, _frames(clip), clip.camera)
        camera = _camera(clip, keypoints, pictures)
        return FoundKeypoints(keypoints=keypoints, notes=notes, detector=detector, camera=camera)


def _frames(clip: Clip) -> range:
    return range(clip.first_frame, clip.first_frame + len(clip))


def _camera(clip: Clip, keypoints: Keypoints, pictures: "SampledPictures | None") -> Camera:
    """The clip's camera, with what its pictures and these keypoints tell of it."""
    from fitting_core.ground.from_pictures import camera_from_pictures

    guessed = clip.camera.focal_from is FocalFrom.DIAGONAL
    return camera_from_pictures(clip.camera, keypoints, clip.frame_rate, pictures, estimate=guessed)


@dataclass(frozen=True, kw_only=True)
class ImportUpload:
    """Reads uploaded keypoints."""

    name: str
    content: bytes

    title: str = field(default="Importing keypoints", init=False)

    def run(self, clip: Clip, report: ProgressReport) -> FoundKeypoints:
        """See `KeypointJob.run`."""
        suffix = next((suffix for suffix in _SUFFIXES if self.name.lower().endswith(suffix)), None)
        if suffix is None or not self.content:
            raise InputError(
                f"{name_of_file(self.name)} has {len(self.content)} bytes, and its name is not a keypoint file's; "
                "expected one JSON or .pose file. Give a folder of OpenPose's files by its path on the computer that "
                "runs tcfit."
            )
        file = f"upload_0{SUFFIX}" if suffix == SUFFIX else f"upload{suffix}"
        with kept_as(file, self.content, name_of_file(self.name)) as path:
            return ImportFiles(path=path).run(clip, report)


@dataclass(frozen=True, kw_only=True)
class Detect:
    """Detects keypoints in the clip's video. Partial results are kept in the user's cache."""

    detector: str
    """A name in `DETECTORS`, or the path of a model."""
    person: int | None = None
    """As in `read_clip`; None: the person clicked on, or else the most prominent one."""
    people: FoundPeople = field(default_factory=FoundPeople)
    """Collects results as they arrive, and knows who is chosen."""

    title: str = field(default="Detecting keypoints", init=False)

    def run(self, clip: Clip, report: ProgressReport) -> FoundKeypoints:
        """See `KeypointJob.run`."""
        from fitting_core.detect.detecting import Detected, Detection, DetectionProgress
        from fitting_core.detect.detectors import find_detector
        from fitting_core.video.frames import FrameSource
        from fitting_core.video.sampled import SampledPictures

        if clip.source is None:
            raise InputError("The project's video is missing: relink it, or import keypoints.")
        report("Opening the detector", None)
        detector = find_detector(self.detector)
        frames = _frames(clip)
        pictures = SampledPictures(clip.source, frames, clip.camera)
        with FrameSource(clip.source, on_frame=pictures.take) as source:
            detection = Detection(source=source, frames=frames, detector=detector)
            with closing(detection.events(detection.store())) as events:
                for event in events:
                    if isinstance(event, Detected):
                        return self._chosen(event, clip, pictures)
                    if isinstance(event, DetectionProgress):
                        report(f"{event.done} of {event.total} frames", event.share)
                    else:
                        self.people.add(event, clip.first_frame)
        raise AssertionError("a detection ends with what it found")

    def _chosen(self, found: "Detected", clip: Clip, pictures: "SampledPictures") -> FoundKeypoints:
        from fitting_core.detect.found import found_detections, silhouettes_of, with_somebody
        from fitting_core.lens import straightened_keypoints
        from fitting_core.people.person import choose_person

        assert clip.source is not None
        detections = found_detections(with_somebody(found, clip.source), clip.source)
        seen = self._seen(found)
        person = self.person if seen is None else None
        one, choice = choose_person(
            detections, person=person, seen=seen, first_frame=clip.first_frame, frame_rate=clip.frame_rate
        )
        keypoints, of_lens = straightened_keypoints(one.keypoints, clip.camera.lens)
        return FoundKeypoints(
            keypoints=keypoints,
            notes=(*detections.notes, *([choice] if choice else []), *of_lens),
            detector=found.points,
            silhouettes=silhouettes_of(found, one.entries),
            camera=_camera(clip, keypoints, pictures),
        )

    def _seen(self, found: "Detected") -> tuple[int, int] | None:
        """Frame and index of the person clicked on, among those in the result."""
        if self.people.seen is None or (shown := self.people.at(self.people.seen[0])) is None:
            return None
        frame, place = self.people.seen
        same = [np.array_equal(points, shown.points[place]) for points in found.people[frame]]
        return (frame, same.index(True)) if True in same else None


@dataclass(frozen=True, kw_only=True)
class FetchNetworks:
    """Fetches the built-in detector's networks, with the user's agreement."""

    title: str = field(default="Fetching the detector", init=False)

    def run(self, clip: Clip, report: ProgressReport) -> None:
        """See `KeypointJob.run`."""
        from fitting_core.detect.mediapipe.fetching import FetchProgress, fetch

        with closing(fetch()) as events:  # pyright: ignore[reportArgumentType]
            for event in events:
                if isinstance(event, FetchProgress):
                    report(event.step, event.share)


@dataclass(frozen=True, kw_only=True)
class Download:
    """Fetches a known model, with the user's agreement."""

    name: str

    @property
    def title(self) -> str:
        """For the user."""
        return f"Downloading {self.name}"

    def run(self, clip: Clip, report: ProgressReport) -> None:
        """See `KeypointJob.run`."""
        from fitting_core.detect.download import Downloaded, download
        from fitting_core.detect.known_models import KNOWN_MODELS

        report("Connecting", None)
        for event in download(KNOWN_MODELS[self.name]):
            if not isinstance(event, Downloaded):
                total = f" of {event.total / 1e6:.0f}" if event.total else ""
                report(f"{event.done / 1e6:.1f}{total} MB", event.share if event.total else None)
