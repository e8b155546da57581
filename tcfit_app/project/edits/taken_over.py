"""Keypoints of one person as an edit of another's project keeps them: single precision, packed."""

import zlib

import numpy as np
from jaxtyping import Float

_NUMBER = np.dtype("<f4")


def packed(xy: Float[np.ndarray, "F K 2"], confidence: Float[np.ndarray, "F K"]) -> bytes:
    """Positions in pixels with confidences. 1,000 frames of all keypoints take about a megabyte."""
    values = np.concatenate([xy, confidence[..., None]], -1)
    return zlib.compress(np.ascontiguousarray(values, _NUMBER).tobytes(), 6)


def unpacked(content: bytes, frames: int, joints: int) -> Float[np.ndarray, "F K 3"]:
    """What was packed.

    Raises:
        ValueError: It is something else, or of another number of frames or keypoints.
    """
    size = frames * joints * 3 * _NUMBER.itemsize
    try:
        plain = zlib.decompressobj().decompress(content, size + 1)  # no more than is wanted, whatever it holds
    except zlib.error as error:
        raise ValueError("its keypoints cannot be unpacked") from error
    if len(plain) != size:
        raise ValueError(f"it has not one position for each of {frames} frames and {joints} keypoints")
    return np.frombuffer(plain, _NUMBER).reshape(frames, joints, 3).astype(float)
