"""Writes H.264 videos, which all browsers play; the file appears only when it is whole."""

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.container import OutputContainer
from jaxtyping import UInt8

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing

SUFFIX = ".mp4"
CODEC = "libx264"


class VideoWriter:
    """Takes the RGB frames of one video, in order."""

    def __init__(self, container: OutputContainer, size: tuple[int, int], frame_rate: float) -> None:
        self._container, self._shape = container, (size[1], size[0], 3)
        rate = Fraction(frame_rate).limit_denominator(10**6)
        self._stream = container.add_stream(CODEC, rate=rate, options={"preset": "veryfast", "crf": "20"})
        self._stream.width, self._stream.height, self._stream.pix_fmt = *size, "yuv420p"

    def write(self, frame: UInt8[np.ndarray, "H W 3"]) -> None:
        """One more frame. Raises OSError if it cannot be written, for instance on a full disk."""
        assert frame.shape == self._shape and frame.dtype == np.uint8
        self._container.mux(self._stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))

    def finish(self) -> None:
        """Flush the encoder."""
        self._container.mux(self._stream.encode())


def can_encode() -> bool:
    """Whether this computer's PyAV was built with the encoder; those from PyPI are."""
    return CODEC in av.codecs_available


@contextmanager
def video_writer(path: Path, size: tuple[int, int], frame_rate: float) -> Iterator[VideoWriter]:
    """Write RGB frames of `size` (even width and height, pixels) to an mp4 file; the caller writes at least one frame.

    The file is written under a temporary name in the same folder and renamed when the block ends well; if the block
    raises, nothing is left and an older file of that name stays.

    Args:
        path: Target; its suffix must be .mp4.
        size: Width and height.
        frame_rate: Frames per second.

    Raises:
        InputError: The path has another suffix, its folder is missing, or there is no encoder.
        OSError: Writing failed, for instance on a full disk.
    """
    assert size[0] % 2 == 0 and size[1] % 2 == 0, "encoders halve the resolution of colour"
    if path.suffix.lower() != SUFFIX:
        raise InputError(f"Videos are written as {SUFFIX}, but the name is {path.name}: end it in {SUFFIX}.")
    if not path.parent.is_dir():
        raise InputError(f"The folder {path.parent} for the video {path.name} does not exist: create it first.")
    if not can_encode():
        raise InputError(f"This computer's PyAV cannot write H.264 ({CODEC}): reinstall it with `pip install av`.")
    with replacing(path) as draft, av.open(f"file:{draft}", "w", options={"movflags": "faststart"}) as container:
        writer = VideoWriter(container, size, frame_rate)
        yield writer
        writer.finish()
