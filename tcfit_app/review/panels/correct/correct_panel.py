"""The Correct panel: what can be done with the selected keypoints, and the corrections made."""

from functools import partial
from typing import ClassVar

import viser

from fitting_core.keypoints import COUNT, PARTS
from tcfit_app.analysis.body_regions import full_name
from tcfit_app.project.edits.edit_log import LogEntry, Redo, Said, Undo
from tcfit_app.project.edits.kinds import SWAPPABLE
from tcfit_app.project.edits.remarks import Remark
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.gestures.actions import Gestures, refusal
from tcfit_app.review.gestures.correcting_depth import limbs_of
from tcfit_app.review.gestures.edit_words import capitalized, describe, keypoints_in_words, part_name, whose
from tcfit_app.review.panels.correct.hand_shapes import HandShapes
from tcfit_app.review.panels.correct.selection import sentence, states
from tcfit_app.review.panels.elements.field import Dropdown
from tcfit_app.review.panels.elements.fold import Fold
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    action,
    action_item,
    button,
    heading,
    line,
    menu_button,
    opener,
    paragraph,
    row,
    table,
)
from tcfit_app.review.panels.elements.selected_frames import unseen
from tcfit_app.review.panels.fit.fit_texts import when
from tcfit_app.review.tab.tab import Tab

_BY_NAME = "Find by name"
_HOW = "Click a keypoint and drag it: the fit follows. Shift-drag draws a rectangle."
_JOINTS = {full_name(joint): joint for joint in range(COUNT)}
"""Keypoints by their names in the dropdown."""
assert len(_JOINTS) == COUNT
SHOWN = 12
"""Number of edits listed."""
_FOLLOW = "After an edit, its frame and the frames around it are refitted"


