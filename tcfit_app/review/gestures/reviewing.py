"""Stepping through a clip's suspicious frames in one tab."""

from collections.abc import Sequence
from typing import Literal

from fitting_core.errors import InputError
from tcfit_app.analysis.suspicion import Suspect
from tcfit_app.project.edits.edit_log import MarkState
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.browser.page_states import Leaving
from tcfit_app.review.tab.tab import Tab


class Reviewing:
    """The review queue of one tab, for the fit that corrections apply to."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._last: Suspect | None = None
        self._place = -1
        """Position of that entry in the queue: when it has left, the next entry has this position."""

    @property
    def suspects(self) -> tuple[Suspect, ...] | None:
        """Suspicious frames, worst first; None while they are being computed, or without a fit."""
        shown = self._tab.shown.b
        return None if shown is None else self._tab.data.suspects(shown)

    def go(self, step: int) -> None:
        """Go to the next (1) or previous (-1) queue entry. Raises InputError while the queue is being computed."""
        suspects = self.suspects
        if not suspects:
            raise InputError("Suspicious frames are still being looked for. Try again in a moment.")
        gone = self._place - (step > 0) if self._last is not None else -(step > 0)
        at = next((i for i, suspect in enumerate(suspects) if self._is_last(suspect)), gone)
        self.show(suspects[(at + step) % len(suspects)])

    def _is_last(self, suspect: Suspect) -> bool:
        last = self._last
        return last is not None and (suspect.frame, suspect.kind) == (last.frame, last.kind)

    def show(self, suspect: Suspect) -> None:
        """Go to an entry, and select its keypoints."""
        self._last = suspect
        self._place = next((i for i, known in enumerate(self.suspects or ()) if self._is_last(known)), self._place)
        self._tab.pause()
        self._tab.seek(suspect.frame)
        self._tab.set(selection=suspect.joints, suggested=True)
        if self._tab.state.frames is not None and suspect.frame not in self._tab.state.frames:
            self._tab.set(frames=None)  # otherwise "looks fine" would apply to frames that are not on show
        self._tab.say(suspect.reason)

    @property
    def _on_show(self) -> Suspect | None:
        """The entry visited last, while one of its frames is on show and no others are selected."""
        last, state = self._last, self._tab.state
        return last if last is not None and state.frames is None and state.frame in last.frames else None

    @property
    def dismissed(self) -> tuple[int, ...]:
        """The frames that `dismiss` marks as fine."""
        shown = self._on_show
        return tuple(shown.frames if shown is not None else self._tab.chosen_frames)

    @property
    def approved(self) -> str:
        """Who has approved the clip as it is now; empty if nobody has."""
        project = self._tab.session.project
        versions = project.review.version, project.keypoints_version, project.runs.version
        now = self._tab.once("review of the clip", versions, lambda: project.review.now)
        return "" if now.approved is None or now.altered else now.approved_by

    def approve(self) -> None:
        """The clip is done, as it is now; or that is taken back. Raises InputError while there is no fit of it."""
        tab = self._tab
        project = tab.session.project
        if self.approved:
            project.review.withdraw()
            tab.say("No longer approved")
            return
        if tab.session.jobs or tab.session.edit_follower.busy:
            raise InputError("The clip is being fitted: wait for that, look at it, and approve it then.")
        if not any(run.state == "finished" and run.kind != "imported" for run in project.runs.all()):
            raise InputError("There is no finished fit that could be approved.")
        project.review.approve(tab.browser.reviewer)
        tab.say(f"Approved by {tab.browser.reviewer}. Shift+O takes it back")

    def leave(self, to: Literal["list", "next", "previous"]) -> None:
        """Have the page go to the list of clips, or to another one of them. Raises InputError if there is none."""
        self.refuse_without_list()
        self._tab.channel.ask("leaving", Leaving(to=to))

    def refuse_without_list(self) -> None:
        """Raise InputError if this is no clip of a list."""
        if not self._tab.browser.in_list:
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
        tab.session.mark(frames, None if flagged else "flag", author=tab.author)
        where = in_words(frames, tab.first_frame)
        tab.say(f"Flag removed: {where}" if flagged else f"Flagged: {where}. Press T again to remove it")

    def dismiss(self) -> None:
        """Mark the frames of the entry on show, or those selected, as fine, and go to the next entry; or unmark them if
        all are marked. Flagged frames among several keep their flag."""
        tab = self._tab
        shown = self._on_show
        frames = self.dismissed if shown is not None else tab.frames_to_change
        if self.are("checked", frames):
            tab.session.mark(frames, None, author=tab.author)
            tab.say(f"No longer marked as looking fine: {in_words(frames, tab.first_frame)}")
            return
        marks = tab.session.project.marks.all()
        fine = [f for f in frames if len(frames) == 1 or f not in marks or marks[f].state != "flag"]
        flagged = len(frames) - len(fine)
        if not fine:
            raise InputError("All of these frames are flagged: remove the flags first (T).")
        # Before marking, which rebuilds the queue.
        queue = self.suspects or ()
        tab.session.mark(fine, "checked", author=tab.author)
        but = f", except {flagged} flagged" if flagged else ""
        tab.say(f"Looks fine{but}: {in_words(fine, tab.first_frame)}. Press O again to undo")
        if shown is None:
            return
        at = next((i for i, suspect in enumerate(queue) if self._is_last(suspect)), self._place)
        rest = [suspect for suspect in (*queue[at + 1 :], *queue[: at + 1]) if suspect.frame not in frames]
        if rest:
            self.show(rest[0])
            self._place = sum(suspect.frame not in frames for suspect in queue[: queue.index(rest[0])])
