"""Frames of a video file or of a folder of images, one at a time, in any order."""

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fitting_core.errors import InputError
from fitting_core.frame_names import natural_key

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")

# Decoding on costs one frame each, a seek up to a whole group of pictures (often 12 to 250 frames).
_SKIP = 12
_SAME_TIME_MS = 1.0


class _Decoder(Protocol):
    """What video files and image folders have in common."""

    declared_count: int
    """What the header says."""
    count: int
    """What can be decoded."""
    frame_rate: float | None
    stems: tuple[str, ...] | None

    @property
    def uneven(self) -> bool:
        """Whether times between frames differ."""
        ...

    def read(self, index: int) -> np.ndarray | None:
        """Frame as BGR; None if it cannot be decoded."""
        ...

    def label(self, index: int) -> str:
        """The frame in words."""
        ...

    def close(self) -> None: ...


class FrameSource:
    """A video file, an image, or a folder of images in natural order (``2.png`` before ``10.png``).

    Frames come upright: OpenCV applies a video's rotation and a photo's EXIF orientation. A context manager; one
    thread reads at a time, others wait.

    Example:
        >>> with FrameSource(Path("walk.mp4")) as frames:
        ...     first = frames.frame(0)
    """

    def __init__(self, path: Path) -> None:
        """Open the path, decode its first frame, and check that its last one is there.

        Raises:
            InputError: It does not exist, is no video, holds no image or no frame.
        """
        if not path.exists():
            raise InputError(f"{path} does not exist; expected a video file or a folder of images.")
        images = path.is_dir() or path.suffix.lower() in IMAGE_SUFFIXES
        self.path = path
        self._lock = threading.Lock()
        self._decoder: _Decoder = _Images(path) if images else _Video(path)
        first = self._decoder.read(0)
        if first is None:
            raise InputError(f"The first frame of {path} cannot be decoded; re-encode it.")
        self.size: tuple[int, int] = (first.shape[1], first.shape[0])
        """Width and height in pixels, of the upright image."""

    @property
    def count(self) -> int:
        """Number of frames that can be decoded."""
        return self._decoder.count

    @property
    def declared_count(self) -> int:
        """Number of frames that the file says it has: larger than count if it is truncated."""
        return self._decoder.declared_count

    @property
    def frame_rate(self) -> float | None:
        """Frames per second; None for images and for files that do not say it."""
        return self._decoder.frame_rate

    @property
    def uneven(self) -> bool:
        """Whether the times between frames differ by more than half, as in many videos from phones."""
        return self._decoder.uneven

    @property
    def stems(self) -> tuple[str, ...] | None:
        """Per frame, the image's file name without its suffix; None for a video."""
        return self._decoder.stems

    def __len__(self) -> int:
        return self.count

    def frame(self, index: int) -> UInt8[np.ndarray, "H W 3"]:
        """Decode one frame as RGB.

        Raises:
            InputError: There is no such frame, it is broken, or its size differs from the first one's.
        """
        self._check_index(index)
        with self._lock:
            image = self._decoder.read(index)
        where = f"{self._decoder.label(index)} of {self.path}"
        if image is None:
            raise InputError(
                f"{where} cannot be decoded ({self.count} frames in all). The file is damaged: re-encode it."
            )
        if image.shape[1::-1] != self.size:
            raise InputError(
                f"{where} is {image.shape[1]} x {image.shape[0]} pixels, but {self._decoder.label(0)} is "
                f"{self.size[0]} x {self.size[1]}; expected frames of one size. Rescale or remove it."
            )
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)

    def _check_index(self, index: int) -> None:
        if 0 <= index < self.count:
            return
        if self.count <= index < self.declared_count:
            raise InputError(
                f"Frame {index} of {self.path} is missing: the file says it has {self.declared_count} frames, but only "
                f"{self.count} can be decoded. It is truncated: copy or encode it again, or use the first {self.count}."
            )
        raise InputError(f"There is no frame {index} in {self.path}; it has frames 0 to {self.count - 1}.")

    def __iter__(self) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
        return (self.frame(index) for index in range(self.count))

    def close(self) -> None:
        """Release the file."""
        with self._lock:
            self._decoder.close()

    def __enter__(self) -> "FrameSource":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def image_files(folder: Path | None) -> tuple[Path, ...]:
    """A folder's images in natural order; none for a video or what is not there."""
    if folder is None or not folder.is_dir():
        return ()
    visible = (file for file in folder.iterdir() if not file.name.startswith("."))
    images = (file for file in visible if file.suffix.lower() in IMAGE_SUFFIXES)
    return tuple(sorted(images, key=lambda file: natural_key(file.name)))


