"""Keypoints as they stand after some corrections: what edits read and write."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from fitting_core.keypoints import Keypoints


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrected:
    """Some keypoints of some frames: all of a clip, or those that one edit touches."""

    xy: Float[np.ndarray, "F K 2"]
    """Pixels, as in Keypoints."""
    confidence: Float[np.ndarray, "F K"]
    """0 (not detected) to 1; of a keypoint marked bad what it has once it is restored."""
    bad: Bool[np.ndarray, "F K"]
    """Marked as wrong by a person."""
    edited: Bool[np.ndarray, "F K"]
    """Position, side or confidence come from a person and not from the detector."""
    depth: Float[np.ndarray, "F K"]
    """As in Keypoints; of a keypoint marked bad what counts once it is restored."""
    turn: Float32[np.ndarray, "F K 3"]
    """As in Keypoints; of a keypoint marked bad too, for it is the body's."""
    key: Bool[np.ndarray, "F K"]
    """A person has put it there as a keyframe: the frames between two of them follow both."""
    shift: Float[np.ndarray, "F K 2"]
    """How far keyframes have moved it, pixels: `xy - shift` is where it would be without them, (0, 0) if nowhere."""

    @staticmethod
    def none(keypoints: Keypoints) -> "Corrected":
        """Detections without any correction, in arrays of their own."""
        nowhere = np.zeros(keypoints.confidence.shape, dtype=bool)
        return Corrected(
            xy=np.array(keypoints.xy, dtype=float),
            confidence=np.array(keypoints.confidence, dtype=float),
            bad=nowhere,
            edited=nowhere.copy(),
            depth=np.full(nowhere.shape, np.nan),
            turn=np.full((*nowhere.shape, 3), np.nan, np.float32),
            key=nowhere.copy(),
            shift=np.zeros((*nowhere.shape, 2)),
        )

    def at(self, frames: tuple[int, ...], joints: tuple[int, ...]) -> "Corrected":
        """A copy of some keypoints in some frames."""
        cells = self._cells(frames, joints)
        return Corrected(**{name: _flat(array).take(cells, axis=0) for name, array in vars(self).items()})

    def put(self, frames: tuple[int, ...], joints: tuple[int, ...], values: "Corrected") -> None:
        """Overwrite some keypoints in some frames, in place: a copy of a long clip for each edit would add up."""
        cells = self._cells(frames, joints)
        for name, array in vars(self).items():
            _flat(array)[cells] = getattr(values, name)

    def _cells(self, frames: tuple[int, ...], joints: tuple[int, ...]) -> np.ndarray:
        """Numbers of some keypoints in the arrays that `_flat` gives: reading by these takes a third of np.ix_."""
        return np.array(frames)[:, None] * self.confidence.shape[1] + np.array(joints)

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
        return sum(array.nbytes for array in vars(self).values())

    def frozen(self) -> "Corrected":
        """A copy that nobody can write to."""
        return Corrected(**{name: _fixed(array.copy()) for name, array in vars(self).items()})

    def keypoints(self) -> Keypoints:
        """What is fitted, of values that are `frozen`: a keypoint marked bad has confidence 0."""
        assert not self.xy.flags.writeable
        depth = _fixed(self.told_depth)
        return Keypoints(
            xy=self.xy,
            confidence=_fixed(np.where(self.bad, 0.0, self.confidence)),
            by_hand=_fixed(self.edited & self.present),
            depth=depth if np.isfinite(depth).any() else None,
            turn=self.turn if self.locked.any() else None,
        )


def _flat(array: np.ndarray) -> np.ndarray:
    """All keypoints of all frames in one row, without copying them where they are those of the whole clip."""
    return array.reshape(-1, *array.shape[2:])


def _fixed(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
