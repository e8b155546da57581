"""Points that come into an edit from elsewhere, as it keeps them: single precision, packed."""

import zlib

import numpy as np
from jaxtyping import Float

_NUMBER = np.dtype("<f4")


def packed(numbers: Float[np.ndarray, "F K n"]) -> bytes:
    """Some numbers for each keypoint of each frame. 1,000 frames of a whole person take about a megabyte."""
    return zlib.compress(np.ascontiguousarray(numbers, _NUMBER).tobytes(), 6)


def unpacked(content: bytes, frames: int, joints: int, numbers: int) -> Float[np.ndarray, "F K n"]:
    """What was packed.

    Raises:
        ValueError: It is something else, or has another shape.
    """
    size = frames * joints * numbers * _NUMBER.itemsize
    try:
        plain = zlib.decompressobj().decompress(content, size + 1)  # no more than is wanted, whatever it holds
    except zlib.error as error:
        raise ValueError("its keypoints cannot be unpacked") from error
    if len(plain) != size:
        raise ValueError(f"it has not one position for each of {frames} frames and {joints} keypoints")
    return np.frombuffer(plain, _NUMBER).reshape(frames, joints, numbers).astype(float)
