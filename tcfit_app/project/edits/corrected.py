"""Keypoints with some corrections applied: what edits read and write."""

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
"""Everything about one keypoint in one frame, in 64 bytes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrected:
    """Some keypoints in some frames: a whole clip, or those that one edit changes."""

    records: Shaped[np.ndarray, "F K"]
    """Array of `_RECORD`: an edit reads and writes all fields of a few keypoints in a few frames."""

    def __getitem__(self, cells: Any) -> "Corrected":
        """A subset, indexed like an array. What is derived from several fields takes a while for a long clip."""
        return Corrected(records=self.records[cells])

    @staticmethod
    def none(keypoints: Keypoints) -> "Corrected":
        """Detections without corrections, in their own array."""
        return Corrected.as_detected(keypoints.xy, keypoints.confidence)

    @staticmethod
    def as_detected(xy: Float[np.ndarray, "F K 2"], confidence: Float[np.ndarray, "F K"]) -> "Corrected":
        """Keypoints as detected, in their own array."""
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
        """0 (not detected) to 1; for a keypoint marked bad, the value it has once restored."""
        return self.records["confidence"]

    @property
    def bad(self) -> Bool[np.ndarray, "F K"]:
        """Marked bad by a person."""
        return self.records["bad"]

    @property
    def edited(self) -> Bool[np.ndarray, "F K"]:
        """Position, side or confidence come from a person, not from the detector."""
        return self.records["edited"]

    @property
    def depth(self) -> Float[np.ndarray, "F K"]:
        """As in Keypoints; for a keypoint marked bad, the value it has once restored."""
        return self.records["depth"]

    @property
    def turn(self) -> Float32[np.ndarray, "F K 3"]:
        """As in Keypoints; also for a keypoint marked bad, because it belongs to the body."""
        return self.records["turn"]

    @property
    def key(self) -> Bool[np.ndarray, "F K"]:
        """A person set a keyframe: frames between two of them are interpolated."""
        return self.records["key"]

    @property
    def pinned(self) -> Bool[np.ndarray, "F K"]:
        """A person pinned it in space, in these and other frames, and has not edited it since."""
        return self.records["pinned"]

    @property
    def shift(self) -> Float[np.ndarray, "F K 2"]:
        """Its displacement by keyframes, pixels: `xy - shift` is the position without them, (0, 0) if it is missing."""
        return self.records["shift"]

    def at(self, frames: tuple[int, ...], joints: tuple[int, ...]) -> "Corrected":
        """A copy of some keypoints in some frames."""
        return Corrected(records=self.records.reshape(-1).take(_cells(frames, joints, self.records.shape[1])))

    def put(self, frames: tuple[int, ...], joints: tuple[int, ...], values: "Corrected") -> None:
        """Overwrite some keypoints in some frames, in place: copying a long clip for each edit would add up."""
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
        """A person locked the joint's rotation."""
        return np.isfinite(self.turn[..., 0])

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        return self.records.nbytes

    @property
    def view(self) -> "Corrected":
        """A read-only view of the same keypoints, which reflects later changes."""
        return Corrected(records=read_only(self.records))

    @property
    def touched(self) -> Bool[np.ndarray, "F K"]:
        """A person has edited it in any way."""
        return self.edited | np.isfinite(self.depth) | self.locked

    def keypoints(self) -> Keypoints:
        """The keypoints to fit: confidence 0 for those marked bad. In their own read-only arrays."""
        return _keypoints(*self._fitted())

    def _fitted(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        confidence = np.where(self.bad, 0.0, self.confidence)
        return self.xy.copy(), confidence, self.edited & self.present, self.told_depth, self.turn.copy()

    def put_into(self, before: Keypoints, frames: list[int]) -> Keypoints:
        """Update `before`, an earlier result of `keypoints` for a clip, with these as some of its frames.

        Copying plain arrays takes a tenth of the time of recomputing a whole clip.
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
    """With depths and turns only if any are set."""
    return Keypoints(
        xy=_fixed(xy),
        confidence=_fixed(confidence),
        by_hand=_fixed(by_hand),
        depth=_fixed(depth) if np.isfinite(depth).any() else None,
        turn=_fixed(turn) if np.isfinite(turn[..., 0]).any() else None,
    )


@lru_cache(maxsize=4)  # an edit writes the cells that it has read
def _cells(frames: tuple[int, ...], joints: tuple[int, ...], count: int) -> Int[np.ndarray, "f j"]:
    """Flat indices of some keypoints in some frames, `count` per frame: indexing by them takes a third of np.ix_'s
    time."""
    return _fixed(np.array(frames)[:, None] * count + np.array(joints, int))


def read_only(array: np.ndarray) -> np.ndarray:
    """A read-only view of an array."""
    return _fixed(array.view())


def _fixed(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
