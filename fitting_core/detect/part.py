"""The interface of detectors, and their result for consecutive frames."""

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np
from jaxtyping import Float, Int, UInt8

if TYPE_CHECKING:  # OpenCV would take a tenth of a second of every start of tcfit
    from fitting_core.video.frames import FrameSource


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """All people in consecutive frames."""

    people: tuple[Float[np.ndarray, "P 137 3"], ...]
    """Of each frame, its people: x, y in pixels and confidence (0 to 1); (0, 0, 0) for what was not found."""
    numbers: tuple[Int[np.ndarray, "P"], ...]
    """Of each frame, who its people are, as far as the detector follows them itself: the same number in other frames
    is the same person."""
    silhouettes: tuple[UInt8[np.ndarray, "P n"], ...]
    """Of each frame, what its people cover of the image, which is scaled to `silhouette_size`: row by row, eight pixels
    in a byte (`numpy.packbits`). n is 0 from detectors that find none."""
    memory: Mapping[str, np.ndarray] = field(default_factory=dict)
    """The detector's state after the last frame."""

    def __len__(self) -> int:
        return len(self.people)


class Detector(Protocol):
    """Finds the keypoints of all people in a clip."""

    @property
    def name(self) -> str:
        """In `DETECTORS`, or the file that was given."""
        ...

    @property
    def points(self) -> str:
        """Whose points they are like, for their noise: "mediapipe" or "coco-wholebody"."""
        ...

    @property
    def version(self) -> str:
        """Changes whenever the detector would find something different in the same images."""
        ...

    def part_length(self, size: tuple[int, int]) -> int:
        """How many frames of a size go together into a part."""
        ...

    def detect(
        self, source: "FrameSource", parts: Sequence[range], memory: Mapping[str, np.ndarray]
    ) -> Generator[int | Part, None, None]:
        """Go through consecutive frames.

        Args:
            source: Of the frames.
            parts: Their numbers, part by part.
            memory: Of the part before the first; empty at the start.

        Yields:
            How many frames are done so far, and each part when it is complete. It can be closed at any time.
        """
        ...
