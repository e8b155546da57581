"""Keypoints as they stand after some corrections: what edits read and write."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped

from fitting_core.keypoints import Keypoints

_RECORD = np.dtype(
    [
        ("xy", float, 2),
        ("shift", float, 2),
        ("confidence", float),
        ("depth", float),
        ("turn", np.float32, 3),
        ("bad", bool),
        ("edited", bool),
        ("key", bool),
        ("pinned", bool),
    ],
    align=True,
)
"""All about one keypoint of one frame, in 64 bytes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrected:
    """Some keypoints of some frames: all of a clip, or those that one edit touches."""

    records: Shaped[np.ndarray, "F K"]
    """Of `_RECORD`, side by side: an edit reads and writes a few keypoints of a few frames, and all about them."""

    @staticmethod
    def none(keypoints: Keypoints) -> "Corrected":
        """Detections without any correction, in an array of their own."""
        return Corrected.as_detected(keypoints.xy, keypoints.confidence)

    @staticmethod
    def as_detected(xy: Float[np.ndarray, "F K 2"], confidence: Float[np.ndarray, "F K"]) -> "Corrected":
        """Some keypoints as a detector gives them, in an array of their own."""
        made = Corrected(records=np.zeros(confidence.shape, _RECORD))
        made.xy[:], made.confidence[:] = xy, confidence
        made.depth[:], made.turn[:] = np.nan, np.nan
        return made

    @property
    def xy(self) -> Float[np.ndarray, "F K 2"]:
        """Pixels, as in Keypoints."""
        return self.records["xy"]

    @property
    def confidence(self) -> Float[np.ndarray, "F K"]:
        """0 (not detected) to 1; of a keypoint marked bad what it has once it is restored."""
        return self.records["confidence"]

    @property
    def bad(self) -> Bool[np.ndarray, "F K"]:
        """Marked as wrong by a person."""
        return self.records["bad"]

    @property
    def edited(self) -> Bool[np.ndarray, "F K"]:
        """Position, side or confidence come from a person and not from the detector."""
        return self.records["edited"]

    @property
    def depth(self) -> Float[np.ndarray, "F K"]:
        """As in Keypoints; of a keypoint marked bad what counts once it is restored."""
        return self.records["depth"]

    @property
    def turn(self) -> Float32[np.ndarray, "F K 3"]:
        """As in Keypoints; of a keypoint marked bad too, for it is the body's."""
        return self.records["turn"]

    @property
    def key(self) -> Bool[np.ndarray, "F K"]:
        """A person has put it there as a keyframe: the frames between two of them follow both."""
        return self.records["key"]

    @property
    def pinned(self) -> Bool[np.ndarray, "F K"]:
        """A person has said that it is in one place in space, in these frames and others, and nothing since."""
        return self.records["pinned"]

    @property
    def shift(self) -> Float[np.ndarray, "F K 2"]:
        """How far keyframes have moved it, pixels: `xy - shift` is where it would be without them, (0, 0) if
        nowhere."""
        return self.records["shift"]

    def at(self, frames: tuple[int, ...], joints: tuple[int, ...]) -> "Corrected":
        """A copy of some keypoints in some frames."""
        return Corrected(records=self.records.reshape(-1).take(_cells(frames, joints, self.records.shape[1])))

    def put(self, frames: tuple[int, ...], joints: tuple[int, ...], values: "Corrected") -> None:
        """Overwrite some keypoints in some frames, in place: a copy of a long clip for each edit would add up."""
        self.records.reshape(-1)[_cells(frames, joints, self.records.shape[1])] = values.records

    @property
    def present(self) -> Bool[np.ndarray, "F K"]:
        """Detected or placed, and not marked bad."""
        return (self.confidence > 0) & ~self.bad

    @property
    def told_depth(self) -> Float[np.ndarray, "F K"]:
        """`depth`, without that of keypoints marked bad."""
        return np.where(self.bad, np.nan, self.depth)

    @property
    def locked(self) -> Bool[np.ndarray, "F K"]:
        """A person has said how the joint is turned."""
        return np.isfinite(self.turn[..., 0])

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        return self.records.nbytes

    def frozen(self) -> "Corrected":
        """A copy that nobody can write to."""
        return Corrected(records=_fixed(self.records.copy()))

    def keypoints(self) -> Keypoints:
        """What is fitted: a keypoint marked bad has confidence 0. In arrays of their own, which nobody can write to."""
        depth = _fixed(self.told_depth)
        return Keypoints(
            xy=_fixed(self.xy.copy()),
            confidence=_fixed(np.where(self.bad, 0.0, self.confidence)),
            by_hand=_fixed(self.edited & self.present),
            depth=depth if np.isfinite(depth).any() else None,
            turn=_fixed(self.turn.copy()) if self.locked.any() else None,
        )


@lru_cache(maxsize=4)  # An edit writes what it has read.
def _cells(frames: tuple[int, ...], joints: tuple[int, ...], count: int) -> Int[np.ndarray, "f j"]:
    """Numbers of some keypoints among all `count` of all frames: reading by these takes a third of np.ix_."""
    return _fixed(np.array(frames)[:, None] * count + np.array(joints))


def _fixed(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
