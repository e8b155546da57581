"""Playing a clip in one browser: in real time, but no faster than the page draws."""

from collections.abc import Sequence

PATIENCE = 0.5
"""Seconds after which a frame counts as drawn although the page did not report it: a hidden tab reports nothing."""


class Playback:
    """Says which frame is due. Times are in seconds of one clock.

    Args:
        frame_rate: of the clip.
    """

    def __init__(self, frame_rate: float) -> None:
        self.frame_rate = frame_rate
        self._start: tuple[float, int] = (0.0, 0)
        self._sent: tuple[float, int] | None = None

    def begin(self, now: float, frame: int) -> None:
        """Play from this frame."""
        self._start, self._sent = (now, frame), None

    def sent(self, now: float, frame: int) -> None:
        """A frame was sent to the page."""
        self._sent = (now, frame)

    def drawn(self, frame: int) -> None:
        """The page has drawn a frame."""
        if self._sent is not None and self._sent[1] == frame:
            self._sent = None

    def waits(self, now: float) -> bool:
        """Whether the page is still busy with the last frame; later ones are dropped meanwhile."""
        return self._sent is not None and now - self._sent[0] < PATIENCE

    def due(self, now: float, speed: float, frames: range, *, loop: bool) -> tuple[int, bool]:
        """The frame to show, and whether playing continues.

        Args:
            now: the time.
            speed: 1 for real time.
            frames: the frames to play.
            loop: start again at the end; otherwise stop there.
        """
        began, first = self._start
        frame = first + int((now - began) * self.frame_rate * speed)
        if frame in frames:
            return frame, True
        if not loop or len(frames) < 2:
            return frames[-1], False
        start = frames.start + (frame - frames.start) % len(frames) if frame >= frames.stop else frames.start
        self.begin(now, start)
        return start, True


def coming(frame: int, frames: range, count: int, *, loop: bool) -> Sequence[int]:
    """The frames after this one, in playing order."""
    rest = list(range(frame + 1, min(frame + 1 + count, frames.stop)))
    if loop and len(rest) < count:
        rest += list(frames[: count - len(rest)])
    return rest