class _Images:
    """Image files, read when asked for."""

    frame_rate: float | None = None
    uneven = False

    def __init__(self, path: Path) -> None:
        self._files = image_files(path) if path.is_dir() else (path,)
        if not self._files:
            others = sorted(file.name for file in path.iterdir() if not file.name.startswith("."))
            found = f"{len(others)} other files, such as {others[0]}" if others else "an empty folder"
            raise InputError(f"No images in {path}: found {found}; expected files in {', '.join(IMAGE_SUFFIXES)}.")
        self.count = self.declared_count = len(self._files)
        self.stems: tuple[str, ...] | None = tuple(file.stem for file in self._files)
        if self.read(0) is None:
            raise InputError(f"{self._files[0]} is not an image that can be decoded; remove or replace it.")

    def read(self, index: int) -> np.ndarray | None:
        # Not cv2.imread, which cannot open paths with special characters on Windows.
        content = np.fromfile(self._files[index], dtype=np.uint8)
        return cv2.imdecode(content, cv2.IMREAD_COLOR) if len(content) else None

    def label(self, index: int) -> str:
        return f"Image {self._files[index].name}"

    def close(self) -> None:
        pass


class _Video:
    """A video file, decoded on from the last frame or after a seek."""

    stems: tuple[str, ...] | None = None

    def __init__(self, path: Path) -> None:
        self._path = path
        self._capture = cv2.VideoCapture(str(path))
        if not self._capture.isOpened():
            raise InputError(
                f"{path} is not a video that OpenCV can open (found {path.stat().st_size} bytes). If it plays "
                "elsewhere, re-encode it as H.264 in MP4; if not, it is damaged or was not fully copied."
            )
        self._last = -1
        self.declared_count = max(0, int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)))
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.frame_rate: float | None = float(rate) if np.isfinite(rate) and rate > 0 else None
        self._times = _frame_times(path)
        self.count = self._countable()
        if self.count == 0:
            raise InputError(
                f"{path} has no frame that can be decoded (the file says it has {self.declared_count}); re-encode it."
            )

    @property
    def uneven(self) -> bool:
        steps = np.diff(self._times)
        return len(steps) > 0 and bool((np.abs(steps - np.median(steps)) > 0.5 * np.median(steps)).any())

    def _countable(self) -> int:
        """Frames that decode: the declared number if the last of them does, else all are counted."""
        if self.declared_count and self.read(self.declared_count - 1) is not None:
            return self.declared_count
        self._reopen()
        count = 0
        while self._capture.grab():
            count += 1
        self._reopen()
        return count

    def _reopen(self) -> None:
        self._capture.release()
        self._capture = cv2.VideoCapture(str(self._path))
        self._last = -1

    def read(self, index: int) -> np.ndarray | None:
        if not 0 <= index - self._last <= _SKIP:
            self._seek(index)
        image = self._decode(index)
        if image is None:
            # Seeking can fail where decoding from the start does not: back in an AVI of one frame, for example.
            self._reopen()
            image = self._decode(index)
        return image

    def _decode(self, index: int) -> np.ndarray | None:
        while self._last < index:
            if not self._capture.grab():
                return None
            self._last += 1
        ok, image = self._capture.retrieve()
        return image if ok else None

    def _seek(self, index: int) -> None:
        """Go to a frame or to one shortly before it; back to the start if its place cannot be told.

        OpenCV takes frames for evenly spaced when it seeks, which phones' are not: it then lands next to the frame
        that was asked for and says nothing. So the frame's time tells where it is, and the time of what was decoded
        after the seek tells which frame that is.
        """
        if index < len(self._times) and self.frame_rate:
            even = round((self._times[index] - self._times[0]) / 1000 * self.frame_rate)
            for margin in (0, _SKIP, 4 * _SKIP):
                self._capture.set(cv2.CAP_PROP_POS_FRAMES, max(0, even - margin))
                if self._capture.grab():
                    offsets = np.abs(self._times - self._capture.get(cv2.CAP_PROP_POS_MSEC))
                    self._last = int(offsets.argmin())
                    if self._last <= index and offsets.min() < _SAME_TIME_MS:
                        return
        self._reopen()

    def label(self, index: int) -> str:
        return f"Frame {index}"

    def close(self) -> None:
        self._capture.release()


def _frame_times(path: Path) -> Float[np.ndarray, "T"]:
    """When each frame is shown, in milliseconds, from the container alone: 30,000 frames take a tenth of a second.

    Empty if OpenCV's backend cannot read a file without decoding it.
    """
    packets = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    times = []
    while packets.grab():
        times.append(packets.get(cv2.CAP_PROP_POS_MSEC))
    packets.release()
    return np.sort(np.array(times, dtype=float))  # Packets come in the order of decoding.
