"""Two people of a clip who were taken for each other: what is uncertain about them, and how that is put right."""

import numpy as np

from fitting_core.errors import InputError
from fitting_core.io.people_file import Span
from fitting_core.keypoints import COUNT
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.kinds import TakeOver
from tcfit_app.project.edits.taken_over import packed
from tcfit_app.review.tab.people import Someone
from tcfit_app.review.tab.tab import Tab

_ALL = tuple(range(COUNT))


class Exchanging:
    """In one tab. Frames of spans are numbers in the video, as people.json has them."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab

    @property
    def uncertain(self) -> tuple[Span, ...]:
        """The frames in which the person on show may be another one."""
        return self._tab.someone.uncertain

    def go(self, span: Span) -> None:
        """To the first of them; all are selected."""
        tab = self._tab
        last = tab.length - 1
        first, end = (min(max(number - tab.first_frame, 0), last) for number in span)
        tab.pause()
        tab.seek(first)
        tab.set(frames=range(first, end + 1))

    def confirm(self, span: Span) -> None:
        """It is this person: nothing of that span is uncertain any more. Raises InputError if it cannot be written."""
        someone = self._tab.someone
        self._tab.refuse_read_only()
        assert someone.group is not None
        someone.group.settle({someone.number: (span,)})
        self._tab.say(f"It is {someone.name}: {_words(span)}")

    def exchange(self, other: Someone, number: int) -> None:
        """Exchange the keypoints of two people from a frame on, in both projects; each can be undone there.

        Args:
            other: With whom.
            number: Of the frame in the video.

        Raises:
            InputError: They are not both there from this frame on, or a project cannot be written.
        """
        mine, group = self._tab.someone, self._tab.someone.group
        assert group is not None
        for one in (mine, other):
            one.session.project.refuse_read_only()
        frames = [one.frames_from(number) for one in (mine, other)]
        shared = range(max(f.start for f in frames), min(f.stop for f in frames))
        if not shared:
            raise InputError(f"{mine.name} and {other.name} are not both there from frame {number} on.")
        both = [(one, *_keypoints(one, shared)) for one in (mine, other)]
        edits = [
            TakeOver(
                frames=tuple(n - one.session.project.clip.first_frame for n in shared),
                joints=_ALL,
                source=source.name,
                packed=packed(xy, confidence),
            )
            for (one, _, _), (source, xy, confidence) in zip(both, reversed(both), strict=True)
        ]
        author = self._tab.author
        mine.session.edit(edits[0], author=author)
        try:
            other.session.edit(edits[1], author=author)
        except InputError:
            mine.session.undo(author=author)
            raise
        settled = {one.number: [s for s in one.uncertain if s[0] <= number <= s[1] + 1] for one in (mine, other)}
        group.settle(settled)
        where = f"from frame {shared[0]} on" if shared[-1] + 1 == mine.stop else _words((shared[0], shared[-1]))
        self._tab.say(f"{mine.name} and {other.name} exchanged {where}: fit both again, or undo it in both")


def _keypoints(someone: Someone, numbers: range) -> tuple[np.ndarray, np.ndarray]:
    """Positions and confidences as they count now: 0 for what is marked bad."""
    first = someone.session.project.clip.first_frame
    now: Corrected = someone.session.project.corrected.at(tuple(n - first for n in numbers), _ALL)
    return now.xy, np.where(now.bad, 0.0, now.confidence)


def _words(span: Span) -> str:
    return f"frame {span[0]}" if span[0] == span[1] else f"frames {span[0]}–{span[1]}"