class CorrectPanel:
    """What acts on the selection, and the history."""

    title: ClassVar[str] = "Correct"
    icon: ClassVar[viser.IconName] = viser.Icon.PENCIL

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._action = gestures, partial(action, gestures)
        self._tab = tab = gestures.tab
        gui = tab.client.gui
        self._head = Board(tab)
        names = gui.add_dropdown("Keypoint", (_BY_NAME, *_JOINTS), hint="Type a part of the name to find it")
        self._name = Dropdown(tab, names, self._select, lambda: _BY_NAME, when=lambda: not tab.state.selection)
        self._buttons = Board(tab)
        self._shapes = HandShapes(gestures)
        self._depth_fold = Fold(tab, "depth")
        with self._depth_fold:
            self._depth = Board(tab)
        self._always = Board(tab)
        self._corrections_fold = Fold(tab, "corrections")
        with self._corrections_fold:
            self._corrections = Board(tab)

    def _select(self, name: str) -> None:
        if name in _JOINTS:
            self._tab.set(selection=(_JOINTS[name],))

    def draw(self) -> None:
        """Update from the tab's state."""
        tab, project = self._tab, self._tab.session.project
        writable = not project.read_only and project.has_detections
        able = bool(tab.state.selection) and writable and not tab.hidden_frames_chosen
        fitted = able and tab.shown.b is not None and tab.corrected_view is None
        self._head.show(*self._heading())
        self._name.draw()
        self._buttons.show(*self._of_keypoints() if able else [])
        self._shapes.draw(on=fitted and not refusal(self._gestures.shaping.side))
        if self._depth_fold.draw("Depth, pin, lock", on=fitted):
            self._depth.show(*self._in_depth())
        self._always.show(*[self._of_frames()] if writable and tab.corrected_view is None else [])
        done = project.standing.counted(project.last_edit)
        if self._corrections_fold.draw(f"Corrections ({done})"):
            self._corrections.show(*self._history())

    def _heading(self) -> list[Html]:
        """What is selected, in which frames, and its state."""
        tab, selection = self._tab, self._tab.state.selection
        project = tab.session.project
        parts = [*self._compared()]
        moving = tab.state.playing and tab.state.frames is None  # otherwise it would change with each frame
        frames = "the frame on show" if moving else in_words(tab.chosen_frames, tab.first_frame)
        if not project.has_detections:
            parts += [heading("No keypoints yet", first=True), paragraph("Find or import them in the panel Start.")]
        elif not selection:
            parts += [heading("Nothing selected", frames, first=True), paragraph(_HOW, "dim")]
        else:
            what = f"{tab.someone.name}: " * bool(tab.someone.others) + keypoints_in_words(selection)
            view = tab.corrected_view
            where = "" if view is None else f" in {view.view.clip.name}"
            parts.append(heading(capitalized(what) + where, frames, first=True))
            if not moving:
                parts.append(paragraph(sentence(tab)))
        parts += unseen(tab)
        if project.read_only:
            parts.append(paragraph("Opened read-only: nothing can be changed.", "warn"))
        elif project.has_detections and not tab.session.fits.showable():
            parts += [paragraph("There is no fit yet."), row(self._action("panel_fit", "Go to Fit"))]
        return parts

    def _compared(self) -> list[Html]:
        """Which of two fits is corrected."""
        tab = self._tab
        if tab.state.mode != "ab" or tab.shown.b is None:
            return []
        return [paragraph(f"Corrections go to {tab.shown.b.run.name}.", "dim")]

    def _of_keypoints(self) -> list[Html]:
        act, gestures = self._action, self._gestures
        more = [action_item(gestures, name) for name in ("copy", "delete_key", "keyframes", "hand_along")]
        bad = not self._tab.state.playing and [*states(self._tab)] == ["marked bad"]
        first = row(act("bad", "Restore" if bad else "Mark bad"), act("reset", "Reset"))
        if self._tab.corrected_view is not None:
            return [first]
        return [
            first,
            row(act("interpolate"), menu_button("More ▾", "correct.more", more)),
        ]

    def _in_depth(self) -> list[Html]:
        """What acts on the selection in depth, as far as it can."""
        act, gestures = self._action, self._gestures
        limb = not refusal(limbs_of, self._tab.state.selection)
        lockable = not refusal(gestures.depth.lockable)
        where = "for the whole clip" if self._tab.state.frames is None else "for the selected frames"
        way = "Unlock" if lockable and gestures.depth.locked_throughout else "Lock"
        return [
            *([row(act("keep", f"Keep {where}"))] if gestures.depth.can_keep else []),
            *([row(act("release", "Remove the offset"))] if gestures.depth.kept() else []),
            *([row(act("mirror_depth"), act("in_front", "In front"), act("behind", "Behind"))] if limb else []),
            *([row(act("clear_depth"))] if limb else []),
            row(act("pin", "Pin in space")),
            *([row(act("lock", "Lock rotation"), act("unlock", "Unlock"))] if lockable else []),
            *([row(act("lock_throughout", f"{way} in all frames"))] if lockable else []),
        ]

    def _of_frames(self) -> Html:
        """The menus that need no selected keypoint."""
        gestures = self._gestures
        swaps = [action_item(gestures, f"swap_{part}", part.capitalize()) for part in SWAPPABLE]
        names = {part: part_name(part).capitalize() for part in PARTS}
        detect = (
            *(action_item(gestures, f"detect_{part}", name) for part, name in names.items()),
            None,
            *(action_item(gestures, f"frame_{part}", f"{name} in a rectangle") for part, name in names.items()),
        )
        return row(
            menu_button("Detect again ▾", "correct.detect", detect),
            menu_button("Swap left and right ▾", "correct.swap", swaps),
        )

    def _history(self) -> list[Html]:
        tab, project = self._tab, self._tab.session.project
        follow = button(
            "Fit follows edits",
            "correct.follow",
            do=self._follow_or_not,
            pressed=tab.session.edit_follower.after_edits,
            disabled=project.read_only,
            hint=_FOLLOW,
        )
        key = project.keypoints_version, project.marks_version, tab.author
        return [row(follow), tab.once("history", key, lambda: history(tab))]

    def _follow_or_not(self) -> None:
        follower = self._tab.session.edit_follower
        follower.after_edits = not follower.after_edits


def history(tab: Tab) -> Html:
    """The latest edits, newest first; a row leads to its frame, and undone edits are marked."""
    edits = tab.session.project.last_said(SHOWN)
    return table(_edit_line(tab, entry) for entry in edits) if edits else paragraph("No corrections yet.", "dim")


def _edit_line(tab: Tab, entry: LogEntry) -> Html:
    edit, done, first = entry.action, tab.session.project.standing.stood(entry.id), tab.first_frame
    assert not isinstance(edit, Undo | Redo)
    visit = opener(describe(edit, first), "correct.visit", str(entry.id), partial(_visit, tab, edit))
    return line(
        when(entry.time),
        whose(entry.author, tab.author),
        visit,
        whole=(0, 1),
        kind="" if done else "off",
        press=visit,
        hint=f"{'' if done else 'Undone. '}Go to frame {first + edit.frames[0]}",
    )


def _visit(tab: Tab, edit: Said) -> None:
    tab.pause()
    tab.seek(edit.frames[0])
    if not isinstance(edit, Remark):
        tab.set(selection=edit.joints)
