"""Values given to a fit: another system's result as its start, and a known shape."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from fitting_core.body.params import BodyParams


@dataclass(frozen=True, kw_only=True)
class StartRecord:
    """Record of a start, stored with the fit."""

    source: str
    """Name of the file or folder."""
    format: str
    """Name of its format, in words."""
    person: int | None
    """Of several people in it, the number of the one that was taken."""
    frames: int
    """Of the clip, in which the fit begins with it."""
    clip_frames: int
    focal: tuple[float, float]
    """Of its camera, in pixels of the clip's images."""
    focal_source: str
    off: float
    """Median distance between its keypoints and the detected ones in these frames, metres across the line of sight."""
    notes: tuple[str, ...] = ()
    """How it was read, for the user."""

    def sentence(self) -> str:
        """For the user."""
        who = "" if self.person is None else f", person {self.person}"
        return (
            f"Phase 1 begins with {self.source}, read as {self.format}{who}, in {self.frames} of {self.clip_frames} "
            f"frames; its focal length is {self.focal[0]:.0f} px ({self.focal_source}), and its keypoints are "
            f"{100 * self.off:.1f} cm off the detected ones (median)."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenStart:
    """T frames of a motion; `start[frames]` is the same for some of them."""

    params: BodyParams
    """Of the fitted body, in camera space; hands are axis-angle over the mean, 45 numbers each."""
    there: Bool[np.ndarray, "T"]
    """Frames in which a fit may begin with it."""
    points: Float[np.ndarray, "T 25 3"]
    """Where it has the keypoints of BODY_25 relative to the pelvis joint, metres in camera axes; NaN: it has not."""
    off: Float[np.ndarray, "T 25"]
    """How far these are from the detected ones across the line of sight, metres; where nothing is detected, the mean of
    the others."""
    about: StartRecord

    def __len__(self) -> int:
        return len(self.there)

    def __getitem__(self, frames: slice | Int[np.ndarray, "n"]) -> "GivenStart":
        own = frames if isinstance(frames, slice) else torch.as_tensor(frames)
        return replace(
            self, params=self.params[own], there=self.there[frames], points=self.points[frames], off=self.off[frames]
        )

    @property
    def tells_hands(self) -> bool:
        """Whether it has hands at all: most systems leave them as the body's mean."""
        return bool(self.params.left_hand_pose.any() or self.params.right_hand_pose.any())

    def deviation(self, deviation: float) -> Float[np.ndarray, "T 25"]:
        """How far its points may be off, metres; infinite where it has none.

        What is off by so much across the line of sight is off by as much along it; half of that variance counts as the
        detector's.

        Args:
            deviation: standard deviation of points that lie where the detected ones are, metres.
        """
        known = self.there[:, None] & np.isfinite(self.points).all(-1)
        return np.where(known, np.sqrt(deviation**2 + self.off**2 / 2), np.inf)


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownShape:
    """A shape given to phase 2, which takes it in place of the one that it finds."""

    betas: Float[np.ndarray, "10"]
    """Of the body that is fitted: on another one they mean another shape."""
    source: str = ""
    """Their source, for the user."""

    def sentence(self) -> str:
        """For the user."""
        return f"shape as given from {self.source}" if self.source else "shape as given"
