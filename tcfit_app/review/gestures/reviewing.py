"""Stepping through a clip's suspicious frames in one tab."""

from collections import Counter
from collections.abc import Sequence
from typing import Literal

from fitting_core.errors import InputError
from tcfit_app.analysis.findings import FINDINGS, WHOLE
from tcfit_app.analysis.suspicion import ReviewQueue, Suspect
from tcfit_app.project.edits.remarks import MarkState
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.browser.page_states import Leave
from tcfit_app.review.gestures.edit_words import capitalized
from tcfit_app.review.gestures.zooming import follow_selection
from tcfit_app.review.tab.tab import Tab


class Reviewing:
    """The review queue of one tab, for the fit that corrections apply to."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._queue: ReviewQueue | None = None
        self._last: Suspect | None = None
        self._place = -1
        """Position of that entry in the queue: when it has left, the next entry has this position."""

    @property
    def queue(self) -> ReviewQueue | None:
        """The newest queue that there is, of which a newer one may be being computed; None while the first one is, and
        if there is no fit or it has none. While the fit follows an edit the queue stays: corrected keypoints beside the
        uncorrected fit would be entries that vanish again."""
        if self._queue is not None and self._tab.session.edit_follower.lags:
            return self._queue
        shown, data = self._tab.shown.b, self._tab.data
        found = None if shown is None else data.queue(shown)
        if found is not None or shown is None or data.problem("suspects", shown):
            self._queue = found
        return self._queue

    @property
    def looking(self) -> bool:
        """Whether a newer queue is being computed, or will be once the fit has followed an edit."""
        shown, data = self._tab.shown.b, self._tab.data
        if shown is None:
            return False
        missing = data.queue(shown) is None and not data.problem("suspects", shown)
        return missing or self._tab.session.edit_follower.lags

    @property
    def suspects(self) -> tuple[Suspect, ...] | None:
        """The entries of the kind that the tab shows, worst first; None as above."""
        queue, kind = self.queue, self._tab.state.queue_kind
        return None if queue is None else tuple(suspect for suspect in queue.left if kind in ("", suspect.kind))

    def go(self, step: int) -> None:
        """Go to the next (1) or previous (-1) queue entry. Raises InputError while the first queue is computed."""
        suspects = self.suspects
        if suspects is None:
            raise InputError("Suspicious frames are still being looked for. Try again in a moment.")
        if not suspects:
            raise InputError("No entry of the queue is listed: choose All kinds under More in the panel Review.")
        gone = self._place - (step > 0) if self._last is not None else -(step > 0)
        at = next((i for i, suspect in enumerate(suspects) if self._is_last(suspect)), gone)
        self.show(suspects[(at + step) % len(suspects)])

    def _is_last(self, suspect: Suspect) -> bool:
        last = self._last
        return last is not None and suspect.key == last.key

    def show(self, suspect: Suspect) -> None:
        """Go to an entry, and select its keypoints and frames."""
        self._last = suspect
        self._place = next((i for i, known in enumerate(self.suspects or ()) if self._is_last(known)), self._place)
        self._tab.pause()
        self._tab.seek(suspect.frame)
        self._tab.set(selection=suspect.joints, suggested=True)
        follow_selection(self._tab)
        state = self._tab.state
        if state.frames is None or state.frames_suggested or suspect.frame not in state.frames:
            frames = suspect.frames if len(suspect.frames) > 1 else None
            self._tab.set(frames=frames, frames_suggested=True)
        self._tab.say(capitalized(suspect.reason))

    @property
    def on_show(self) -> Suspect | None:
        """The entry visited last, while one of its frames is on show and no others are selected."""
        last, state = self._last, self._tab.state
        own = last is not None and (state.frames is None or (state.frames_suggested and state.frames == last.frames))
        return last if last is not None and own and state.frame in last.frames else None

    @property
    def fine(self) -> bool:
        """Whether what `dismiss` would mark as fine is marked so."""
        shown = self.on_show
        if shown is None:
            return self.are("checked", self._tab.chosen_frames)
        marks = self._tab.session.project.marks.of_limbs()
        return all(frame in marks.get(limb, {}) for limb in shown.about for frame in shown.frames)

    @property
    def approved(self) -> str:
        """Approver of the clip's present state; empty if not approved."""
        project = self._tab.session.project
        versions = project.review.version, project.keypoints_version, project.runs.version
        now = self._tab.once("review of the clip", versions, lambda: project.review.now)
        return "" if now.approved is None or now.altered else now.approved_by

    def approve(self) -> None:
        """Approve the clip as it is now, or withdraw the approval. Raises InputError without a finished fit."""
        tab = self._tab
        project = tab.session.project
        if self.approved:
            project.review.withdraw()
            tab.say("No longer approved")
            return
        if tab.session.jobs or tab.session.edit_follower.busy:
            raise InputError("The clip is being fitted: wait for that, look at it, and approve it then.")
        self.refuse_unfinished()
        project.review.approve(tab.reviewer)
        tab.say(f"Approved by {tab.reviewer}. Shift+O withdraws it")

    def leave_approved(self) -> None:
        """Approve the clip unless it is approved, and go to the next clip. Raises InputError as `approve` does."""
        if not self.approved:
            self.approve()
        self.leave("next")

    def refuse_unfinished(self) -> None:
        """Raise InputError if no fit of the clip is finished."""
        if not any(run.state == "finished" and run.kind != "imported" for run in self._tab.session.fits.runs):
            raise InputError("There is no finished fit that could be approved.")

    def leave(self, to: Literal["list", "next", "previous"]) -> None:
        """Have the page go to the list of clips, or to another clip. Raises InputError if it is missing."""
        self.refuse_without_list()
        self._tab.channel.ask(Leave(to=to))

    def refuse_without_list(self) -> None:
        """Raise InputError if this is no clip of a list."""
        if not self._tab.in_list:
            raise InputError(
                "One clip was opened, so there is no other one: tcfit review FOLDER opens all in a folder."
            )

    def are(self, state: MarkState, frames: Sequence[int]) -> bool:
        """Whether all of these frames have this mark."""
        marks = self._tab.session.project.marks.all()
        return all(frame in marks and marks[frame].state == state for frame in frames)

    def flag(self) -> None:
        """Flag the selected frames, or the one on show; unflag them if all are flagged."""
        tab, frames = self._tab, self._tab.frames_to_change
        flagged = self.are("flag", frames)
        tab.session.project.marks.set(frames, None if flagged else "flag", author=tab.author)
        where = in_words(frames, tab.first_frame)
        tab.say(f"Flag removed: {where}" if flagged else f"Flagged: {where}. Press T again to remove it")

    def dismiss(self) -> None:
        """Mark the entry on show as fine, and go to the next one; or the selected frames. If that is marked already,
        unmark it. Flagged frames among several selected ones keep their flag."""
        tab, shown = self._tab, self.on_show
        if shown is None:
            return self._dismiss_frames()
        if self.fine:
            self._mark([shown], None)
            tab.say(f"No longer marked as looking fine: {self.subject(shown)}")
            return
        queue = self.suspects or ()  # before marking, which rebuilds it
        self._mark([shown], "checked")
        tab.say(f"Looks fine: {self.subject(shown)}. Press Ctrl+Z to undo")
        at = next((i for i, suspect in enumerate(queue) if self._is_last(suspect)), self._place)
        rest = [suspect for suspect in (*queue[at + 1 :], *queue[:at]) if not _within(suspect, shown)]
        if rest:
            self.show(rest[0])
            self._place = sum(not _within(suspect, shown) for suspect in queue[: queue.index(rest[0])])

    def _dismiss_frames(self) -> None:
        tab, frames = self._tab, self._tab.frames_to_change
        if self.are("checked", frames):
            tab.session.project.marks.set(frames, None, author=tab.author)
            tab.say(f"No longer marked as looking fine: {in_words(frames, tab.first_frame)}")
            return
        marks = tab.session.project.marks.all()
        fine = [f for f in frames if len(frames) == 1 or f not in marks or marks[f].state != "flag"]
        flagged = len(frames) - len(fine)
        if not fine:
            raise InputError("All of these frames are flagged: remove the flags first (T).")
        tab.session.project.marks.set(fine, "checked", author=tab.author)
        but = f", except {flagged} flagged" if flagged else ""
        tab.say(f"Looks fine{but}: {in_words(fine, tab.first_frame)}. Press O again to undo")

    def dismiss_listed(self) -> None:
        """Mark all listed entries as fine, except for those with flagged frames; one undo reverts it."""
        marks = self._tab.session.project.marks.all()
        flagged = {frame for frame, mark in marks.items() if mark.state == "flag"}
        found = [suspect for suspect in self.suspects or () if flagged.isdisjoint(suspect.frames)]
        if not found:
            raise InputError("No entry is listed that has no flag.")
        self._mark(found, "checked")
        self._tab.say(f"Entries that look fine: {len(found)}. Press Ctrl+Z to undo")

    def subject(self, suspect: Suspect) -> str:
        """What is marked as fine with an entry: "left arm, frames 3–8"."""
        what = WHOLE if WHOLE in suspect.about else ", ".join(suspect.about)
        return f"{what}, {in_words(suspect.frames, self._tab.first_frame)}"

    def _mark(self, suspects: Sequence[Suspect], state: MarkState | None) -> None:
        limbs: dict[int, set[str]] = {}
        for suspect in suspects:
            for frame in suspect.frames:
                limbs.setdefault(frame, set()).update(suspect.about)
        frames = sorted(limbs)
        tab = self._tab
        tab.session.project.marks.set(frames, state, limbs=[tuple(sorted(limbs[f])) for f in frames], author=tab.author)


def kinds_of(suspects: Sequence[Suspect]) -> Counter[str]:
    """How many entries there are of each kind, in the order of FINDINGS."""
    counted = Counter(suspect.kind for suspect in suspects)
    return Counter({kind: counted[kind] for kind in FINDINGS if counted[kind]})


def _within(suspect: Suspect, other: Suspect) -> bool:
    """Whether an entry is no more once another one looks fine."""
    return {*suspect.frames} <= {*other.frames} and {*suspect.about} <= {*other.about}
