"""The small picture of a clip that lists of clips show, and where a project keeps it. Imports no torch."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from fitting_core.files.atomic import replacing

NAME = "picture.jpg"
"""In a project's folder: it may be missing or old, and is made again on demand."""
SIZE = (96, 120)
"""Width and height in pixels: some 3 kB, of which 10,000 are 30 MB."""
GROUND = (128, 132, 138)
"""Where there is no image: neither glaring in a dark list nor in a light one."""
_QUALITY = 72


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
