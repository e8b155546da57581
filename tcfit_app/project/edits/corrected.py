"""Keypoints as they stand after some corrections: what edits read and write."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

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

    def __getitem__(self, cells: Any) -> "Corrected":
        """Some of them, as of an array. What is worked out of several fields takes a while for those of a long clip."""
        return Corrected(records=self.records[cells])

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

    @property
    def view(self) -> "Corrected":
        """The same keypoints for somebody who cannot write to them, and sees what is written later."""
        return Corrected(records=read_only(self.records))

    @property
    def told(self) -> Bool[np.ndarray, "F K"]:
        """A person has said something of it."""
        return self.edited | np.isfinite(self.depth) | self.locked

    def keypoints(self) -> Keypoints:
        """What is fitted: a keypoint marked bad has confidence 0. In arrays of their own, which nobody can write to."""
        return _keypoints(*self._fitted())

    def _fitted(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        confidence = np.where(self.bad, 0.0, self.confidence)
        return self.xy.copy(), confidence, self.edited & self.present, self.told_depth, self.turn.copy()

    def put_into(self, before: Keypoints, frames: list[int]) -> Keypoints:
        """What `keypoints` gives for a clip that had given `before`, since these became some of its frames.

        It copies plain arrays, which takes a tenth of going through all that is known of a whole clip.
        """
        nowhere = np.full((*before.confidence.shape, 3), np.nan, np.float32)
        turn = nowhere if before.turn is None else before.turn.copy()
        arrays = before.xy.copy(), before.confidence.copy(), before.placed.copy(), before.told_depth.copy(), turn
        for array, part in zip(arrays, self._fitted(), strict=True):
            array[frames] = part
        return _keypoints(*arrays)


def _keypoints(
    xy: np.ndarray, confidence: np.ndarray, by_hand: np.ndarray, depth: np.ndarray, turn: np.ndarray
) -> Keypoints:
    """With what is told of depths and turns only where something is."""
    return Keypoints(
        xy=_fixed(xy),
        confidence=_fixed(confidence),
        by_hand=_fixed(by_hand),
        depth=_fixed(depth) if np.isfinite(depth).any() else None,
        turn=_fixed(turn) if np.isfinite(turn[..., 0]).any() else None,
    )


@lru_cache(maxsize=4)  # An edit writes what it has read.
def _cells(frames: tuple[int, ...], joints: tuple[int, ...], count: int) -> Int[np.ndarray, "f j"]:
    """Numbers of some keypoints among all `count` of all frames: reading by these takes a third of np.ix_."""
    return _fixed(np.array(frames)[:, None] * count + np.array(joints))


def read_only(array: np.ndarray) -> np.ndarray:
    """The same array for somebody who cannot write to it."""
    return _fixed(array.view())


def _fixed(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
