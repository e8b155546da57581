"""What is fitted: one person's keypoints over a clip, with the camera and where the frames come from."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera, Matrix, Vector
from fitting_core.errors import InputError
from fitting_core.keypoints import Keypoints
from fitting_core.silhouettes import Silhouettes

_UP_DIFFERS, _UNSURE = 20.0, 5.0
"""Degrees from which what is up, or the angle between two views, is in doubt."""


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
    detector: str = ""
    """Detector of the keypoints, as named in `keypoint_noise.DETECTOR_TITLES`; empty if unknown."""
    notes: tuple[str, ...] = ()
    """Notes for the user on how the input was read: alignment, gaps, the selected person."""
    silhouettes: Silhouettes | None = None
    """Where a detector found them: of the images as they were filmed."""
    found_by: str = ""
    """Name and version of the detector where tcfit found the keypoints itself; empty where they were given."""
    views: "tuple[OtherView, ...]" = ()
    """Other views of the person at the same time; a fit relates those to this one that are not yet (`fit.views`)."""

    def __len__(self) -> int:
        return len(self.keypoints)

    def corrected(self, frame: int, points: Mapping[str, tuple[float, float] | None]) -> "Clip":
        """The clip with keypoints of one frame as a person says they are; `fit.refitting.refit` fits it again.

        Args:
            frame: Counted from the clip's first as 0.
            points: By name in `keypoints.NAMES`: where it is in the image, in pixels (x right, y down), with confidence
                1; or None: what was detected is wrong, and does not count.

        Raises:
            InputError: There is no such frame or keypoint, or a position is not finite.
        """
        if not 0 <= frame < len(self):
            raise InputError(f"There is no frame {frame} to correct: the clip has frames 0 to {len(self) - 1}.")
        return replace(self, keypoints=self.keypoints.corrected(frame, points))


@dataclass(frozen=True, kw_only=True)
class Relation:
    """Pose and clock of another view relative to the first: x_other = rotation x_first + translation."""

    rotation: Matrix
    """By rows."""
    translation: Vector
    """In metres if the person is as tall as the average adult; proportional to the height."""
    offset: float
    """Seconds to add to a time in the first clip for the same moment in the other, both from their first frame."""
    rotation_deviation: float
    """Standard deviation, degrees."""
    direction_deviation: float
    """Standard deviation of the direction from camera to camera, degrees."""
    offset_deviation: float
    """Standard deviation, seconds."""
    disagreement: float
    """Median angle by which viewing rays of the same keypoint miss each other, radians."""
    overlap: float
    """Seconds that both show."""
    vertical_off: float
    """Angle between the up directions of both views, degrees."""

    @property
    def angle(self) -> float:
        """Between the directions of both cameras, degrees."""
        return float(np.degrees(np.arccos(np.clip(self.rotation[2][2], -1.0, 1.0))))

    @property
    def turn(self) -> Float[np.ndarray, "3 3"]:
        """`rotation` as an array."""
        return np.array(self.rotation, float)

    @property
    def shift(self) -> Float[np.ndarray, "3"]:
        """`translation` as an array."""
        return np.array(self.translation, float)


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherView:
    """A clip of the same person at the same time by another camera."""

    clip: Clip
    times: Float[np.ndarray, "T"] | None = None
    """Seconds of each frame; None: at the clip's frame rate."""
    relation: Relation | None = None
    """To the first clip; None until it is estimated."""

    def sentence(self) -> str:
        """What was found about it, for the user."""
        found = self.relation
        assert found is not None, "views of a clip are related to it"
        doubt = f" They differ by {found.vertical_off:.0f}° on what is up." if found.vertical_off > _UP_DIFFERS else ""
        if found.rotation_deviation > _UNSURE:
            doubt += " Give both focal lengths if you know them: without them the angle is unsure."
        late = "later" if found.offset < 0 else "earlier"
        pixels = found.disagreement * self.clip.camera.focal[0]
        return (
            f"{self.clip.name} is another view, {found.angle:.0f}° from this one (± {found.rotation_deviation:.0f}°); "
            f"it starts {abs(found.offset):.2f} s {late} (± {found.offset_deviation:.2f} s), and both show "
            f"{found.overlap:.1f} s. Half of its keypoints are within {pixels:.0f} px "
            f"of where this one puts them.{doubt}"
        )
