"""Frames of a video file or of a folder of images, one at a time, in any order."""

import threading
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from fitting_core.camera import Lens
from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.lens import Straightener
from fitting_core.video.decoding import VideoFile
from fitting_core.video.frame_names import natural_key

_GREY = 96
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")


class FrameSource:
    """A video file, an image, or a folder of images in natural order (``2.png`` before ``10.png``).

    Frames come upright: a video's rotation by quarters and a photo's EXIF orientation are applied. Frames whose pixels
    are not square come as they are stored. A context manager; one thread reads at a time, others wait.

    Example:
        >>> with FrameSource(Path("walk.mp4")) as frames:
        ...     first = frames.frame(0)
    """

    def __init__(self, path: Path, *, lens: Lens | None = None) -> None:
        """Open the path, decode its first frame, and find out how many there are. Raises InputError if it does not
        exist, is not a video, or holds no image or frame.

        Quick where the container tells the times of its frames; a file without them (raw H.264) is decoded once.

        Args:
            path: Of the video, the image or the folder.
            lens: Through which it was filmed: frames come straightened. A frame of 1920 x 1080 takes 28 ms more.
        """
        if not path.exists():
            raise InputError(f"{path} does not exist; expected a video file or a folder of images.")
        if not path.is_dir():
            regular_file(path, most=None)
        images = path.is_dir() or path.suffix.lower() in IMAGE_SUFFIXES
        self.path = path
        self._lock = threading.Lock()
        self._decoder = _Images(path) if images else VideoFile(path)
        self.count = self._decoder.count
        """Number of frames that can be decoded."""
        self.declared_count = self._decoder.declared_count
        """Number of frames that a truncated file says it has; count for a whole one, whatever its header says."""
        self.frame_rate = self._decoder.frame_rate
        """Frames per second, on average where they are uneven; None for images and for files that do not say it."""
        self.declared_frame_rate = self._decoder.declared_frame_rate
        """Frames per second that the file's header says: far off in some files of uneven frames."""
        self.uneven = self._decoder.uneven
        """Whether the times between frames differ by more than half, as in many videos from phones."""
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

    def __len__(self) -> int:
        return self.count

    def frame(self, index: int) -> UInt8[np.ndarray, "H W 3"]:
        """Decode one frame as RGB. Raises InputError if there is no such frame, it is broken, or its size differs from
        the first one's."""
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
        rgb = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
        return rgb if self._straighten is None else self._straighten(rgb)

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
    declared_frame_rate: float | None = None
    uneven: bool = False
    pixel_aspect: float = 1.0

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
        content = np.fromfile(regular_file(self._files[index]), dtype=np.uint8)
        return cv2.imdecode(content, cv2.IMREAD_COLOR) if len(content) else None

    def label(self, index: int) -> str:
        return f"Image {self._files[index].name}"

    def close(self) -> None:
        pass
