"""Thumbnails of the video along one tab's timeline."""

from base64 import b64encode

import numpy as np

from tcfit_app.review.browser import page_states as states
from tcfit_app.review.drawing.rows import VIDEO
from tcfit_app.review.shared.shared_video import SharedVideo
from tcfit_app.review.tab.tab import Tab

MOST = 64
"""Thumbnails per clip, enough for a wide window. 64 take 200 KB."""
_TOGETHER = 16
"""How many more are sent at once."""


class Thumbnails:
    """Draws one tab's thumbnails; called repeatedly, it sends only changes."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._frames = evenly_spread(tab.length)
        self._found: dict[int, str] = {}
        self._video: SharedVideo | None = None
        """The video they show."""

    def draw(self) -> None:
        """Have missing thumbnails made while the row is on show, and send some at a time."""
        tab = self._tab
        if VIDEO not in tab.state.plots:
            return
        video = tab.data.video
        if video is not self._video:
            self._video, self._found = video, {}
        missing = [frame for frame in self._frames if frame not in self._found and not video.problem_of(frame)]
        if missing:
            made = video.thumbnails([(frame, "thumbnail") for frame in missing], reader=self)
            self._found |= {frame: b64encode(image).decode() for (frame, _), image in made.items()}
        all_there = all(frame in self._found for frame in missing)
        key = video, all_there, len(self._found) // (1 if all_there else _TOGETHER)
        tab.channel.send("thumbnails", tab.once("thumbnails", key, self._sorted))

    def _sorted(self) -> states.Thumbnails:
        frames = tuple(sorted(self._found))
        return states.Thumbnails(frames=frames, images=tuple(self._found[frame] for frame in frames))


def evenly_spread(length: int) -> tuple[int, ...]:
    """Frames spread evenly over a clip."""
    count = min(length, MOST)
    return tuple(((np.arange(count) + 0.5) * length / count).astype(int).tolist())
