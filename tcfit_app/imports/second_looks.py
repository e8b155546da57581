"""A second look at some frames of a clip's video, as an edit of its keypoints."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Lens
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.keypoints import BODY, PARTS, Keypoints, PartOfPerson
from tcfit_app.project.edits.kinds import DetectAgain

_NEAREST = 10
"""Frames before and after in which to look for the person's position, if they were lost."""
Region = tuple[float, float, float, float]
"""Left, top, right and bottom of a rectangle, pixels."""


@dataclass(frozen=True, kw_only=True)
class SecondLook:
    """What is detected again, and where."""

    frames: tuple[int, ...]
    """From the clip's first (0)."""
    part: PartOfPerson
    region: Region | None = None
    """In the undistorted picture; None: wherever the person is."""

    def run(self, clip: Clip, report: Callable[[str, float | None], None]) -> DetectAgain | None:
        """Detect it near the clip's keypoints. Slow: for its own thread.

        `report` receives the current step and the progress (0 to 1, or unknown); it raises to end the search.

        Returns:
            The edit for the frames with detections; None without any.

        Raises:
            InputError: The video or the networks are missing.
        """
        from fitting_core.detect.second_look import look_again
        from fitting_core.lens import filmed_keypoints
        from fitting_core.video.frames import FrameSource

        if clip.source is None:
            raise InputError("The project's video is missing.")
        report("opening the detector", None)
        lens, count = clip.camera.lens, len(self.frames)
        near = known_near(filmed_keypoints(clip.keypoints, lens), self.frames)
        with FrameSource(clip.source) as source:
            found = look_again(
                source,
                [clip.first_frame + frame for frame in self.frames],
                part=self.part,
                region=None if self.region is None else filmed_region(self.region, lens),
                near=near,
                tell=lambda done: report(f"{done} of {count} frames", done / count),
            )
        return self._edit(_straightened(found, lens))

    def _edit(self, points: Float[np.ndarray, "n 137 3"]) -> DetectAgain | None:
        rows = np.flatnonzero(points[:, PARTS[self.part], 2].max(1) > 0)
        frames = [self.frames[row] for row in rows.tolist()]
        return DetectAgain.found(frames, self.part, points[rows]) if frames else None


def known_near(keypoints: Keypoints, frames: tuple[int, ...]) -> Float[np.ndarray, "n 137 3"]:
    """x, y and confidence of the person in each of some frames, or in the nearest frame with them.

    Without that, looking for a lost person could end with another person of the clip.
    """
    seen = np.flatnonzero((keypoints.confidence[:, BODY] > 0).any(1))
    there = np.array(frames)
    if len(seen):
        nearest = seen[np.abs(seen - there[:, None]).argmin(1)]
        there = np.where(np.abs(nearest - there) <= _NEAREST, nearest, there)
    return np.concatenate([keypoints.xy[there], keypoints.confidence[there, :, None]], -1)


def filmed_region(region: Region, lens: Lens | None) -> Region:
    """The bounding rectangle in the distorted picture of a rectangle of the undistorted picture."""
    from fitting_core.lens import filmed

    if lens is None:
        return region
    left, top, right, bottom = region
    across, down = np.linspace(left, right, 9), np.linspace(top, bottom, 9)
    bent = filmed(lens, np.stack(np.meshgrid(across, down), -1).reshape(-1, 2))
    (left, top), (right, bottom) = bent.min(0).tolist(), bent.max(0).tolist()
    return left, top, right, bottom


def _straightened(found: Float[np.ndarray, "n 137 3"], lens: Lens | None) -> Float[np.ndarray, "n 137 3"]:
    from fitting_core.lens import straightened_keypoints

    filmed = Keypoints(xy=found[..., :2], confidence=np.clip(found[..., 2], 0, 1))
    straight, _ = straightened_keypoints(filmed, lens)
    return np.concatenate([straight.xy, straight.confidence[..., None]], -1)
