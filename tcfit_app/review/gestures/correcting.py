"""Correcting keypoints in one tab: turns gestures and keys into edits of the log."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.body.model import JOINT
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.errors import InputError
from fitting_core.fit.evidence.sides import unswapped, unswapped_keypoint
from fitting_core.keypoints import COUNT, GROUPS
from tcfit_app.fitting.fits import Shown
from tcfit_app.fitting.live import Target
from tcfit_app.fitting.worker import LiveDrag
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.edit_log import LogEntry, Redo, Undo
from tcfit_app.project.edits.kinds import (
    SWAPPABLE,
    CopyFrom,
    Edit,
    Interpolate,
    KeypointEdit,
    MarkBad,
    MoveKeypoint,
    Nudge,
    PlaceKey,
    Reset,
    Restore,
    SwapSides,
)
from tcfit_app.project.edits.remarks import Remark
from tcfit_app.project.edits.space_edits import MAX_DEPTH
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.other_view import ProjectView
from tcfit_app.project.project import Project
from tcfit_app.review.browser.page_events import Drag as DragEvent
from tcfit_app.review.browser.page_events import DragDepth as DragDepthEvent
from tcfit_app.review.gestures.edit_words import FEW, describe, whose
from tcfit_app.review.gestures.keyframing import depth_edit, filled, keys_in, moved, placed, removed, with_hands
from tcfit_app.review.tab.tab import LONG, Tab

NUDGES = (1, 10)
"""Pixels of a nudge."""
_SERIES = 1.0
"""Seconds between two nudges of a series, which are undone and redone together."""


@dataclass(kw_only=True, eq=False)
class _Dragging:
    """Keypoints under the pointer."""

    frame: int
    joints: tuple[int, ...]
    start: Target
    """Positions at the press."""
    target: Target
    """Current positions."""
    in_depth: bool = False
    view: ProjectView | None = None
    """Whose they are, if another view's."""
    shown: Shown | None
    drag: LiveDrag | None = None
    """The live fit that follows, if any."""


