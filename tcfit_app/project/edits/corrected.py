"""Keypoints as they stand after some corrections: what edits read and write."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

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

    @staticmethod
    def none(keypoints: Keypoints) -> "Corrected":
        """Detections without any correction, in arrays of their own."""
        nowhere = np.zeros(keypoints.confidence.shape, dtype=bool)
        return Corrected(
            xy=np.array(keypoints.xy, dtype=float),
            confidence=np.array(keypoints.confidence, dtype=float),
            bad=nowhere,
            edited=nowhere.copy(),
        )

    def at(self, frames: tuple[int, ...], joints: tuple[int, ...]) -> "Corrected":
        """A copy of some keypoints in some frames."""
        cells = np.ix_(frames, joints)
        return Corrected(**{name: array[cells] for name, array in vars(self).items()})

    def put(self, frames: tuple[int, ...], joints: tuple[int, ...], values: "Corrected") -> None:
        """Overwrite some keypoints in some frames, in place: a copy of a long clip for each edit would add up."""
        cells = np.ix_(frames, joints)
        for name, array in vars(self).items():
            array[cells] = getattr(values, name)

    @property
    def present(self) -> Bool[np.ndarray, "F K"]:
        """Detected or placed, and not marked bad."""
        return (self.confidence > 0) & ~self.bad

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
        return Keypoints(
            xy=self.xy,
            confidence=_fixed(np.where(self.bad, 0.0, self.confidence)),
            by_hand=_fixed(self.edited & self.present),
        )


def _fixed(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
