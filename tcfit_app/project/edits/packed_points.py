"""Points stored in an edit: single precision, compressed."""

import zlib

import numpy as np
from jaxtyping import Float

_NUMBER = np.dtype("<f4")
_MOST_RATIO = 1100
"""Deflate compresses at most 1032-fold."""


def packed(numbers: Float[np.ndarray, "F K n"]) -> bytes:
    """Compress some numbers per keypoint and frame. 1,000 frames of a whole person take about a megabyte."""
    return zlib.compress(np.ascontiguousarray(numbers, _NUMBER).tobytes(), 6)


def unpacked(content: bytes, frames: int, joints: int, numbers: int) -> Float[np.ndarray, "F K n"]:
    """Decompress them.

    Raises:
        ValueError: They are invalid, or have another shape.
    """
    size = frames * joints * numbers * _NUMBER.itemsize
    try:  # no more than expected, for any content
        plain = zlib.decompressobj().decompress(content, min(size, _MOST_RATIO * len(content)) + 1)
    except zlib.error as error:
        raise ValueError("its keypoints cannot be unpacked") from error
    if len(plain) != size:
        raise ValueError(f"it does not have one position for each of {frames} frames and {joints} keypoints")
    return np.frombuffer(plain, _NUMBER).reshape(frames, joints, numbers).astype(float)
