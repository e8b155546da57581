"""What a detector has found in a video, as what a reader of keypoint files returns."""

from collections.abc import Sequence
from pathlib import Path

from fitting_core.detect.detecting import Detected
from fitting_core.io.keypoints.detections import Detections
from fitting_core.silhouettes import Silhouettes


def found_detections(found: Detected, video: Path) -> Detections:
    """Everybody, frame by frame; frames are named by their numbers in the video."""
    return Detections(
        frames=found.people,
        stems=tuple(f"{video.stem}_{frame:012}" for frame in found.frames),
        source=video,
        notes=(f"Keypoints were found by {found.detector} ({found.version}).",),
    )


def silhouettes_of(found: Detected, entries: Sequence[int | None]) -> Silhouettes | None:
    """Those of one person, by the place in each frame's list of people; None from a detector that finds none."""
    shown = [None if entry is None else found.silhouettes[t][entry] for t, entry in enumerate(entries)]
    some = next((mask for mask in shown if mask is not None), None)
    return None if some is None or not some.size else Silhouettes.of(shown, found.silhouette_size)
