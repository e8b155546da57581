"""Two people of a clip who were confused: what is uncertain about them, and how to correct it."""

import uuid

import numpy as np

from fitting_core.errors import InputError
from fitting_core.io.people_file import Span
from fitting_core.keypoints import COUNT
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.kinds import TakeOver
from tcfit_app.project.edits.packed_points import packed
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.gestures.correcting import Correcting
from tcfit_app.review.tab.people import Doubt, ReviewedPerson
from tcfit_app.review.tab.tab import Tab

_ALL = tuple(range(COUNT))


class Exchanging:
    """In one tab. Spans are video frame numbers, as in people.json."""

    def __init__(self, tab: Tab, correcting: Correcting) -> None:
        self._tab, self._correcting = tab, correcting

    @property
    def doubts(self) -> list[Doubt]:
        """Where the person on show may be someone else."""
        someone = self._tab.someone
        return [] if someone.group is None else someone.group.doubts(someone.number)

    @property
    def halves(self) -> list[str]:
        """Incomplete exchanges, in words; they stay only on a full disk, or if a project was corrected alone."""
        someone = self._tab.someone
        if (group := someone.group) is None:
            return []
        return [
            f"{span_in_words(someone.span(entry)).capitalize()} were taken over from {other.name}, but not in exchange."
            " Undo that."
            for other, entry in group.half_exchanged(someone.number)
        ]

    def go(self, doubt: Doubt) -> None:
        """Go to its first frame and select them all."""
        tab = self._tab
        last = tab.length - 1
        first, end = (min(max(number - tab.first_frame, 0), last) for number in doubt.span)
        tab.pause()
        tab.seek(first)
        tab.set(frames=range(first, end + 1))

    def confirm(self, doubt: Doubt) -> None:
        """Confirm this person: these frames are no longer uncertain. Raises InputError if that cannot be saved."""
        someone = self._tab.someone
        self._tab.refuse_read_only()
        assert someone.group is not None
        someone.group.settle(doubt)
        self._tab.say(f"It is {someone.name}: {span_in_words(doubt.span)}")

    def exchange(self, other: ReviewedPerson, number: int) -> None:
        """Swap the keypoints of two people from a frame on, in both projects. Raises InputError if they are not both
        present from this frame on, or a project cannot be written; neither is changed then, or, on a full disk, both
        are as before as soon as that can be written.

        Args:
            other: The other person.
            number: The video frame number.
        """
        mine = self._tab.someone
        self._correcting.refuse_while_dragging()
        for one in (mine, other):
            one.session.project.refuse_read_only()
        frames = [one.frames_from(number) for one in (mine, other)]
        shared = range(max(f.start for f in frames), min(f.stop for f in frames))
        if not shared:
            raise InputError(f"{mine.name} and {other.name} are not both there from frame {number} on.")
        name = uuid.uuid4().hex
        edits = [
            TakeOver(
                frames=tuple(n - one.session.project.footage.first_frame for n in shared),
                joints=_ALL,
                source=source.name,
                exchange=name,
                packed=_keypoints(source, shared),
            )
            for one, source in ((mine, other), (other, mine))
        ]
        assert mine.group is not None
        try:
            for one, edit in zip((mine, other), edits, strict=True):
                one.session.edit(edit, author=self._tab.author)
        except InputError:
            mine.group.undo_halves()
            raise
        stay = [
            f"; {span_in_words((shared.stop, one.stop - 1))} of {one.name} stay, where {another.name} is not"
            for one, another in ((mine, other), (other, mine))
            if one.stop > shared.stop
        ]
        where = span_in_words((shared[0], shared[-1]))
        self._tab.say(f"{mine.name} and {other.name} exchanged, {where}: fit both again{''.join(stay)}")


def _keypoints(someone: ReviewedPerson, numbers: range) -> bytes:
    """Keypoints as they count now: confidence 0 for those marked bad."""
    first = someone.session.project.footage.first_frame
    now: Corrected = someone.session.project.corrected.at(tuple(n - first for n in numbers), _ALL)
    confidence = np.where(now.bad, 0.0, now.confidence)
    return packed(np.concatenate([now.xy, confidence[..., None], (now.edited & now.present)[..., None]], -1))


def span_in_words(span: Span) -> str:
    """Video frame numbers with their noun."""
    return in_words(range(span[0], span[1] + 1), 0)
