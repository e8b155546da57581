"""Keypoints found by tcfit in a video, in the form that readers of keypoint files return."""

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

from fitting_core.detect.detecting import Detected, Detection, DetectionProgress
from fitting_core.detect.detectors import find_detector
from fitting_core.detect.part import Detector
from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.silhouettes import Silhouettes
from fitting_core.video.frames import FrameSource, OnFrame

Tell = Callable[[DetectionProgress], None]
"""Receives the progress of a detection. An exception raised there ends it; earlier results stay cached."""


def find_keypoints(
    video: Path,
    frames: range,
    detector: str | Detector,
    tell: Tell = lambda progress: None,
    *,
    on_frame: OnFrame | None = None,
) -> Detected:
    """All people in some frames, in image coordinates; cached frames are not searched again. Raises InputError if the
    detector is not installed, results cannot be cached, or no person is found.

    Args:
        video: A video file or a folder of images.
        frames: Numbers of consecutive ones.
        detector: A name in `DETECTORS`, the path of a model, or one that is open.
        tell: Receives the progress.
        on_frame: See `FrameSource`; cached frames are not decoded.
    """
    opened = find_detector(detector) if isinstance(detector, str) else detector
    with FrameSource(video, on_frame=on_frame) as source:
        detection = Detection(source=source, frames=frames, detector=opened)
        with closing(detection.events(detection.store())) as events:
            for event in events:
                if isinstance(event, DetectionProgress):
                    tell(event)
                elif isinstance(event, Detected):
                    return with_somebody(event, video)
    raise AssertionError("a detection ends with what it found")


def with_somebody(found: Detected, video: Path) -> Detected:
    """Return the argument. Raises InputError if it has no people."""
    if not any(len(people) for people in found.people):
        count = len(found.frames)
        where = "the only frame" if count == 1 else f"any of the {count} frames"
        raise InputError(
            f"{found.detector} found nobody in {where} of {video}; expected a person who can be seen well. Choose "
            "frames that show one, try another detector (tcfit models shows them), or give keypoints."
        )
    return found


def found_detections(found: Detected, video: Path) -> Detections:
    """All people, frame by frame; frames are named by their numbers in the video."""
    return Detections(
        frames=found.people,
        stems=tuple(f"{video.stem}_{frame:012}" for frame in found.frames),
        source=video,
        detector=found.points,
        notes=(f"Keypoints were found by {found_by(found)}.",),
    )


def found_by(found: Detected) -> str:
    """Name and version of the detector."""
    return f"{found.detector} (version {found.version})"


def silhouettes_of(found: Detected, entries: Sequence[int | None]) -> Silhouettes | None:
    """Those of one person, by the place in each frame's list of people; None from a detector that finds none."""
    shown = [None if entry is None else found.silhouettes[t][entry] for t, entry in enumerate(entries)]
    some = next((mask for mask in shown if mask is not None), None)
    return None if some is None or not some.size else Silhouettes.of(shown, found.silhouette_size)
