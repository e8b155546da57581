"""One video for several people of a clip: it is decoded once, and each person's frames are counted from their first."""

from collections.abc import Callable, Hashable, Iterable
from pathlib import Path

from fitting_core.camera import Lens
from fitting_core.clip import Clip
from tcfit_app.review.shared.video_frames import FrameSize, VideoFrames

_Filmed = tuple[Path | None, tuple[int, int], Lens | None]
"""What must match for frames to be shared: the source, and the camera's size and lens."""


class SharedVideo:
    """The frames of one person's clip, in a video that others may also read. Like `VideoFrames`, for one thread.

    Args:
        frames: Of the video.
        first: The video frame of the clip's first frame.
        count: Number of frames in the clip.
        left: Called once it is closed.
    """

    def __init__(self, frames: VideoFrames, first: int, count: int, left: Callable[[], None]) -> None:
        self._frames, self._first, self._left = frames, first, left
        self.count, self.size = count, frames.size

    def problem_of(self, frame: int) -> str:
        """Why a frame is grey; empty if it is not, or not decoded yet."""
        return self._frames.problem_of(frame + self._first)

    def get(self, frame: int, shown: FrameSize = "full") -> bytes | None:
        """The frame as JPEG if it is ready; otherwise None, and it is decoded next."""
        assert 0 <= frame < self.count
        return self._frames.get(frame + self._first, shown)

    def nearest(self, frame: int, shown: FrameSize = "full") -> bytes | None:
        """The frame in this size, or in the other one if that is ready; a missing one is decoded next."""
        assert 0 <= frame < self.count
        return self._frames.nearest(frame + self._first, shown)

    def prefetch(self, frames: Iterable[int], *, reader: Hashable = None) -> None:
        """Decode frames that will be played soon, at the playing size."""
        self._frames.prefetch([frame + self._first for frame in frames if 0 <= frame < self.count], reader=reader)

    def leave(self, reader: Hashable) -> None:
        """Forget a reader's prefetched frames."""
        self._frames.leave(reader)

    def close(self) -> None:
        """The clip is no longer shown; the video is released with its last clip."""
        self._left()


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

    def of(self, clip: Clip) -> SharedVideo:
        """The frames of a clip, whose media may have been relinked since."""
        filmed, own = _filmed(clip), _numbers(clip)
        span = self._spans.get(filmed, own)
        span = span if span.start <= own.start and own.stop <= span.stop else own
        frames, count = self._open.get((filmed, span)) or (self._read(clip, span), 0)
        self._open[filmed, span] = frames, count + 1
        return SharedVideo(frames, own.start - span.start, len(own), lambda: self._leave((filmed, span)))

    def _read(self, clip: Clip, span: range) -> VideoFrames:
        camera = clip.camera
        return VideoFrames(
            clip.source,
            first_frame=span.start,
            count=len(span),
            size=camera.size,
            lens=camera.lens,
            arrived=self._arrived,
        )

    def _leave(self, key: tuple[_Filmed, range]) -> None:
        frames, count = self._open.pop(key)
        if count > 1:
            self._open[key] = frames, count - 1
        else:
            frames.close()


def _filmed(clip: Clip) -> _Filmed:
    return clip.source, clip.camera.size, clip.camera.lens


def _numbers(clip: Clip) -> range:
    return range(clip.first_frame, clip.first_frame + len(clip))