class Correcting:
    """The corrections of one tab. Methods raise InputError for what cannot be done, and then change nothing."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._dragging: _Dragging | None = None
        self._asked: tuple[str, int, float] | None = None
        """The step and the edit of someone else that the user was asked about, and until when."""

    @property
    def dragging(self) -> bool:
        """Whether keypoints are being dragged in this tab."""
        return self._dragging is not None

    def take(self, event: DragEvent | DragDepthEvent) -> None:
        """A drag in the page starts, continues or ends."""
        if event.phase == "start":
            self._begin(event)
        dragging, in_depth = self._dragging, isinstance(event, DragDepthEvent)
        if dragging is None or dragging.in_depth != in_depth:
            return
        by = np.array([event.metres]) if isinstance(event, DragDepthEvent) else np.array([event.dx, event.dy])
        dragging.target = dragging.start + by
        if in_depth:
            dragging.target = np.clip(dragging.target, -MAX_DEPTH, MAX_DEPTH)
        if event.phase == "cancel":
            self.abandon()
        elif event.phase == "end":
            self._release(dragging)
        elif dragging.drag is not None:
            dragging.drag.move(dragging.target)

    def _begin(self, event: DragEvent | DragDepthEvent) -> None:
        self.abandon()
        tab = self._tab
        if event.frame >= tab.length:
            return
        tab.refuse_read_only()
        tab.session.refuse_without_keypoints()
        tab.pause()
        if isinstance(event, DragDepthEvent):
            self._begin_in_depth(event)
        elif event.joints and event.view:
            self._begin_in_view(event)
        elif event.joints:
            self._begin_in_image(event)

    def _begin_in_depth(self, event: DragDepthEvent) -> None:
        tab = self._tab
        frame, on_show = event.frame, tab.look()
        seen = on_show.b if any("b" in place for place in on_show.places) else on_show.a
        if seen is None or not seen.has(frame):
            return
        joints = across_sides(tab, seen, frame, (event.joint,))
        self.refuse_bad((frame,), joints)
        body, params = tab.session.bodies.of(seen.run.body), seen.params[[frame]]
        depth = keypoints_in_space(body, params)[0][0, [event.joint], 2]
        start = depth - joints_in_space(body, params)[0, JOINT["pelvis"], 2]
        self._dragging = _Dragging(
            frame=frame, joints=joints, start=start, target=start, in_depth=True, shown=on_show.b
        )
        if on_show.b is not None:
            follower = tab.session.edit_follower
            self._dragging.drag = follower.begin_drag(on_show.b, frame, joints, start, in_depth=True)

    def _begin_in_image(self, event: DragEvent) -> None:
        tab = self._tab
        corrected = tab.session.project.corrected
        there = [j for j in event.joints if corrected.confidence[event.frame, j] > 0]
        joints = tuple(there or event.joints)
        xy = corrected.xy[event.frame, list(joints)] + np.array([event.dx, event.dy])
        shown = tab.look().b
        start = corrected.xy[event.frame, list(joints)]
        self._dragging = _Dragging(frame=event.frame, joints=joints, start=start, target=xy, shown=shown)
        if shown is not None:
            self._dragging.drag = tab.session.edit_follower.begin_drag(shown, event.frame, joints, xy)

    def _begin_in_view(self, event: DragEvent) -> None:
        view = self._tab.view
        if view is None or (frame := self._tab.frame_in(view, event.frame)) is None:
            return
        start, shown = view.corrected.xy[frame, list(event.joints)], self._tab.look().b
        self._dragging = _Dragging(frame=frame, joints=event.joints, start=start, target=start, view=view, shown=shown)

    def _release(self, dragging: _Dragging) -> None:
        self._dragging = None
        if (view := dragging.view) is not None:
            xy = tuple((x, y) for x, y in dragging.target.tolist())
            edit = MoveKeypoint(frames=(dragging.frame,), joints=dragging.joints, xy=(xy,))
            return self.keep(self._tab.session.project.edit_of_view(view.id, edit))
        tab, frame, joints = self._tab, dragging.frame, dragging.joints
        if dragging.in_depth:
            frames, depths = (frame,), dragging.target[None]
            if tab.state.keyframes:
                frames, depths = filled(tab.session.project.corrected[:, list(joints)].told_depth, frames, depths)
            edit = depth_edit(frames, joints, depths)
        else:
            edit = self._placed(frame, joints, dragging.target)
        if dragging.drag is not None:
            dragging.drag.move(dragging.target)  # its last move may lag a tick behind the position saved
        tab.session.release(dragging.drag, edit, author=tab.author, shown=dragging.shown)
        self._saved(edit, dragging.shown)

    def _placed(self, frame: int, joints: tuple[int, ...], xy: Float[np.ndarray, "n 2"]) -> MoveKeypoint | PlaceKey:
        corrected = self._tab.session.project.corrected
        return placed(corrected, frame, joints, xy, keyframes=self._tab.state.keyframes)

    def abandon(self) -> None:
        """End a drag without an edit: the user cancelled it, or the page closed."""
        if self._dragging is not None and self._dragging.drag is not None:
            self._dragging.drag.abandon()
        self._dragging = None

    def select_all(self) -> None:
        """Select the visible keypoints: of the groups shown, in this frame or any selected one.

        A selection that does not include the frame on show is ignored.
        """
        state = self._tab.state
        frames = [state.frame] if self._tab.hidden_frames_chosen else list(self._tab.chosen_frames)
        if not state.keypoints:
            raise InputError("Keypoints are hidden: show them first (K).")
        confidence = self._tab.session.project.corrected.confidence[frames].max(0)
        there = confidence > 0
        chosen = (j for name, part in GROUPS.items() if name in state.groups for j in range(COUNT)[part] if there[j])
        self._tab.set(selection=tuple(chosen))

    def toggle_bad(self) -> None:
        """Mark the selected keypoints as bad, or restore them if all of them are."""
        corrected, frames, joints = self._chosen()
        bad = corrected.bad[np.ix_(frames, joints)].all()
        self._make_there((Restore if bad else MarkBad)(frames=frames, joints=joints))

    def swap_sides(self, name: str) -> None:
        """Exchange left and right of a part of PAIRED_PARTS."""
        self.make(SwapSides(frames=self._tab.frames_to_change, joints=SWAPPABLE[name]))

    def copy_previous(self) -> None:
        """Copy the selected keypoints from the frame before this one, or before the selected ones."""
        frames, joints = self._tab.frames_to_change, self.selected()
        source = frames[0] - 1
        if source < 0:
            raise InputError("There is no frame before the first to copy from.")
        self._refuse_missing((source,), joints, "copied")
        self.make(CopyFrom(frames=frames, joints=joints, source=source))

    def interpolate(self) -> None:
        """Interpolate the selected keypoints linearly: in the selected frames, or between the corrected ones around."""
        joints = self.selected()
        first, last = self._ends(joints)
        if last - first < 2:
            raise InputError("There is no frame in between. Select a longer range, or correct frames further apart.")
        self.make(Interpolate.between(first, last, joints))

    def _ends(self, joints: tuple[int, ...]) -> tuple[int, int]:
        state = self._tab.state
        if state.frames is not None:
            frames = self._tab.frames_to_change
            return frames[0], frames[-1]
        edited = np.flatnonzero(self._tab.session.project.corrected.edited[:, list(joints)].all(1))
        before, after = edited[edited < state.frame], edited[edited > state.frame]
        if state.frame in edited and len(before):  # the usual way: correct the first, then the last frame
            after = edited[edited == state.frame]
        elif state.frame in edited:
            before = edited[edited == state.frame]
        if not len(before) or not len(after):
            raise InputError(
                "Interpolating needs two frames in which the selected keypoints were corrected (this one or the "
                "nearest on either side), or a selected range of frames."
            )
        return int(before[-1]), int(after[0])

    def nudge(self, dx: float, dy: float) -> None:
        """Move the selected keypoints by a few pixels in this frame."""
        frame, state, joints = self._tab.state.frame, self._tab.state, self.selected()
        self._refuse_missing((frame,), joints, "moved")
        corrected = self._tab.session.project.corrected
        if state.hand_along:
            joints = with_hands(joints, corrected, frame)
        if not state.keyframes:
            return self.make(Nudge(frames=(frame,), joints=joints, by=(dx, dy)))
        present = corrected[frame].present
        there = tuple(joint for joint in joints if present[joint])
        if not there:
            raise InputError("The selected keypoints are marked bad: restore them first (X).")
        self.make(self._placed(frame, there, corrected.xy[frame, list(there)] + np.array([dx, dy])))

    def delete_key(self) -> None:
        """Delete the keyframe of the selected keypoints in this frame, which is then interpolated from others."""
        frame, corrected = self._tab.state.frame, self._tab.session.project.corrected
        self.make(removed(corrected, frame, keys_in(corrected, self.selected(), frame)))

    def move_key(self, frame: int, to: int) -> None:
        """Move the keyframe of the selected keypoints (of all, if none are selected) to another frame."""
        corrected, joints = self._tab.session.project.corrected, self._tab.state.selection or tuple(range(COUNT))
        self.make(moved(corrected, frame, to, keys_in(corrected, joints, frame)))

    def reset(self) -> None:
        """Reset to the detection."""
        _, frames, joints = self._chosen()
        self._make_there(Reset(frames=frames, joints=joints))

    def undo(self) -> None:
        """Undo the project's last edit or mark, a series of nudges as a whole, and show where it was. The first call
        for an edit of someone else only asks."""
        self._step(self._tab.someone.undo, lambda project: project.undoable, ("Undo", "Undone", "Ctrl+Z"))

    def redo(self) -> None:
        """Redo the edit or mark undone last, a series of nudges as a whole, and show where it is. The first call for
        an edit of someone else only asks."""
        self._step(self._tab.someone.redo, lambda project: project.redoable, ("Redo", "Redone", "Ctrl+Y"))

    def _step(
        self,
        step: Callable[..., LogEntry | None],
        next_of: Callable[[Project], LogEntry | None],
        words: tuple[str, str, str],
    ) -> None:
        self.refuse_while_dragging()
        tab, entry, more = self._tab, next_of(self._tab.session.project), True
        if entry is not None and self._asks(entry, *words):
            return
        shown = tab.look().b
        while more:
            entry = step(author=tab.author, shown=tab.look().b)
            more = one_series(entry, next_of(tab.session.project))
        self._went_back(entry, shown, words[1])

    def _asks(self, entry: LogEntry, verb: str, done: str, key: str) -> bool:
        """Show an edit of someone else and ask about it. Returns False once the user has agreed, or made it."""
        asked, self._asked, now = self._asked, None, time.monotonic()
        if entry.author == self._tab.author or (asked is not None and asked[:2] == (done, entry.id) and now < asked[2]):
            return False
        self._asked = done, entry.id, now + LONG
        edit, tab = entry.action, self._tab
        assert not isinstance(edit, Undo | Redo)
        tab.pause()
        if tab.state.frame not in edit.frames:
            tab.seek(edit.frames[0])
        by = whose(entry.author, tab.author)
        tab.say(f"{key} again to {verb.lower()} the edit of {by}: {describe(edit, tab.first_frame)}", LONG)
        return True

    def _went_back(self, entry: LogEntry | None, shown: Shown | None, verb: str) -> None:
        assert entry is not None, "only what can be undone or redone is asked for"
        assert not isinstance(entry.action, Undo | Redo)
        edit, tab = entry.action, self._tab
        tab.pause()
        if tab.state.frame not in edit.frames:
            tab.seek(edit.frames[0])
        if not isinstance(edit, Remark):
            tab.corrected = None if shown is None else shown.run.id
            if len(edit.joints) <= FEW:
                tab.set(selection=edit.joints)
        by = whose(entry.author, tab.author)
        made = {"you": "", "another browser": " (made in another browser)"}.get(by, f" (made by {by})")
        tab.say(f"{verb}: {describe(edit, tab.first_frame)}{made}")

    def selected_anywhere(self) -> tuple[int, ...]:
        """The selected keypoints, also in another view's picture. Raises InputError if no keypoint is selected."""
        if not self._tab.state.selection:
            raise InputError("Select keypoints first: click one, or draw a rectangle with Shift.")
        return self._tab.state.selection

    def selected(self) -> tuple[int, ...]:
        """The selected keypoints. Raises InputError if no keypoint is selected, or in another view's picture."""
        if (view := self._tab.corrected_view) is not None:
            raise InputError(
                f"Keypoints of {view.view.clip.name} can be dragged, marked bad and reset. For anything else select "
                "them in the first picture."
            )
        return self.selected_anywhere()

    def _chosen(self) -> tuple[Corrected, tuple[int, ...], tuple[int, ...]]:
        """The keypoints of the picture in which some are selected, its frames to change, and the selected ones."""
        tab, view = self._tab, self._tab.corrected_view
        joints, frames = self.selected_anywhere(), tab.frames_to_change
        if view is None:
            return tab.session.project.corrected, frames, joints
        if not (there := tab.frames_in(view)):
            raise InputError(f"{view.view.clip.name} shows none of {in_words(frames, tab.first_frame)}.")
        return view.corrected, there, joints

    def _make_there(self, edit: KeypointEdit) -> None:
        """Make an edit of what `_chosen` returned."""
        view = self._tab.corrected_view
        self.make(edit if view is None else self._tab.session.project.edit_of_view(view.id, edit))

    def _refuse_missing(self, frames: tuple[int, ...], joints: tuple[int, ...], what: str) -> None:
        if (self._tab.session.project.corrected.confidence[np.ix_(frames, joints)] > 0).any():
            return
        where = in_words(frames, self._tab.first_frame)
        raise InputError(f"Cannot be {what}: none of the selected keypoints exists in {where}.")

    def refuse_bad(self, frames: tuple[int, ...], joints: tuple[int, ...]) -> None:
        """Raise InputError if all of them are marked bad, so that depth cannot be set."""
        if self._tab.session.project.corrected.bad[np.ix_(frames, joints)].all():
            raise InputError("Keypoints marked bad have no depth: restore them first (X).")

    def refuse_while_dragging(self) -> None:
        """Raise InputError during a drag, whose end would overwrite what is done to its keypoints meanwhile."""
        if self.dragging:
            raise InputError("A keypoint is being dragged: release it first, or cancel with Esc.")

    def make(self, edit: Edit) -> None:
        """Make an edit, announce it, and let the fit follow. Raises InputError if it cannot be made."""
        self.refuse_while_dragging()
        self._tab.refuse_read_only()
        self._tab.pause()
        self.keep(edit)

    def keep(self, edit: Edit, remark: str = "") -> None:
        """The same for an edit begun earlier, during any other work; `remark` is appended to the message."""
        tab, shown = self._tab, self._tab.look().b
        tab.session.edit(edit, author=tab.author, shown=shown)
        self._saved(edit, shown, remark)

    def _saved(self, edit: Edit, shown: Shown | None, remark: str = "") -> None:
        """An edit is stored; make the fit that was on show follow it."""
        obstacle = self._tab.session.edit_follower.obstacle(shown)
        unfollowed = f". The fit does not follow: {obstacle}" if obstacle else ""
        self._tab.say(f"Saved: {describe(edit, self._tab.first_frame)}{remark}{unfollowed}")
        self._tab.corrected = None if shown is None else shown.run.id


