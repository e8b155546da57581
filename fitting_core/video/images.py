"""Images: one, or a folder of them; their headers are read before their pixels."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import BmpImagePlugin, ExifTags, JpegImagePlugin, PngImagePlugin, TiffImagePlugin, WebPImagePlugin
from PIL.Image import Exif
from PIL.ImageFile import ImageFile

from fitting_core.errors import InputError
from fitting_core.files.regular import most_unpacked, regular_file
from fitting_core.video.frame_names import natural_key

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
# Opened as these classes, because Image.open refuses more than 179 million pixels, and phones take 200 million.
_FORMATS: dict[bytes, type[ImageFile]] = {
    b"\x89PNG": PngImagePlugin.PngImageFile,
    b"\xff\xd8": JpegImagePlugin.JpegImageFile,
    b"BM": BmpImagePlugin.BmpImageFile,
    b"II": TiffImagePlugin.TiffImageFile,
    b"MM": TiffImagePlugin.TiffImageFile,
    b"RIFF": WebPImagePlugin.WebPImageFile,
}
"""By the first bytes of a file."""
_MOST_PIXELS = 2**30
"""OpenCV decodes no more."""
_DEPTHS = (10, 12, 14, 16)
"""Bits of cameras whose channels are stored in 16."""


def focal_35mm(path: Path) -> float | None:
    """The 35 mm equivalent in millimetres stated in a photograph; None without one, or if it is not a JPEG file."""
    with warnings.catch_warnings(), _opened(path) as header:
        warnings.simplefilter("ignore")  # of damaged Exif data, which tell nothing
        stated = _exif(header, ExifTags.IFD.Exif).get(ExifTags.Base.FocalLengthIn35mmFilm)
    jpeg = isinstance(header, JpegImagePlugin.JpegImageFile)
    return float(stated) if jpeg and isinstance(stated, int) and stated > 0 else None  # 0 stands for "unknown"


def image_files(folder: Path | None) -> tuple[Path, ...]:
    """A folder's images in natural order; none for a video or a missing path."""
    if folder is None or not folder.is_dir():
        return ()
    visible = (file for file in folder.iterdir() if not file.name.startswith("."))
    images = (file for file in visible if file.suffix.lower() in IMAGE_SUFFIXES)
    return tuple(sorted(images, key=lambda file: natural_key(file.name)))


class Images:
    """Image files, read when asked for."""

    frame_rate: float | None = None
    declared_frame_rate: float | None = None
    uneven: bool = False
    times: None = None
    pixel_aspect: float = 1.0

    def __init__(self, path: Path) -> None:
        self._path, self._files = path, image_files(path) if path.is_dir() else (path,)
        if not self._files:
            others = sorted(file.name for file in path.iterdir() if not file.name.startswith("."))
            found = f"{len(others)} other files, such as {others[0]}" if others else "an empty folder"
            raise InputError(f"No images in {path}: found {found}; expected files in {', '.join(IMAGE_SUFFIXES)}.")
        self.count = self.declared_count = len(self._files)
        self.stems: tuple[str, ...] | None = tuple(file.stem for file in self._files)
        if self.read(0) is None:
            raise InputError(f"{self._files[0]} is not an image that can be decoded; remove or replace it.")

    def read(self, index: int) -> UInt8[np.ndarray, "H W 3"] | None:
        """An image as BGR; None if damaged. Raises InputError if it is too large, OSError if it cannot be read."""
        image = _decoded(self._files[index])
        if image is not None and image.dtype == np.uint16:
            image = np.minimum(image >> (self._depth - 8), 255).astype(np.uint8)
        return image

    def sizes(self, indices: Sequence[int]) -> set[tuple[int, int]]:
        """Widths and heights in pixels of some images, as their files state them."""
        found = set()
        for index in indices:
            with _opened(self._files[index]) as header:
                if header is not None:
                    lies = _exif(header).get(ExifTags.Base.Orientation, 1) >= 5
                    found.add(header.size[::-1] if lies else header.size)
        return found

    def notes(self, indices: Sequence[int]) -> list[str]:
        """Notes for the user on some images, in sentences."""
        notes, name = [], self._path.name
        pages = max(_pages(self._files[index]) for index in indices)
        if pages > 1:
            holds = f"{name} holds" if self._path == self._files[0] else f"A file in {name} holds"
            notes.append(f"{holds} {pages} pictures; only the first is used. Save all as single images or as a video.")
        depth = self.__dict__.get("_depth", 16)
        if depth < 16:
            notes.append(f"The images of {name} use {depth} of 16 bits a channel; these {depth} are shown.")
        return notes

    def label(self, index: int) -> str:
        return f"Image {self._files[index].name}"

    def close(self) -> None:
        pass

    @cached_property
    def _depth(self) -> int:
        """Bits a channel that images with 16 use: 12-bit cameras would come out black otherwise."""
        images = (_decoded(self._files[index]) for index in spread(self.count))
        highest = max(int(image.max()) for image in images if image is not None and image.dtype == np.uint16)
        return next(depth for depth in _DEPTHS if highest < 2**depth)


def spread(count: int) -> list[int]:
    """Numbers of at most 16 frames, spread over a clip."""
    return np.unique(np.linspace(0, count - 1, 16).round().astype(int)).tolist()


def _decoded(path: Path) -> np.ndarray | None:
    """An image as BGR of 8 or 16 bits a channel; None if it is damaged. Raises as `Images.read` does."""
    # Not cv2.imread, which cannot open paths with special characters on Windows.
    content = np.fromfile(regular_file(path), dtype=np.uint8)
    header = _header(BytesIO(content.data))
    if header is None:
        return None
    width, height = header.size
    # A JPEG of 600 bytes can claim 256 million pixels.
    if width * height > min(most_unpacked(len(content), 3 * _MOST_PIXELS) // 3, _MOST_PIXELS):
        raise InputError(
            f"{path} has {width} x {height} pixels by its header and {len(content)} bytes. It is damaged, or too large "
            f"(expected at most {_MOST_PIXELS // 10**6} million pixels): scale it down."
        )
    image = cv2.imdecode(content, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    return image if image is not None and image.dtype in (np.uint8, np.uint16) else None


def _header(file: BinaryIO) -> ImageFile | None:
    """An image whose pixels are not read yet; None if it is damaged, or of another format."""
    start = file.read(4)
    file.seek(0)
    try:
        return next((kind(file) for prefix, kind in _FORMATS.items() if start.startswith(prefix)), None)
    except Exception:  # Pillow raises any kind for a damaged file
        return None


@contextmanager
def _opened(path: Path) -> Iterator[ImageFile | None]:
    with regular_file(path, most=None).open("rb") as file:
        yield _header(file)


def _exif(header: ImageFile | None, directory: int | None = None) -> Mapping[int, Any]:
    """Exif data of an image, or of one of their directories; empty if they are damaged."""
    try:
        exif = header.getexif() if header else Exif()
        return exif if directory is None else exif.get_ifd(directory)
    except (SyntaxError, ValueError):
        return {}


def _pages(path: Path) -> int:
    """Pictures in a file. A JPEG's second one is a phone's preview or depth map."""
    with _opened(path) as header:
        return 1 if isinstance(header, JpegImagePlugin.JpegImageFile) else getattr(header, "n_frames", 1)
