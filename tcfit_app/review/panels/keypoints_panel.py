"""The Keypoints panel: corrects keypoints, and lists the edits."""

from datetime import datetime
from functools import partial
from typing import ClassVar

import numpy as np
import viser

from fitting_core.keypoint_noise import DETECTOR_TITLES
from fitting_core.keypoints import COUNT, GROUPS, LOCKABLE, PARTS, PartOfPerson
from tcfit_app.analysis.body_regions import full_name
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.edit_log import LogEntry, Redo, Remark, Said, Undo
from tcfit_app.project.edits.keyframes import LONGEST_GAP
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.gestures.actions import Gestures, refusal
from tcfit_app.review.gestures.edit_words import depth_words, describe, part_name, whose
from tcfit_app.review.panels.elements.field import Dropdown
from tcfit_app.review.panels.elements.html import (
    GROUP_LABELS,
    Board,
    Html,
    action,
    button,
    choices,
    heading,
    joined,
    line,
    opener,
    paragraph,
    progress_bar,
    row,
    table,
    tag,
    text,
    words,
)
from tcfit_app.review.panels.elements.selected_frames import named, unseen
from tcfit_app.review.panels.hand_shapes import HandShapes
from tcfit_app.review.tab.tab import Tab

_NOTHING = "Select by name"
_SELECT = "Click one in the picture, or draw a rectangle with Shift held."
_NONE_YET = "No keypoints yet: detect or import them in the panel Start."
_KEYFRAMES = f"Between two frames at most {LONGEST_GAP} apart in which a keypoint was moved, it is interpolated"
_SWAPPED = {"arms": "Arms", "legs": "Legs"}
"""Swaps that have no key."""
_JOINTS = {full_name(joint): joint for joint in range(COUNT)}
"""Keypoints by their names in the dropdown."""
assert len(_JOINTS) == COUNT


