"""Correcting keypoints in one tab: what its gestures and keys mean for the log of edits."""

import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, GROUPS
from tcfit_app.analysis.body_regions import full_name
from tcfit_app.fitting.fits import Shown
from tcfit_app.fitting.worker import Drag
from tcfit_app.project.edits.edit_log import LogEntry, Redo, Undo
from tcfit_app.project.edits.kinds import (
    SIDES,
    CopyFrom,
    Edit,
    Interpolate,
    MarkBad,
    MoveKeypoint,
    Nudge,
    Reset,
    Restore,
    SetConfidence,
    SwapSides,
)
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.browser.page_events import Drag as DragEvent
from tcfit_app.review.tab.tab import Tab

_FEW = 3
"""Keypoints that are named one by one."""


class _Dragging:
    """Keypoints under the pointer."""

    def __init__(self, frame: int, joints: tuple[int, ...], xy: Float[np.ndarray, "n 2"], shown: Shown | None) -> None:
        self.frame, self.joints, self.start, self.shown = frame, joints, xy, shown
        self.xy = xy
        self.follower: Drag | None = None
        """What the fit follows; None: there is no fit that could."""


class Correcting:
    """The corrections of one tab; its methods raise InputError for what cannot be done, and then nothing changes."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._dragging: _Dragging | None = None

    @property
    def dragging(self) -> bool:
        """Whether keypoints are under this tab's pointer."""
        return self._dragging is not None

    def take(self, event: DragEvent) -> None:
        """A drag in the page begins, goes on or ends."""
        if event.phase == "start":
            self._begin(event)
        dragging = self._dragging
        if dragging is None:
            return
        dragging.xy = dragging.start + np.array([event.dx, event.dy])
        if event.phase == "cancel":
            self.abandon()
        elif event.phase == "end":
            self._release(dragging)
        elif dragging.follower is not None:
            dragging.follower.move(dragging.xy)

    def _begin(self, event: DragEvent) -> None:
        self.abandon()
        tab = self._tab
        if not event.joints or event.frame >= tab.length:
            return
        tab.refuse_read_only()
        tab.session.refuse_without_keypoints()
        corrected = tab.session.project.corrected
        there = [j for j in event.joints if corrected.confidence[event.frame, j] > 0]
        joints = tuple(there or event.joints)
        tab.pause()
        xy = corrected.xy[event.frame, list(joints)] + np.array([event.dx, event.dy])
        shown = tab.look().b
        start = corrected.xy[event.frame, list(joints)]
        self._dragging = _Dragging(event.frame, joints, start, shown)
        if shown is not None:
            self._dragging.follower = tab.session.following.begin_drag(shown, event.frame, joints, xy)

    def _release(self, dragging: _Dragging) -> None:
        self._dragging = None
        edit = MoveKeypoint(
            frames=(dragging.frame,), joints=dragging.joints, xy=(tuple((float(x), float(y)) for x, y in dragging.xy),)
        )
        tab = self._tab
        if dragging.follower is not None:
            dragging.follower.move(dragging.xy)  # its last move may be a tick before the place that is saved
        tab.session.release(dragging.follower, edit, author=tab.author, shown=dragging.shown)
        self._saved(edit, dragging.shown)

    def abandon(self) -> None:
        """End a drag without an edit: the user cancelled it, or the page is gone."""
        if self._dragging is not None and self._dragging.follower is not None:
            self._dragging.follower.abandon()
        self._dragging = None

    def select_all(self) -> None:
        """Select the keypoints on show: of the groups and confidences that are, in any of the chosen frames."""
        state = self._tab.state
        if state.mode == "space":
            raise InputError("In 3D no keypoints are on show: go to Edit or A | B first (1 or 2).")
        if not state.keypoints:
            raise InputError("Keypoints are hidden: show them first (K).")
        confidence = self._tab.session.project.corrected.confidence[list(self._tab.chosen_frames)].max(0)
        there = (confidence > 0) & (confidence >= state.minimum)
        chosen = (j for name, part in GROUPS.items() if name in state.groups for j in range(COUNT)[part] if there[j])
        self._tab.set(selection=tuple(chosen))

    def toggle_bad(self) -> None:
        """Mark the selected keypoints as bad, or restore them if all of them are."""
        joints, frames = self._selected(), self._tab.chosen_frames
        corrected = self._tab.session.project.corrected
        bad = corrected.bad[np.ix_(frames, joints)].all()
        self._make(Restore(frames=frames, joints=joints) if bad else MarkBad(frames=frames, joints=joints))

    def mark_group_bad(self, group: str) -> None:
        """Mark a whole group (`keypoints.GROUPS`) as bad."""
        part = GROUPS[group]
        self._make(MarkBad(frames=self._tab.chosen_frames, joints=tuple(range(part.start, part.stop))))

    def restore_group(self, group: str) -> None:
        """Restore a whole group."""
        part = GROUPS[group]
        self._make(Restore(frames=self._tab.chosen_frames, joints=tuple(range(part.start, part.stop))))

    def swap_sides(self, name: str) -> None:
        """Exchange left and right of a part of SIDES."""
        self._make(SwapSides(frames=self._tab.chosen_frames, joints=SIDES[name]))

    def copy_previous(self) -> None:
        """Take the selected keypoints from the frame before this one, or before the selected ones."""
        frames, joints = self._tab.chosen_frames, self._selected()
        source = frames[0] - 1
        if source < 0:
            raise InputError("There is no frame before the first one to copy from.")
        self._refuse_missing((source,), joints, "copied")
        self._make(CopyFrom(frames=frames, joints=joints, source=source))

    def interpolate(self) -> None:
        """Put the selected keypoints on a line: inside the selected frames, or between the corrected ones around."""
        joints = self._selected()
        first, last = self._ends(joints)
        if last - first < 2:
            raise InputError("There is no frame in between. Select a longer range, or correct frames further apart.")
        self._make(Interpolate.between(first, last, joints))

    def _ends(self, joints: tuple[int, ...]) -> tuple[int, int]:
        state = self._tab.state
        if state.frames is not None:
            return state.frames[0], state.frames[-1]
        edited = np.flatnonzero(self._tab.session.project.corrected.edited[:, list(joints)].all(1))
        before, after = edited[edited < state.frame], edited[edited > state.frame]
        if not len(before) or not len(after):
            raise InputError(
                "Interpolating needs a frame before and a frame after this one in which the selected keypoints were "
                "corrected, or a selected range of frames."
            )
        return int(before[-1]), int(after[0])

    def nudge(self, dx: float, dy: float) -> None:
        """Move the selected keypoints by some pixels in this frame."""
        self._refuse_missing((self._tab.state.frame,), self._selected(), "moved")
        self._make(Nudge(frames=(self._tab.state.frame,), joints=self._selected(), by=(dx, dy)))

    def reset(self) -> None:
        """Back to what was detected."""
        self._make(Reset(frames=self._tab.chosen_frames, joints=self._selected()))

    def set_confidence(self, confidence: float) -> None:
        """Say how sure the selected keypoints are."""
        self._refuse_missing(self._tab.chosen_frames, self._selected(), "given a confidence")
        self._make(SetConfidence(frames=self._tab.chosen_frames, joints=self._selected(), confidence=confidence))

    def undo(self) -> None:
        """Take back the project's last edit, and show where it was."""
        self._refuse_while_dragging()
        tab = self._tab
        entry = tab.session.undo(author=tab.author, shown=tab.look().b)
        self._went_back(entry, "Undone", "There is nothing to undo.")

    def redo(self) -> None:
        """Bring back the edit that was undone last, and show where it is."""
        self._refuse_while_dragging()
        tab = self._tab
        entry = tab.session.redo(author=tab.author, shown=tab.look().b)
        self._went_back(entry, "Redone", "There is nothing to redo.")

    def _went_back(self, entry: LogEntry | None, verb: str, nothing: str) -> None:
        if entry is None:
            raise InputError(nothing)
        assert not isinstance(entry.action, Undo | Redo)
        edit, tab = entry.action, self._tab
        tab.pause()
        if tab.state.frame not in edit.frames:
            tab.seek(edit.frames[0])
        tab.set(selection=edit.joints if len(edit.joints) <= _FEW else tab.state.selection)
        whose = "" if entry.author == tab.author else " (made in another tab)"
        tab.say(f"{verb}: {describe(edit, tab.first_frame)}{whose}")

    def _selected(self) -> tuple[int, ...]:
        if not self._tab.state.selection:
            raise InputError("Select keypoints first: click one, or draw a rectangle with Shift.")
        return self._tab.state.selection

    def _refuse_missing(self, frames: tuple[int, ...], joints: tuple[int, ...], what: str) -> None:
        if (self._tab.session.project.corrected.confidence[np.ix_(frames, joints)] > 0).any():
            return
        where = in_words(frames, self._tab.first_frame)
        raise InputError(f"Nothing to be {what}: none of the selected keypoints is anywhere in {where}.")

    def _refuse_while_dragging(self) -> None:
        """The end of the drag would undo what is done to its keypoints meanwhile."""
        if self.dragging:
            raise InputError("A keypoint is being dragged: let go of it first, or give it up with Esc.")

    def _make(self, edit: Edit) -> None:
        self._refuse_while_dragging()
        tab = self._tab
        tab.refuse_read_only()
        tab.pause()
        shown = tab.look().b
        tab.session.edit(edit, author=tab.author, shown=shown)
        self._saved(edit, shown)

    def _saved(self, edit: Edit, shown: Shown | None) -> None:
        """An edit is on the disk, and the fit that was on show follows it."""
        self._tab.say(f"Saved: {describe(edit, self._tab.first_frame)}")
        self._tab.corrected = None if shown is None else shown.run.id


VERBS: dict[type[Edit], str] = {
    MoveKeypoint: "moved",
    Nudge: "nudged",
    MarkBad: "marked bad",
    Restore: "restored",
    SwapSides: "left and right swapped:",
    CopyFrom: "copied",
    Interpolate: "interpolated",
    Reset: "reset to the detection",
    SetConfidence: "confidence set",
}


def describe(edit: Edit, first_frame: int = 0) -> str:
    """An edit in words: what, which keypoints, which frames, the first of which has the number `first_frame`."""
    names = [full_name(j) for j in edit.joints]
    what = ", ".join(names) if len(names) <= _FEW else f"{len(names)} keypoints"
    verb = VERBS[type(edit)]
    where = in_words(edit.frames, first_frame)
    return f"{verb} {what}, {where}" if verb.endswith(":") else f"{what} {verb}, {where}"
