"""Writes videos: the first encoder that is there, a file that appears only when it is whole."""

import functools
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from jaxtyping import UInt8

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing

SUFFIX = ".mp4"


class Encoder(Protocol):
    """Takes the frames of one video, in order."""

    def write(self, frame: UInt8[np.ndarray, "H W 3"]) -> None:
        """One RGB frame."""

    def close(self) -> None:
        """Finish the file. Raises OSError if it could not be written."""


class _OpenCV:
    def __init__(self, writer: cv2.VideoWriter) -> None:
        self._writer = writer

    def write(self, frame: np.ndarray) -> None:
        self._writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))

    def close(self) -> None:
        self._writer.release()


class _Ffmpeg:
    def __init__(self, command: list[str]) -> None:
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)

    def write(self, frame: np.ndarray) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(frame).tobytes())
        except BrokenPipeError as error:
            self.close()
            raise OSError("ffmpeg ended before the video did") from error

    def close(self) -> None:
        if self._process.returncode is not None:
            return
        _, said = self._process.communicate()
        if self._process.returncode != 0:
            reason = said.decode(errors="replace").strip() or "no message"
            raise OSError(f"ffmpeg ended with status {self._process.returncode}: {reason.splitlines()[-1]}")


@functools.cache
def _ffmpeg_with_h264() -> str | None:
    """The ffmpeg on PATH if it was built with libx264."""
    ffmpeg = shutil.which("ffmpeg")
    if ffmpeg is None:
        return None
    listed = subprocess.run([ffmpeg, "-hide_banner", "-encoders"], capture_output=True, text=True)
    return ffmpeg if " libx264 " in listed.stdout else None


def _open_ffmpeg(path: Path, size: tuple[int, int], frame_rate: float) -> Encoder | None:
    ffmpeg = _ffmpeg_with_h264()
    if ffmpeg is None:
        return None
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-r", f"{frame_rate:.6f}", "-i", "-"]
    target = ["-an", "-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-pix_fmt", "yuv420p"]
    return _Ffmpeg([ffmpeg, "-y", "-loglevel", "error", *source, *target, "-movflags", "+faststart", str(path)])


def _open_opencv(fourcc: str, path: Path, size: tuple[int, int], frame_rate: float) -> Encoder | None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*fourcc), frame_rate, size)
    return _OpenCV(writer) if writer.isOpened() else None


def _open_avc1(path: Path, size: tuple[int, int], frame_rate: float) -> Encoder | None:
    # pip's OpenCV has no H.264 encoder on Linux, and prints ten lines of complaint when it is asked for one.
    return None if sys.platform == "linux" else _open_opencv("avc1", path, size, frame_rate)


ENCODERS: dict[str, Callable[[Path, tuple[int, int], float], Encoder | None]] = {
    "ffmpeg": _open_ffmpeg,
    "avc1": _open_avc1,
    "vp09": functools.partial(_open_opencv, "vp09"),
    "mp4v": functools.partial(_open_opencv, "mp4v"),
}
"""Ways to write an mp4 file, best first. Browsers play all but the last (MPEG-4 part 2), which is the fastest by far:
4 ms for a frame of 1280 x 720, where VP9 through OpenCV takes 360 ms."""


@contextmanager
def video_writer(
    path: Path, size: tuple[int, int], frame_rate: float, *, encoders: Sequence[str] = tuple(ENCODERS)
) -> Iterator[Encoder]:
    """Write RGB frames of `size` (even width and height, pixels) to an mp4 file; the caller writes at least one frame.

    The file is written under a temporary name in the same folder and renamed when the block ends well; if the block
    raises, nothing is left and an older file of that name stays.

    Args:
        path: Target; its suffix must be .mp4.
        size: Width and height.
        frame_rate: Frames per second.
        encoders: Names from ENCODERS, tried in this order.

    Raises:
        InputError: The path has another suffix, its folder is missing, or no encoder works.
        OSError: Writing failed, for instance on a full disk.
    """
    _check(path, size)
    with replacing(path) as temporary:
        encoder = _CountingEncoder(_open(temporary, size, frame_rate, encoders), size)
        try:
            yield encoder
        finally:
            encoder.close()
        _check_written(temporary, encoder.count)


class _CountingEncoder:
    """Passes frames on and counts them; OpenCV would silently drop a frame of another size."""

    def __init__(self, encoder: Encoder, size: tuple[int, int]) -> None:
        self._encoder, self._shape, self.count = encoder, (size[1], size[0], 3), 0

    def write(self, frame: np.ndarray) -> None:
        assert frame.shape == self._shape and frame.dtype == np.uint8
        self._encoder.write(frame)
        self.count += 1

    def close(self) -> None:
        self._encoder.close()


def _check(path: Path, size: tuple[int, int]) -> None:
    assert size[0] % 2 == 0 and size[1] % 2 == 0, "encoders halve the resolution of colour"
    if path.suffix.lower() != SUFFIX:
        raise InputError(f"Videos are written as {SUFFIX}, but the name is {path.name}: end it in {SUFFIX}.")
    if not path.parent.is_dir():
        raise InputError(f"The folder {path.parent} for the video {path.name} does not exist: create it first.")


def _open(path: Path, size: tuple[int, int], frame_rate: float, encoders: Sequence[str]) -> Encoder:
    for name in encoders:
        encoder = ENCODERS[name](path, size, frame_rate)
        if encoder is not None:
            return encoder
    raise InputError(
        f"No video encoder works here (tried {', '.join(encoders)}). Install ffmpeg with libx264 "
        "(`apt-get install ffmpeg`) or an opencv-python-headless from PyPI, which can write VP9 and MPEG-4."
    )


def _check_written(path: Path, count: int) -> None:
    """OpenCV reports no failed write, so the file's own frame count is compared."""
    capture = cv2.VideoCapture(str(path))
    found = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
    capture.release()
    if found != count:
        raise OSError(f"The video should hold {count} frames, but {found} were written: is the disk full?")