class KeypointsPanel:
    """Corrections and their history."""

    title: ClassVar[str] = "Keypoints"
    icon: ClassVar[viser.IconName] = viser.Icon.HAND_CLICK

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._action = gestures, partial(action, gestures)
        self._tab = tab = gestures.tab
        gui = tab.client.gui
        self._selected = Board(tab)
        names = gui.add_dropdown("Keypoint", (_NOTHING, *_JOINTS), hint="Type a part of the name to find it")
        self._name = Dropdown(tab, names, self._select, self._selected_name)
        self._buttons = Board(tab)
        self._shapes = HandShapes(gestures)
        self._groups = Board(tab)
        self._unseen, self._again, self._done = Board(tab), Board(tab), Board(tab)

    def _selected_name(self) -> str:
        selection = self._tab.state.selection
        return full_name(selection[0]) if len(selection) == 1 else _NOTHING

    def _select(self, name: str) -> None:
        if name in _JOINTS:
            self._tab.set(selection=(_JOINTS[name],))

    def _select_group(self, name: str) -> None:
        self._tab.set(selection=tuple(range(COUNT)[GROUPS[name]]))

    def _follow_or_not(self) -> None:
        follower = self._tab.session.edit_follower
        follower.after_edits = not follower.after_edits

    def draw(self) -> None:
        """Update from the tab's state."""
        tab, session = self._tab, self._tab.session
        self._name.draw()
        self._selected.show(*selection_table(tab))
        self._draw_buttons(where := self._where())
        self._shapes.draw(where)
        by = session.project.footage.detector if session.project.has_detections else ""
        there = session.project.has_detections
        groups = choices(
            "keypoints.group",
            GROUP_LABELS,
            self._select_group,
            lambda name: None,
            disabled=lambda name: not there,
            hint=lambda name: "Select them",
        )
        self._groups.show(heading("Select a group"), row(*groups, wrap=True), *_detected_by(by))
        self._draw_again(where, looks=not refusal(self._gestures.again.require_detector))
        self._draw_history()

    def _draw_again(self, where: str, *, looks: bool) -> None:
        """What can be detected again, or the progress of that."""
        again = self._gestures.again
        if again.busy and (going := again.going) is not None:
            words = going.title if going.stopping else f"{going.title}: {going.text}"
            stop = self._action("cancel_detecting", "Cancel", disabled=going.stopping, kind="danger")
            self._again.show(heading("Detect again"), paragraph(words), progress_bar(going.share or 0.0), row(stop))
        elif looks:
            self._again.show(
                heading("Detect again", where),
                row(*(self._action(f"detect_{part}", part_name(part).capitalize()) for part in PARTS), wrap=True),
                paragraph("In a rectangle drawn in the picture:", "dim"),
                row(*map(self._framed, PARTS), wrap=True),
            )
        else:
            self._again.show()

    def _framed(self, part: PartOfPerson) -> Html:
        pressed = self._gestures.again.framing == part
        return self._action(f"frame_{part}", part_name(part).capitalize(), pressed=pressed)

    def _refuse(self) -> None:
        """Raise InputError if there is nothing to correct, or nothing can be."""
        self._tab.refuse_read_only()
        self._tab.session.refuse_without_keypoints()

    def _where(self) -> str:
        tab = self._tab
        if tab.state.playing and tab.state.frames is None:  # otherwise it would change with each frame
            return "apply to the frame on show"
        return f"apply to {in_words(tab.chosen_frames, tab.first_frame)}"

    def _bad(self) -> bool:
        """Whether everything selected is marked bad."""
        tab, state = self._tab, self._tab.state
        key = state.selection, tab.chosen_frames, tab.session.project.keypoints_version
        return bool(state.selection) and not state.playing and tab.once("bad", key, self._all_bad)

    def _all_bad(self) -> bool:
        tab = self._tab
        return bool(tab.session.project.corrected.bad[np.ix_(tab.chosen_frames, tab.state.selection)].all())

    def _draw_buttons(self, where: str) -> None:
        tab, act = self._tab, self._action
        off = bool(refusal(self._refuse))
        swap = self._gestures.correcting.swap_sides
        swaps = choices("keypoints.swap", _SWAPPED, swap, lambda name: None, disabled=lambda name: off)
        self._buttons.show(
            heading("Correct", words(f"{where}, not on show", "warn") if tab.hidden_frames_chosen else where),
            row(act("bad", "Restore" if self._bad() else "Mark bad"), act("reset", "Reset")),
            row(act("copy", "Copy previous"), act("interpolate")),
            paragraph("Swap left and right:", "dim"),
            row(act("swap_body", "Body"), *swaps, act("swap_hands", "Hands")),
            heading("Keyframes", "in the frame on show"),
            row(act("keyframes", hint=_KEYFRAMES), act("delete_key", "Delete keyframe")),
            row(act("hand_along")),
            heading("Depth", named("of arms and legs", tab)),
            row(act("mirror_depth"), act("in_front", "In front"), act("behind", "Behind")),
            row(act("clear_depth")),
            row(act("pin", "Pin in space"), act("lock", "Lock rotation"), act("unlock", "Unlock")),
        )
        self._unseen.show(*unseen(tab))  # below, so that selecting frames does not move the buttons

    def _draw_history(self) -> None:
        tab, project = self._tab, self._tab.session.project
        follow, off = tab.session.edit_follower.after_edits, project.read_only
        hint = "After an edit, its frame and the frames around it are refitted"
        key = project.keypoints_version, project.marks_version, tab.author
        undo, redo, *done = tab.once("history", key, self._history_rows)
        self._done.show(
            heading("Corrections"),
            row(self._action("undo", undo, kind="left")),
            row(self._action("redo", redo, kind="left")),
            row(
                button(
                    "Fit follows edits",
                    "keypoints.follow",
                    do=self._follow_or_not,
                    pressed=follow,
                    disabled=off,
                    hint=hint,
                )
            ),
            *done,
        )

    def _history_rows(self) -> list[Html]:
        """What undo and redo would do, and the latest edits."""
        tab, project = self._tab, self._tab.session.project
        steps = (self._step("Undo", project.undoable), self._step("Redo", project.redoable))
        return [*steps, *_history(tab)]

    def _step(self, verb: str, entry: LogEntry | None) -> Html:
        if entry is None:
            return text(f"Nothing to {verb.lower()}")
        assert not isinstance(entry.action, Undo | Redo)
        return text(f"{verb}: {describe(entry.action, self._tab.first_frame)}")


SHOWN = 12
"""Number of edits listed."""


def _history(tab: Tab) -> list[Html]:
    """The latest edits, newest first; a row leads to its frame, and undone edits are marked."""
    edits, now = tab.session.project.last_said(SHOWN), datetime.now().astimezone()
    if not edits:
        return [paragraph("No corrections yet.", "dim")]
    return [table(_edit_line(tab, entry, now) for entry in edits)]


