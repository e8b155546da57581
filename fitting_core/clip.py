"""What is fitted: one person's keypoints over a clip, with the camera and where the frames come from."""

from dataclasses import dataclass
from pathlib import Path

from fitting_core.camera import Camera
from fitting_core.keypoints import Keypoints


@dataclass(frozen=True, kw_only=True)
class Clip:
    """One person in one shot."""

    keypoints: Keypoints
    camera: Camera
    frame_rate: float
    """Frames per second."""
    name: str
    source: Path | None = None
    """The video file or folder of images, if there is one; frame i of the keypoints is its frame i + first_frame."""
    first_frame: int = 0
    notes: tuple[str, ...] = ()
    """What a user should know about how the input was read: alignment, gaps, the person chosen."""

    def __len__(self) -> int:
        return len(self.keypoints)
