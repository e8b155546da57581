"""Origin of each frame's fit, and why its solver stopped: for inspecting frames that look wrong."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Int, UInt8


class Start(IntEnum):
    """Where a frame's fit started. Files hold these numbers, so that none ever gets another meaning."""

    UNKNOWN = 0
    TURNED_0 = 1
    TURNED_90 = 2
    TURNED_180 = 3
    TURNED_270 = 4
    SEAT = 5
    FRAME_BEFORE = 6
    FRAME_AFTER = 7
    LEFT_ARM = 8
    RIGHT_ARM = 9
    LEFT_LEG = 10
    RIGHT_LEG = 11
    LEFT_HAND = 12
    RIGHT_HAND = 13
    FILLED = 14
    AGAIN = 15
    BETWEEN = 16
    GIVEN = 17


class Stopped(IntEnum):
    """Why the last minimisation of a frame stopped. As for `Start`, no number ever gets another meaning."""

    UNKNOWN = 0
    CONVERGED = 1
    ITERATIONS = 2
    STALLED = 3
    FAILED = 4
    EMPTY = 5


STARTS: dict[int, str] = {
    Start.UNKNOWN: "a start that was not noted",
    Start.TURNED_0: "the neutral pose, facing the camera",
    Start.TURNED_90: "the neutral pose, turned by 90 degrees",
    Start.TURNED_180: "the neutral pose, turned by 180 degrees",
    Start.TURNED_270: "the neutral pose, turned by 270 degrees",
    Start.SEAT: "a sitting pose",
    Start.FRAME_BEFORE: "the fit of a frame before it",
    Start.FRAME_AFTER: "the fit of a frame after it",
    Start.LEFT_ARM: "its own fit with the left arm mirrored in depth",
    Start.RIGHT_ARM: "its own fit with the right arm mirrored in depth",
    Start.LEFT_LEG: "its own fit with the left leg mirrored in depth",
    Start.RIGHT_LEG: "its own fit with the right leg mirrored in depth",
    Start.LEFT_HAND: "its own fit with the left hand mirrored in depth",
    Start.RIGHT_HAND: "its own fit with the right hand mirrored in depth",
    Start.FILLED: "the frames around it, as it could not be fitted alone",
    Start.AGAIN: "an earlier result",
    Start.BETWEEN: "between the key frames before and after it",
    Start.GIVEN: "the result that was given to start from",
}
"""Completions of 'started from ...'."""

STOPS: dict[int, str] = {
    Stopped.UNKNOWN: "the reason was not noted",
    Stopped.CONVERGED: "the cost fell no further",
    Stopped.ITERATIONS: "the limit of iterations was reached",
    Stopped.STALLED: "no step lowered the cost any more",
    Stopped.FAILED: "its keypoints could not be fitted",
    Stopped.EMPTY: "it shows too few keypoints to be fitted",
}
"""Completions of 'stopped because ...'."""

TURNED = {0.0: Start.TURNED_0, 90.0: Start.TURNED_90, 180.0: Start.TURNED_180, 270.0: Start.TURNED_270}
"""By the degrees that the neutral pose is turned from facing the camera."""


@dataclass(frozen=True, eq=False)
class Provenance:
    """Where the fit of each frame came from, as numbers of `Start` and `Stopped`.

    A later phase goes on from where an earlier one ended: its frames keep their start.
    """

    start: UInt8[np.ndarray, "T"]
    stopped: UInt8[np.ndarray, "T"]

    @staticmethod
    def unknown(frames: int) -> "Provenance":
        """Nothing is known of any frame."""
        return Provenance(np.zeros(frames, np.uint8), np.zeros(frames, np.uint8))

    def __len__(self) -> int:
        return len(self.start)

    def __getitem__(self, frames: slice) -> "Provenance":
        return Provenance(self.start[frames], self.stopped[frames])

    def with_frames(self, frames: range, other: "Provenance") -> "Provenance":
        """A copy in which `frames` are as `other` has them, one after the other."""
        start, stopped = self.start.copy(), self.stopped.copy()
        start[frames.start : frames.stop], stopped[frames.start : frames.stop] = other.start, other.stopped
        return Provenance(start, stopped)

    def sentences(self) -> tuple[tuple[str, ...], Int[np.ndarray, "T"]]:
        """For the user, "started from ..., stopped because ...": each sentence once, and which one is each frame's."""
        pairs, which = np.unique(np.stack([self.start, self.stopped], 1), axis=0, return_inverse=True)
        return tuple(_sentence(start, stopped) for start, stopped in pairs.tolist()), which.reshape(-1)


def _sentence(start: int, stopped: int) -> str:
    """Numbers that a later version wrote count as unknown."""
    began = STARTS.get(start, STARTS[Start.UNKNOWN])
    return f"started from {began}, stopped because {STOPS.get(stopped, STOPS[Stopped.UNKNOWN])}"