def one_series(one: LogEntry | None, other: LogEntry | None) -> bool:
    """Whether two edits that follow each other are nudges of the same keypoints, one right after the other.

    With keyframes, the log has the places where nudges put keypoints, as it has of drags: a nudge is known by its step.
    """
    if one is None or other is None or one.author != other.author:
        return False
    if abs((one.time - other.time).total_seconds()) > _SERIES or type(one.action) is not type(other.action):
        return False
    a, b = one.action, other.action
    if isinstance(a, Nudge) and isinstance(b, Nudge):
        return (a.frames, a.joints) == (b.frames, b.joints)
    if not isinstance(a, PlaceKey) or not isinstance(b, PlaceKey) or (a.at, a.joints) != (b.at, b.joints):
        return False
    steps = np.abs(np.subtract(b.xy, a.xy))
    return bool(np.allclose(steps, steps[0], atol=1e-3)) and any(np.isclose(steps[0].max(), NUDGES, atol=1e-3))


def across_sides(tab: Tab, shown: Shown, frame: int, joints: tuple[int, ...]) -> tuple[int, ...]:
    """The fit's keypoints for detected ones or the other way round: the other side's where it unswapped sides."""
    [pairs] = swapped_sides(tab.session.project, shown, (frame,))
    return tuple(unswapped_keypoint(joint, pairs) for joint in joints)


def swapped_sides(project: Project, shown: Shown, frames: tuple[int, ...]) -> list[list[str]]:
    """For each frame the pairs of limbs whose sides this fit unswapped: names of `sides.PAIRED`."""
    swaps = unswapped(project.clip.keypoints)[1] if shown.run.config.unswap_sides else {}
    return [[name for name, swapped in swaps.items() if frame in swapped] for frame in frames]
