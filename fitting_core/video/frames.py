"""Frames of a video file or of a folder of images, one at a time, in any order."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from fitting_core.camera import Lens
from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.lens import Straightener
from fitting_core.video.decoding import VideoFile
from fitting_core.video.images import IMAGE_SUFFIXES, Images, spread

_GREY = 96
OnFrame = Callable[[int, UInt8[np.ndarray, "H W 3"]], None]
"""Receives the number and the picture of a frame."""


class FrameSource:
    """A video file, an image, or a folder of images in natural order (``2.png`` before ``10.png``).

    Frames come upright: a video's rotation by quarters and a photo's EXIF orientation are applied. Frames whose pixels
    are not square come as they are stored. A context manager; one thread reads at a time, others wait.

    Example:
        >>> with FrameSource(Path("walk.mp4")) as frames:
        ...     first = frames.frame(0)
    """

    def __init__(
        self,
        path: Path,
        *,
        lens: Lens | None = None,
        on_frame: OnFrame | None = None,
    ) -> None:
        """Open the path, decode its first frame, and find out how many there are. Raises InputError if it does not
        exist, is not a video, or holds no image or frame.

        Quick where the container tells the times of its frames; a file without them (raw H.264) is decoded once.

        Args:
            path: Of the video, the image or the folder.
            lens: Through which it was filmed: frames come straightened. A frame of 1920 x 1080 takes 28 ms more.
            on_frame: Receives each frame that is decoded, in the thread that asks for it.
        """
        if not path.exists():
            raise InputError(f"{path} does not exist; expected a video file or a folder of images.")
        if not path.is_dir():
            regular_file(path, most=None)
        images = path.is_dir() or path.suffix.lower() in IMAGE_SUFFIXES
        self.path = path
        self._lock = threading.Lock()
        self._decoder = Images(path) if images else VideoFile(path)
        self.count = self._decoder.count
        """Number of frames that can be decoded."""
        self.declared_count = self._decoder.declared_count
        """Number of frames that a truncated file's header states; the real count for a whole file."""
        self.frame_rate = self._decoder.frame_rate
        """Frames per second, on average where they are uneven; None for images and for files that do not say it."""
        self.declared_frame_rate = self._decoder.declared_frame_rate
        """Frames per second of the file's header: far off in some files with uneven frames."""
        self.uneven = self._decoder.uneven
        """Whether the times between frames differ by more than half, as in many videos from phones."""
        self.times = self._decoder.times
        """Of uneven frames, seconds from the first."""
        self.pixel_aspect = self._decoder.pixel_aspect
        """Width by height of a pixel of the upright image, as the file tells it: not 1 in anamorphic videos."""
        self.stems: tuple[str, ...] | None = self._decoder.stems
        """Per frame, the image's file name without its suffix; None for a video."""
        first = self._decoder.read(0)
        if first is None:
            raise InputError(f"The first frame of {path} cannot be decoded; re-encode it.")
        self.size: tuple[int, int] = (first.shape[1], first.shape[0])
        """Width and height in pixels, of the upright image."""
        self._straighten = None if lens is None else Straightener(lens, self.size)
        self._on_frame = on_frame

    def __len__(self) -> int:
        return self.count

    def frame(self, index: int) -> UInt8[np.ndarray, "H W 3"]:
        """Decode one frame as RGB, scaled to the first one's size. Raises InputError if it is missing or broken."""
        self._check_index(index)
        where = f"{self._decoder.label(index)} of {self.path}"
        try:
            with self._lock:
                image = self._decoder.read(index)
        except OSError as error:
            raise InputError(f"{where} cannot be read now ({error.strerror or error}).") from error
        if image is None:
            raise InputError(
                f"{where} cannot be decoded ({self.count} frames in all). The file is damaged: re-encode it."
            )
        if image.shape[1::-1] != self.size:
            image = _fitted(image, self.size)
        rgb = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
        rgb = rgb if self._straighten is None else self._straighten(rgb)
        if self._on_frame is not None:
            self._on_frame(index, rgb)
        return rgb

    def notes(self) -> list[str]:
        """What a user should know about the pictures, in sentences: sizes that differ, and what images hold. Found in
        some, spread over the clip, of which a video's are key frames."""
        with self._lock:
            looked_at = spread(self.count)
            others = sorted(self._decoder.sizes(looked_at) - {self.size})
            notes = self._decoder.notes(looked_at)
        if others:
            found, (width, height) = ", ".join(f"{w} x {h}" for w, h in others), self.size
            notes.append(
                f"The picture size of {self.path.name} changes: some are {found}. They are scaled to {width} x "
                f"{height}, the size of the first, and so must be the keypoints of another detector."
            )
        return notes

    def frame_or_grey(self, index: int) -> UInt8[np.ndarray, "H W 3"]:
        """One frame as RGB, or plain grey where it is broken, so that playback and detection can continue. Raises
        InputError if there is no such frame."""
        self._check_index(index)
        try:
            return self.frame(index)
        except InputError:
            return np.full((self.size[1], self.size[0], 3), _GREY, np.uint8)

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


def _fitted(image: UInt8[np.ndarray, "h w 3"], size: tuple[int, int]) -> UInt8[np.ndarray, "H W 3"]:
    """A picture scaled to fit into a frame, in its middle; grey beside it if it has another shape."""
    height, width = image.shape[:2]
    scale = min(size[0] / width, size[1] / height)
    scaled = (max(1, round(scale * width)), max(1, round(scale * height)))
    image = cv2.resize(image, scaled, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    if scaled == size:
        return image
    fitted = np.full((size[1], size[0], 3), _GREY, np.uint8)
    left, top = (size[0] - scaled[0]) // 2, (size[1] - scaled[1]) // 2
    fitted[top : top + scaled[1], left : left + scaled[0]] = image
    return fitted
