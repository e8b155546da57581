"""Keypoints of one person as an edit of another's project keeps them: single precision, packed."""

import zlib

import numpy as np
from jaxtyping import Bool, Float

_NUMBER = np.dtype("<f4")


def packed(
    xy: Float[np.ndarray, "F K 2"], confidence: Float[np.ndarray, "F K"], by_hand: Bool[np.ndarray, "F K"]
) -> bytes:
    """Positions in pixels, confidences, and what a person has placed. 1,000 frames take about a megabyte."""
    values = np.concatenate([xy, confidence[..., None], by_hand[..., None]], -1)
    return zlib.compress(np.ascontiguousarray(values, _NUMBER).tobytes(), 6)


def unpacked(content: bytes, frames: int, joints: int) -> Float[np.ndarray, "F K 4"]:
    """What was packed.

    Raises:
        ValueError: It is something else, or of another number of frames or keypoints.
    """
    size = frames * joints * 4 * _NUMBER.itemsize
    try:
        plain = zlib.decompressobj().decompress(content, size + 1)  # no more than is wanted, whatever it holds
    except zlib.error as error:
        raise ValueError("its keypoints cannot be unpacked") from error
    if len(plain) != size:
        raise ValueError(f"it has not one position for each of {frames} frames and {joints} keypoints")
    return np.frombuffer(plain, _NUMBER).reshape(frames, joints, 4).astype(float)
