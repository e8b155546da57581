"""Tiny videos and images that can be decoded, other ones for other seeds."""

from pathlib import Path

import cv2
import numpy as np

_SIZE = (64, 48)


def write_video(path: Path, *, seed: int = 0, frames: int = 3, size: tuple[int, int] = _SIZE) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, size)
    for image in _images(seed, frames):
        writer.write(cv2.resize(image, size))
    writer.release()
    return path


def write_images(folder: Path, *names: str, seed: int = 0) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, image in zip(names, _images(seed, len(names)), strict=True):
        done, content = cv2.imencode(Path(name).suffix, image)
        assert done
        (folder / name).write_bytes(content.tobytes())
    return folder


def _images(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 255, (count, _SIZE[1], _SIZE[0], 3), dtype=np.uint8)
