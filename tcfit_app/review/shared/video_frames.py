"""The frames of a clip's video as JPEGs, decoded ahead in a thread.

Nothing here blocks, and nothing raises for a missing or broken video: instead there is a grey frame, and a text, and
what is on show is tried again.

One thread opens, decodes and encodes, because a video is read forwards. First come requested frames, then those about
to be played, then the rest of the clip at the playing size, as far as memory allows. So a jump in a
clip that has been open for some seconds shows the playing size at once, and the full size after a seek; a clip no
larger than that is stored in one size only.

A seek decodes from the previous keyframe. Milliseconds of `FrameSource.frame` at 25 random frames, and of encoding one
as "playing" and "full", on one thread:

    pixels         codec     key frames every    median    slowest    encode
    640 x 480      H.264     12                  7         11         2, 2
    540 x 720      MPEG-4    12                  4         8          2, 2
    1768 x 994     VP9       60                  138       268        4, 11
    1088 x 1920    H.264     100                 160       267        7, 20
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable, Iterable
from pathlib import Path
from typing import Literal, get_args

import cv2
import numpy as np
from jaxtyping import UInt8

from fitting_core.camera import Lens
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.video.frames import FrameSource
from tcfit_app.analysis.byte_cache import ByteCache
from tcfit_app.review.scene.layers import jpeg

FrameSize = Literal["playing", "full"]
"""Small, for fast playback; or every pixel of the video."""
PLAYING = (960, 540)
"""Maximum size of a playing frame; transposed for portrait video."""
_QUALITY: dict[FrameSize, int] = {"playing": 80, "full": 85}
_GREY = 96
_log = logging.getLogger(__name__)
_LIMIT = 256 * 2**20
_FILLED = 0.5
"""Fraction of the cache up to which frames that were not requested are kept."""
_WAITING = 16
"""Number of pending requests; older ones have been skipped over."""
_RETRY = 2.0
"""Seconds after which a frame or a video that could not be read is tried again."""

Wanted = tuple[int, FrameSize]


class VideoFrames:
    """Frames of a video, by their numbers there. Thread-safe.

    Args:
        source: A video or a folder of images, if any.
        numbers: The source's frames that can be requested, from 0.
        size: Width and height in pixels of the clip's camera: the placeholder's shape.
        lens: Of the clip's camera, whose distortion is removed.
        limit: Size of the cache in bytes.
        fill: Whether to decode the rest of the clip when idle.
        arrived: Called from another thread when a frame requested by `get` or `nearest` is ready.
    """

    def __init__(
        self,
        source: Path | None,
        *,
        numbers: range,
        size: tuple[int, int],
        lens: Lens | None = None,
        limit: int = _LIMIT,
        fill: bool = True,
        arrived: Callable[[], None] = lambda: None,
    ) -> None:
        self.numbers, self.size, self._arrived = numbers, size, arrived
        self._awaited: set[Wanted] = set()
        self._cache: ByteCache[bytes] = ByteCache(limit, len)
        self._grey = {shown: placeholder(size, shown) for shown in get_args(FrameSize)}
        one = shown_size(size, "playing") == size
        self._kept: dict[FrameSize, FrameSize] = {"playing": "full" if one else "playing", "full": "full"}
        self._problem = "" if source else "There is no video: the project was made without one, or it was not found."
        self._problems: dict[int, tuple[str, float]] = {}
        """Why a frame could not be read, and when it was tried."""
        self._asked: deque[Wanted] = deque(maxlen=_WAITING)
        self._coming: dict[Hashable, deque[Wanted]] = {}
        self._rest = deque(numbers) if fill else deque()
        self._changed = threading.Condition()
        self._closed = source is None
        self._thread = threading.Thread(target=self._work, args=(source, lens), name="video frames", daemon=True)
        if source:
            self._thread.start()

    def problem_of(self, frame: int) -> str:
        """Why a frame is grey; empty if it is not, or not decoded yet."""
        return self._problem or self._problems.get(frame, ("", 0.0))[0]

    def get(self, frame: int, shown: FrameSize = "full") -> bytes | None:
        """The frame as JPEG if it is ready; otherwise None, and it is decoded next."""
        assert frame in self.numbers
        wanted: tuple[int, FrameSize] = frame, self._kept[shown]
        found = self._cached(wanted)
        if found is None or self._retried(frame):
            self._ask(wanted)
        return found

    def nearest(self, frame: int, shown: FrameSize = "full") -> bytes | None:
        """The frame in this size, or in the other one if that is ready; a missing one is decoded next."""
        return self.get(frame, shown) or self._cached((frame, "playing" if shown == "full" else "full"))

    def prefetch(self, frames: Iterable[int], *, reader: Hashable = None) -> None:
        """Decode frames that will be played soon, at the playing size.

        Args:
            frames: In playing order.
            reader: Who plays; replaces the reader's previous frames.
        """
        kept = self._kept["playing"]
        coming: deque[Wanted] = deque((frame, kept) for frame in frames if frame in self.numbers)
        with self._changed:
            self._coming[reader] = coming
            self._changed.notify_all()

    def leave(self, reader: Hashable) -> None:
        """Forget a reader's prefetched frames."""
        with self._changed:
            self._coming.pop(reader, None)

    def close(self) -> None:
        """End the thread and release the video."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def _cached(self, wanted: tuple[int, FrameSize]) -> bytes | None:
        found = self._cache.get(wanted)
        if self._closed or self._problem or wanted[0] in self._problems:
            return found or self._grey[wanted[1]]
        return found

    def _retried(self, frame: int) -> bool:
        """Whether a frame could not be read, and should be tried again."""
        return frame in self._problems and time.monotonic() > self._problems[frame][1] + _RETRY

    def _ask(self, wanted: Wanted) -> None:
        with self._changed:
            if wanted in self._asked:
                self._asked.remove(wanted)
            self._asked.append(wanted)
            self._awaited.add(wanted)
            self._changed.notify_all()

    def _work(self, source: Path, lens: Lens | None) -> None:
        while (frames := self._opened(source, lens)) is None:
            with self._changed:
                if self._changed.wait_for(lambda: self._closed, _RETRY):
                    return
        with frames:
            last: tuple[int, np.ndarray] | None = None
            while wanted := self._next():
                last = self._decoded(frames, wanted, last)

    def _opened(self, source: Path, lens: Lens | None) -> FrameSource | None:
        """The video; None if it cannot be read now."""
        before, frames = self._problem, None
        try:
            frames = FrameSource(source, lens=lens)
            self._problem = ""
        except Exception as error:  # any error: if the thread ended, everyone would wait
            self._problem = _reason(error)
        if self._problem != before:
            self._arrived()
        return frames

    def _next(self) -> Wanted | None:
        """What to decode now; waits until there is something, None at the end."""
        with self._changed:
            while not self._closed:
                if wanted := self._chosen():
                    return wanted
                self._changed.wait()
            return None

    def _chosen(self) -> Wanted | None:
        while self._asked:
            wanted = self._asked.pop()
            if self._missing(wanted):
                return wanted
        # One frame for each reader in turn, starting with the one that has waited longest.
        for reader in list(self._coming):
            queue = self._coming.pop(reader)
            while queue:
                wanted = queue.popleft()
                if self._missing(wanted):
                    self._coming[reader] = queue
                    return wanted
        while self._rest and self._cache.used < _FILLED * self._cache.limit:
            wanted: Wanted = (self._rest.popleft(), self._kept["playing"])
            if self._missing(wanted):
                return wanted
        return None

    def _missing(self, wanted: Wanted) -> bool:
        return wanted not in self._cache and (wanted[0] not in self._problems or self._retried(wanted[0]))

    def _decoded(
        self, frames: FrameSource, wanted: Wanted, last: tuple[int, np.ndarray] | None
    ) -> tuple[int, np.ndarray] | None:
        """Decode and cache a frame; returns its pixels, because its other size is often wanted next."""
        frame, shown = wanted
        try:
            image = last[1] if last and last[0] == frame else frames.frame(frame)
            self._cache.put(wanted, encoded(image, shown))
            last = frame, image
            self._problems.pop(frame, None)
        except Exception as error:  # as above
            self._problems[frame] = _reason(error), time.monotonic()
        with self._changed:
            awaited = wanted in self._awaited
            self._awaited.discard(wanted)
        if awaited:
            self._arrived()
        return last


def _reason(error: Exception) -> str:
    """Why a frame is grey, for users; unexpected errors are also logged."""
    if isinstance(error, InputError | OSError | cv2.error):
        return str(error)
    _log.error("A frame cannot be shown", exc_info=error)
    return f"{type(error).__name__}: {error}"


def shown_size(size: tuple[int, int], shown: FrameSize) -> tuple[int, int]:
    """Width and height in pixels of a JPEG for a video of `size`: the same shape, never larger."""
    if shown == "full":
        return size
    wide, high = max(PLAYING), min(PLAYING)
    most = (wide, high) if size[0] >= size[1] else (high, wide)
    scale = min(1.0, most[0] / size[0], most[1] / size[1])
    return max(1, round(scale * size[0])), max(1, round(scale * size[1]))


def encoded(image: UInt8[np.ndarray, "H W 3"], shown: FrameSize) -> bytes:
    """A frame (RGB) as JPEG."""
    size = shown_size((image.shape[1], image.shape[0]), shown)
    if size != (image.shape[1], image.shape[0]):
        # Linear, not by area: 2 against 20 ms when 1080p shrinks by a non-integer factor.
        image = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)
    return jpeg(image, quality=_QUALITY[shown])


def placeholder(size: tuple[int, int], shown: FrameSize) -> bytes:
    """A grey frame instead of one that cannot be shown."""
    width, height = shown_size(size, shown)
    return encoded(np.full((height, width, 3), _GREY, np.uint8), "full")


# --- one video for several people of a clip ---

_Filmed = tuple[Path | None, tuple[int, int], Lens | None]
"""What must match for frames to be shared: the source, and the camera's size and lens."""


