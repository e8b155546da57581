"""Silhouettes of a person over a clip, at reduced size, packed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Bool, Int, UInt8

SILHOUETTE_SIDE = 256
"""Pixels of the longer side of a mask."""


def silhouette_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of the masks of an image."""
    scale = min(1.0, SILHOUETTE_SIDE / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


@dataclass(frozen=True, kw_only=True, eq=False)
class Silhouettes:
    """Of one person, a mask for each frame.

    A mask is as wide and high as the image, scaled to `silhouette_size`: the pixel at column x and row
    y of it is about the image's at ((x + 0.5) W / w - 0.5, (y + 0.5) H / h - 0.5).
    """

    packed: UInt8[np.ndarray, "T n"]
    """Each mask's pixels row by row, eight in a byte (`numpy.packbits`)."""
    size: tuple[int, int]
    """Width and height of a mask."""
    known: Bool[np.ndarray, "T"]
    """Frames with a mask; the others have no person."""

    def __post_init__(self) -> None:
        assert self.packed.shape == (len(self.known), -(-self.size[0] * self.size[1] // 8))

    @classmethod
    def of(cls, packed: Sequence[UInt8[np.ndarray, "n"] | None], size: tuple[int, int]) -> Self:
        """From a packed mask, or None, for each frame."""
        empty = np.zeros(-(-size[0] * size[1] // 8), np.uint8)
        rows = [empty if row is None else row for row in packed]
        known = np.array([row is not None for row in packed], bool)
        return cls(packed=np.stack(rows) if rows else empty[None][:0], size=size, known=known)

    def __len__(self) -> int:
        return len(self.known)

    def __getitem__(self, frames: slice | Int[np.ndarray, "n"]) -> "Silhouettes":
        return Silhouettes(packed=self.packed[frames], size=self.size, known=self.known[frames])

    def mask(self, frame: int) -> Bool[np.ndarray, "h w"] | None:
        """Of a frame; None without a person."""
        if not self.known[frame]:
            return None
        return (
            np.unpackbits(self.packed[frame], count=self.size[0] * self.size[1]).astype(bool).reshape(self.size[::-1])
        )
