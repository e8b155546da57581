"""Tiny videos and images that can be decoded, other ones for other seeds."""

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

_SIZE = (64, 48)


def write_film(path: Path, images: Iterable[np.ndarray], *, frame_rate: float = 25.0) -> Path:
    """A video of some images (BGR), each compressed by itself if its name ends in .avi."""
    first, *others = images
    codec = "MJPG" if path.suffix == ".avi" else "mp4v"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), frame_rate, first.shape[1::-1])
    for image in (first, *others):
        writer.write(image)
    writer.release()
    return path


def write_video(path: Path, *, seed: int = 0, frames: int = 3, size: tuple[int, int] = _SIZE) -> Path:
    return write_film(path, (cv2.resize(image, size) for image in _images(seed, frames)))


def write_images(folder: Path, *names: str, seed: int = 0, size: tuple[int, int] = _SIZE) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, image in zip(names, _images(seed, len(names)), strict=True):
        done, content = cv2.imencode(Path(name).suffix, cv2.resize(image, size))
        assert done
        (folder / name).write_bytes(content.tobytes())
    return folder


def _images(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 255, (count, _SIZE[1], _SIZE[0], 3), dtype=np.uint8)