class Videos:
    """The videos of a clip's people, each open once while someone shows it.

    Args:
        clips: Of the people.
        arrived: Called from another thread when a requested frame is ready.
    """

    def __init__(self, clips: Iterable[Clip], arrived: Callable[[], None]) -> None:
        self._arrived = arrived
        self._spans: dict[_Filmed, range] = {}
        for clip in clips:
            own = _numbers(clip)
            known = self._spans.setdefault(_filmed(clip), own)
            self._spans[_filmed(clip)] = range(min(known.start, own.start), max(known.stop, own.stop))
        self._open: dict[tuple[_Filmed, range], tuple[VideoFrames, int]] = {}
        """With the number of users."""

    def of(self, clip: Clip) -> VideoFrames:
        """The frames of a clip, whose media may have been relinked since; to be given to `leave` in the end."""
        filmed, own = _filmed(clip), _numbers(clip)
        span = self._spans.get(filmed, own)
        span = span if span.start <= own.start and own.stop <= span.stop else own
        frames, count = self._open.get((filmed, span)) or (self._read(clip, span), 0)
        self._open[filmed, span] = frames, count + 1
        return frames

    def _read(self, clip: Clip, span: range) -> VideoFrames:
        camera = clip.camera
        return VideoFrames(
            clip.source,
            numbers=span,
            size=camera.size,
            lens=camera.lens,
            arrived=self._arrived,
        )

    def leave(self, frames: VideoFrames) -> None:
        """A clip is no longer shown; its video is released with its last one."""
        key = next(key for key, (known, _) in self._open.items() if known is frames)
        _, count = self._open.pop(key)
        if count > 1:
            self._open[key] = frames, count - 1
        else:
            frames.close()


def _filmed(clip: Clip) -> _Filmed:
    return clip.source, clip.camera.size, clip.camera.lens


def _numbers(clip: Clip) -> range:
    return range(clip.first_frame, clip.first_frame + len(clip))
