"""Errors that repeat: the last correction, made again at all entries of the queue that look alike."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec

from fitting_core.errors import InputError
from tcfit_app.analysis.suspicion import Suspect
from tcfit_app.project.edits.edit_log import Remark
from tcfit_app.project.edits.kinds import ClearDepth, Edit, MarkBad, Reset, SetConfidence, SwapSides
from tcfit_app.review.gestures.correcting import Correcting
from tcfit_app.review.gestures.reviewing import Reviewing
from tcfit_app.review.tab.tab import Tab

_REPEATED = (MarkBad, SwapSides, SetConfidence, Reset, ClearDepth)
"""Edits that mean the same in every frame; all others have positions of their own."""
_LOOKED_BACK = 20
"""Entries of the log, of which some are undone or remarks."""


@dataclass(frozen=True, kw_only=True)
class Alike:
    """The entries that look like one that was corrected, and the correction in all of them."""

    places: tuple[Suspect, ...]
    edit: Edit


class Repeating:
    """In one tab."""

    def __init__(self, tab: Tab, reviewing: Reviewing, correcting: Correcting) -> None:
        self._tab, self._reviewing, self._correcting = tab, reviewing, correcting

    @property
    def alike(self) -> Alike | None:
        """What the correction just made could be repeated at; None if it is none of an entry, or nothing looks alike.

        Entries look alike if the same kind of thing was found about the same limbs; flagged ones are left out.
        """
        tab, visited = self._tab, self._reviewing.visited
        project = tab.session.project
        queue = self._reviewing.everything
        if visited is None or queue is None:
            return None
        edit = tab.once("last correction", project.last_edit, self._last_correction)
        if edit is None or not set(edit.frames) & set(visited.frames):
            return None
        flagged = {frame for frame, mark in project.marks.all().items() if mark.state == "flag"}
        same = [s for s in queue if (s.kind, s.about) == (visited.kind, visited.about)]
        places = tuple(s for s in same if flagged.isdisjoint(s.frames) and not set(s.frames) & set(edit.frames))
        if not places:
            return None
        frames = sorted({frame for place in places for frame in _frames_like(edit.frames, visited, place, tab.length)})
        return Alike(places=places, edit=msgspec.structs.replace(edit, frames=tuple(frames)))

    def _last_correction(self) -> Edit | None:
        """The last edit that stands, if it is this author's and can be repeated."""
        project = self._tab.session.project
        standing = (entry for entry in project.last_said(_LOOKED_BACK) if project.stands(entry.id))
        last = next((entry for entry in standing if not isinstance(entry.action, Remark)), None)
        own = last is not None and last.author == self._tab.author
        return last.action if own and isinstance(last.action, _REPEATED) else None

    def found(self) -> Alike:
        """The same. Raises InputError if there is nothing to repeat."""
        if (alike := self.alike) is None:
            raise InputError(
                "Nothing to repeat: go to an entry of the queue (N), and mark its keypoints as bad, swap or reset "
                "them. Other entries of its kind about the same limbs must be left."
            )
        return alike

    def list_places(self) -> None:
        """List the entries that look alike, and no others."""
        place = self.found().places[0]
        limb = place.about[0] if len(place.about) == 1 else ""
        self._tab.set(queue=replace(self._tab.state.queue, kind=place.kind, limb=limb))

    def repeat(self) -> None:
        """Make the correction at all of them, as one edit."""
        self._correcting.make(self.found().edit)


def _frames_like(done: Sequence[int], visited: Suspect, other: Suspect, length: int) -> range:
    """The frames of another entry that correspond to those corrected of the one that was visited.

    A single frame corresponds to the worst one; otherwise all frames do, and as many before and after them as were
    corrected there.
    """
    if len(done) == 1:
        return range(other.frame, other.frame + 1)
    before = max(0, visited.frames.start - done[0])
    after = max(0, done[-1] - visited.frames[-1])
    return range(max(0, other.frames.start - before), min(length, other.frames.stop + after))
