"""The small picture of a clip that lists of clips show, and where a project keeps it. Imports no torch."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fitting_core.files.atomic import replacing

NAME = "picture.jpg"
"""In a project's folder: it may be missing or old, and is made again on demand."""
SIZE = (96, 120)
"""Width and height in pixels: some 3 kB, of which 10,000 are 30 MB."""
_QUALITY = 72


def crop_around(
    points: Float[np.ndarray, "n 2"], size: tuple[int, int], *, shape: float, margin: float = 1.0, least: float = 0.0
) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the part of an image around some points, within the image.

    Args:
        points: At least one, pixels.
        size: Of the image, width and height.
        shape: Width of the part / its height.
        margin: Height of the part / that of the points.
        least: Minimum height, pixels.
    """
    low, high = points.min(0), points.max(0)
    tall = max(margin * max(high[1] - low[1], (high[0] - low[0]) / shape), least)
    height = min(tall, size[1], size[0] / shape)
    width = min(shape * height, size[0])
    left, top = np.clip((low + high) / 2 - (width / 2, height / 2), 0, (size[0] - width, size[1] - height))
    return int(left), int(top), int(left + width), int(top + height)


def as_jpeg(image: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """An RGB image of the same proportions, made that small."""
    small = cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", small[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return data.tobytes()


def keep(path: Path, jpeg: bytes) -> None:
    """Write it; its folder is made. Raises OSError if it cannot be written."""
    path.parent.mkdir(exist_ok=True)
    with replacing(path) as draft:
        draft.write_bytes(jpeg)
