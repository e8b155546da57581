"""The demo clip that comes with tcfit: a video, keypoints as a detector would give them, and the truth."""

from dataclasses import dataclass
from pathlib import Path

from fitting_core.camera import Camera
from fitting_core.io.truth import read_truth
from fitting_core.shipped import DEMO_FOLDER


@dataclass(frozen=True, kw_only=True)
class DemoClip:
    """The paths of a demo clip's parts."""

    video: Path
    keypoints: Path
    """OpenPose JSON, one file with a list of the frames."""
    truth: Path
    """Read it with `fitting_core.io.truth.read_truth`."""
    camera: Camera


def demo_clip() -> DemoClip:
    """The demo clip: 145 frames of a person who signs, then sits down on a stool.

    Raises:
        InputError: It is missing or damaged.
    """
    return clip_in(DEMO_FOLDER)


def clip_in(folder: Path) -> DemoClip:
    """A demo clip in the folder where it was made. Raises InputError if its truth cannot be read."""
    truth = folder / "truth.npz"
    return DemoClip(
        video=folder / "video.mp4",
        keypoints=folder / "demo_keypoints.json",
        truth=truth,
        camera=read_truth(truth).camera,
    )
