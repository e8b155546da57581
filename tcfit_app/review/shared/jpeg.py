"""Frames of a video as JPEGs, in the sizes in which a view shows them."""

from typing import Literal, get_args

import cv2
import numpy as np
from jaxtyping import UInt8

FrameSize = Literal["playing", "full"]
"""Small, for frames that follow each other quickly; or every pixel of the video."""
SIZES: tuple[FrameSize, ...] = get_args(FrameSize)
PLAYING = (960, 540)
"""Most pixels of a playing frame; an upright one has them the other way round."""
_QUALITY = {"playing": 80, "full": 85}
_GREY = 96


def shown_size(size: tuple[int, int], shown: FrameSize) -> tuple[int, int]:
    """Width and height in pixels of a JPEG, for a video of `size`: never larger, of the same shape."""
    if shown == "full":
        return size
    wide, high = max(PLAYING), min(PLAYING)
    most = (wide, high) if size[0] >= size[1] else (high, wide)
    scale = min(1.0, most[0] / size[0], most[1] / size[1])
    return max(1, round(scale * size[0])), max(1, round(scale * size[1]))


def encoded(image: UInt8[np.ndarray, "H W 3"], shown: FrameSize) -> bytes:
    """A frame (RGB) as JPEG."""
    size = shown_size((image.shape[1], image.shape[0]), shown)
    if size != (image.shape[1], image.shape[0]):
        # Linear, not by area: 2 against 20 ms where 1080p shrinks by a factor that is no whole number.
        image = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)
    done, jpeg = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY[shown]])
    assert done, "OpenCV has no JPEG encoder"
    return jpeg.tobytes()


def placeholder(size: tuple[int, int], shown: FrameSize) -> bytes:
    """A grey frame in the place of one that cannot be shown."""
    width, height = shown_size(size, shown)
    return encoded(np.full((height, width, 3), _GREY, np.uint8), "full")