def _edit_line(tab: Tab, entry: LogEntry, now: datetime) -> Html:
    edit, done, first = entry.action, tab.session.project.standing.stood(entry.id), tab.first_frame
    assert not isinstance(edit, Undo | Redo)
    visit = opener(describe(edit, first), "keypoints.visit", str(entry.id), partial(_visit, tab, edit))
    return line(
        _when(entry.time, now),
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


def _when(time: datetime, now: datetime) -> str:
    local = time.astimezone(now.tzinfo)
    return local.strftime("%H:%M") if local.date() == now.date() else local.strftime("%d %b")


_MOST = 5
"""Number of keypoints listed one by one."""


def _detected_by(detector: str) -> list[Html]:
    return [paragraph(f"Detected by {DETECTOR_TITLES.get(detector, detector)}.", "dim")] if detector else []


def state_of(corrected: Corrected, frame: int, joint: int) -> str:
    """The state of a keypoint; also the name of its style."""
    if corrected.bad[frame, joint]:
        return "bad"
    if corrected.confidence[frame, joint] == 0:
        return "missing"
    if corrected.pinned[frame, joint]:
        return "pinned"
    return "corrected" if corrected.edited[frame, joint] else "detected"


def selection_table(tab: Tab) -> list[Html]:
    """The selected keypoints in this frame as HTML, the last selected first."""
    chosen, frame = tab.state.selection[::-1], tab.state.frame
    title = f"{len(chosen) or 'No'} keypoint{'s' if len(chosen) != 1 else ''} selected"
    if not chosen:
        return [
            heading(title, first=True),
            paragraph(_SELECT if tab.session.project.has_detections else _NONE_YET, "dim"),
        ]
    head = ("keypoint", "state", "conf.", "x, y in pixels")
    rows = [_line(tab, joint) for joint in chosen[:_MOST]]
    parts = [heading(title, f"frame {frame + tab.first_frame}", first=True), table(rows, head, numbers=(2, 3))]
    if len(chosen) > _MOST:
        parts.append(paragraph(f"and {len(chosen) - _MOST} more", "dim"))
    return parts


def _line(tab: Tab, joint: int) -> Html:
    frame, corrected = tab.state.frame, tab.session.project.corrected
    name, state = full_name(joint), state_of(corrected, frame, joint)
    shown = tag("span", state, class_=f"tcfit-{state}")
    depth = joined(_depth(corrected, frame, joint), _lock(corrected, frame, joint))
    if state == "missing":
        return line(name, shown, "–", joined(tag("span", "–"), depth), numbers=(2, 3), whole=(1,))
    confidence = "–" if state == "bad" else f"{corrected.confidence[frame, joint]:.2f}"
    return line(name, shown, confidence, joined(_place(tab, joint), depth), numbers=(2, 3), whole=(1,))


def _place(tab: Tab, joint: int) -> Html:
    """Where a keypoint is, and where it was detected if that differs."""
    frame, detected = tab.state.frame, tab.session.project.detected
    x, y = tab.session.project.corrected.xy[frame, joint]
    u, v = detected.xy[frame, joint]
    here = tag("span", f"{x:.1f}, {y:.1f}")
    if not detected.confidence[frame, joint] > 0 or (x, y) == (u, v):
        return here
    hint = f"Moved by {x - u:+.1f}, {y - v:+.1f} pixels from its detected position"
    return joined(here, tag("div", f"was {u:.1f}, {v:.1f}", class_="tcfit-dim", title=hint))


def _lock(corrected: Corrected, frame: int, joint: int) -> Html:
    """Whether the rotation of a keypoint's joint is stated. A hand's shape also overrules its fingertips."""
    at = corrected[[frame]].keypoints()
    if at.overruled[0, joint]:
        return tag("div", "in a given hand shape", class_="tcfit-dim")
    if not corrected[frame].locked[joint]:
        return Html()
    return tag("div", "rotation locked" if joint in LOCKABLE else "in a given hand shape", class_="tcfit-dim")


def _depth(corrected: Corrected, frame: int, joint: int) -> Html:
    """The depth set for a keypoint, if any."""
    if not np.isfinite(depth := corrected.depth[frame, joint]):
        return Html()
    return tag("div", depth_words(*[round(100 * depth)] * 2), class_="tcfit-dim")
