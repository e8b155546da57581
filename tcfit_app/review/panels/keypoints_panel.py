"""The panel that corrects keypoints, and lists what was done to them."""

from collections import Counter
from datetime import datetime
from functools import partial
from typing import ClassVar

import numpy as np
import viser

from fitting_core.keypoints import COUNT, GROUPS, PARTS, PartOfPerson
from tcfit_app.analysis.body_regions import full_name
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.edit_log import LogEntry, Redo, Remark, Said, Undo
from tcfit_app.project.edits.keyframes import REACH
from tcfit_app.project.edits.kinds import SIDES
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.project import Project
from tcfit_app.review.browser.page_states import GROUP_COLORS
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.gestures.detecting_again import can_look, missing_parts
from tcfit_app.review.gestures.edit_words import depth_words, describe, part_name
from tcfit_app.review.panels.elements.field import Dropdown
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    action,
    button,
    dot,
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
from tcfit_app.review.panels.elements.selected_frames import listen, named, unseen
from tcfit_app.review.tab.browser_tab import BROWSER
from tcfit_app.review.tab.buttons import one_of
from tcfit_app.review.tab.tab import Tab

_NOTHING = "Select by name"
_KEYFRAMES = f"Between two frames in which a keypoint is moved, at most {REACH} apart, the others follow"
_SWAPPED = ("arms", "legs")
"""What can be swapped and has no key."""
_JOINTS = {full_name(joint): joint for joint in range(COUNT)}
"""Keypoints by what they are called in the dropdown."""
assert len(_JOINTS) == COUNT


class KeypointsPanel:
    """Corrections, and their history."""

    title: ClassVar[str] = "Keypoints"
    icon: ClassVar[viser.IconName] = viser.Icon.HAND_CLICK

    def __init__(self, gestures: Gestures) -> None:
        self._gestures = gestures
        self._tab = tab = gestures.tab
        gui = tab.client.gui
        self._selected, self._missing = Board(tab), Board(tab)
        names = gui.add_dropdown("Keypoint", (_NOTHING, *_JOINTS), hint="Type a part of the name to find it")
        self._name = Dropdown(tab, names, self._select)
        self._buttons = Board(tab)
        by = gui.add_vector2("Move by", (1.0, 0.0), step=0.5, hint="Pixels to the right and down")
        self._by = by
        self._confidence = gui.add_slider("Confidence", 0.0, 1.0, 0.05, 1.0)
        self._exactly = Board(tab)
        self._groups, self._again = Board(tab), Board(tab)
        self._history = Board(tab)
        self._all_bad = False
        self._listen()

    def _listen(self) -> None:
        tab, correcting = self._tab, self._gestures.correcting
        tab.buttons.on("keypoints.swap", correcting.swap_sides, one_of(SIDES))
        tab.buttons.on("keypoints.move", lambda _: correcting.nudge(*self._by.value))
        tab.buttons.on("keypoints.confidence", lambda _: correcting.set_confidence(self._confidence.value))
        tab.buttons.on("keypoints.bad", correcting.mark_group_bad, one_of(GROUPS))
        tab.buttons.on("keypoints.restore", correcting.restore_group, one_of(GROUPS))
        tab.buttons.on("keypoints.group", self._select_group, one_of(GROUPS))
        tab.buttons.on("keypoints.follow", lambda _: self._follow_or_not())
        tab.buttons.on("keypoints.look", self._gestures.again.look, one_of(PARTS))
        tab.buttons.on("keypoints.visit", self._visit, self._edit_of)
        listen(tab)

    def _select(self, name: str) -> None:
        if name in _JOINTS:
            self._tab.set(selection=(_JOINTS[name],))

    def _select_group(self, name: str) -> None:
        part = GROUPS[name]
        self._tab.set(selection=tuple(range(part.start, part.stop)))

    def _follow_or_not(self) -> None:
        session = self._tab.session
        session.edit_follower.after_edits = not session.edit_follower.after_edits

    def _edit_of(self, number: str) -> Said:
        """The edit with this number in the log; raises ValueError if there is none."""
        found = [entry.action for entry in self._tab.session.project.log if entry.id == int(number)]
        if not found or isinstance(found[0], Undo | Redo):
            raise ValueError(number)
        return found[0]

    def _visit(self, edit: Said) -> None:
        tab = self._tab
        tab.pause()
        tab.seek(edit.frames[0])
        if not isinstance(edit, Remark):
            tab.set(selection=edit.joints)

    def draw(self) -> None:
        """Bring it to the tab's state."""
        tab, state, session = self._tab, self._tab.state, self._tab.session
        self._name.show(full_name(state.selection[0]) if len(state.selection) == 1 else _NOTHING)
        if tab.sent.differs("selected", state.selection, state.frame if state.selection else 0, session.edits):
            self._selected.show(*selection_table(tab))
        self._draw_missing()
        where, bad, key = self._where(), self._bad(), self._key()
        switches = state.keyframes, state.hand_along
        if tab.sent.differs("keypoint buttons", where, bad, key, switches, not state.selection, tab.hits_unseen):
            self._draw_buttons(where, bad, key)
        detector = session.project.footage.detector
        if tab.sent.differs("groups", where, detector):
            self._groups.show(heading("Whole groups", where), self._group_table(), *_detected_by(detector))
        self._draw_again(where)
        if tab.sent.differs("history", session.edits, session.marked, session.edit_follower.after_edits, tab.author):
            self._draw_history()

    def _draw_missing(self) -> None:
        """What was not found in the frame on show; nothing while the clip plays, and it would change at once."""
        tab, state, looking = self._tab, self._tab.state, self._gestures.again.busy
        shown = can_look(tab) and not state.playing
        if not tab.sent.differs("missing", shown, looking, shown and (state.frame, tab.session.edits, state.frames)):
            return
        parts = missing_parts(tab.session.project.corrected, state.frame) if shown else ()
        self._missing.show(
            *([heading("Not found", f"frame {state.frame + tab.first_frame}")] if parts else []),
            *([table([self._missing_line(part, off=looking) for part in parts])] if parts else []),
        )

    def _missing_line(self, part: PartOfPerson, *, off: bool) -> Html:
        label = named("Look for it", self._tab)
        look = button(label, "keypoints.look", part, kind="mini", disabled=off)
        return line(f"{part_name(part).capitalize()}: not found", look, numbers=(1,))

    def _draw_again(self, where: str) -> None:
        """What can be looked for again, or how far that is."""
        tab, again = self._tab, self._gestures.again
        going = again.going if again.busy else None
        progress = going and (going.text, going.share, going.stopping)
        if not tab.sent.differs("again", can_look(tab), where, progress, again.framing):
            return
        if going is not None:
            told = going.title if going.stopping else f"{going.title}: {going.text}"
            stop = action("cancel_detecting", "Cancel", disabled=going.stopping, kind="danger")
            self._again.show(heading("Detect again"), paragraph(told), progress_bar(going.share or 0.0), row(stop))
        elif can_look(tab):
            self._again.show(
                heading("Detect again", where),
                row(*(action(f"detect_{part}", part_name(part).capitalize()) for part in PARTS), wrap=True),
                paragraph("In a rectangle that you draw in the picture:", "dim"),
                row(
                    *(
                        action(f"frame_{part}", part_name(part).capitalize(), pressed=again.framing == part)
                        for part in PARTS
                    ),
                    wrap=True,
                ),
            )
        else:
            self._again.show()

    def _where(self) -> str:
        tab = self._tab
        if tab.state.playing and tab.state.frames is None:  # else it would change with each frame
            return "apply to the frame on show"
        return f"apply to {in_words(tab.chosen_frames, tab.first_frame)}"

    def _bad(self) -> bool:
        """Whether all that is selected is bad."""
        tab, state = self._tab, self._tab.state
        if not state.selection or state.playing:
            return False
        if tab.sent.differs("bad", state.selection, tab.chosen_frames, tab.session.edits):
            bad = tab.session.project.corrected.bad
            self._all_bad = bool(bad[np.ix_(tab.chosen_frames, state.selection)].all())
        return self._all_bad

    def _key(self) -> bool:
        """Whether any of what is selected has a keyframe in the frame on show."""
        state = self._tab.state
        if not state.selection or state.playing:
            return False
        return bool(self._tab.session.project.corrected.key[state.frame, list(state.selection)].any())

    def _draw_buttons(self, where: str, bad: bool, key: bool) -> None:
        tab, state = self._tab, self._tab.state
        off = tab.session.project.read_only
        none = off or not state.selection
        edit = partial(action, disabled=none)
        self._buttons.show(
            heading("Correct", words(f"{where}, not on show", "warn") if tab.hits_unseen else where),
            row(edit("bad", "Restore" if bad else "Mark bad"), edit("reset", "Reset")),
            row(edit("copy", "Copy previous"), edit("interpolate", "Interpolate")),
            row(
                action("swap_body", "Swap body", disabled=off),
                *(button(name.title(), "keypoints.swap", name, disabled=off) for name in _SWAPPED),
                action("swap_hands", "Hands", disabled=off),
            ),
            heading("Keyframes", "in the frame on show"),
            row(
                action("keyframes", "Keyframes", pressed=state.keyframes, hint=_KEYFRAMES),
                action("delete_key", "Delete keyframe", disabled=off or not key),
            ),
            row(action("hand_along", "Hand goes with its wrist", pressed=state.hand_along)),
            heading("Depth", named("of arms and legs", tab)),
            row(edit("mirror_depth", "Mirror in depth"), edit("in_front", "In front"), edit("behind", "Behind")),
            row(edit("interpolate_depth", "Interpolate depth"), edit("clear_depth", "Clear depth")),
            row(edit("pin", "Pin in space"), edit("lock", "Lock the turn"), edit("unlock", "Unlock")),
        )
        self._exactly.show(
            row(
                button("Move by x, y", "keypoints.move", disabled=none, hint="In the frame on show only"),
                button(named("Set confidence", tab), "keypoints.confidence", disabled=none),
            ),
            *unseen(tab),  # below: whoever selects frames finds the buttons where they were
        )

    def _group_table(self) -> Html:
        off = self._tab.session.project.read_only
        rows = [
            line(
                joined(dot(GROUP_COLORS[name]), text(name.replace("_", " "))),
                joined(
                    button("Select", "keypoints.group", name, kind="mini"),
                    text(" "),
                    button("Mark bad", "keypoints.bad", name, kind="mini", disabled=off),
                    text(" "),
                    button("Restore", "keypoints.restore", name, kind="mini", disabled=off),
                ),
                numbers=(1,),
            )
            for name in GROUPS
        ]
        return table(rows)

    def _draw_history(self) -> None:
        tab, project = self._tab, self._tab.session.project
        follow = tab.session.edit_follower.after_edits
        hint = "After an edit, the fit of its frame and the frames around is made again"
        self._history.show(
            heading("Corrections"),
            row(self._step("undo", "Undo", project.undoable)),
            row(self._step("redo", "Redo", project.redoable)),
            row(button("The fit follows edits", "keypoints.follow", pressed=follow, hint=hint)),
            *history_table(project, me=tab.author, first_frame=tab.first_frame),
        )

    def _step(self, name: str, verb: str, entry: LogEntry | None) -> Html:
        if entry is None:
            return action(name, f"Nothing to {verb.lower()}", disabled=True, kind="left")
        assert not isinstance(entry.action, Undo | Redo)
        what = describe(entry.action, self._tab.first_frame)
        return action(name, f"{verb}: {what}", kind="left", disabled=self._tab.session.project.read_only)


SHOWN = 12
"""Corrections that are listed."""


def history_table(project: Project, *, me: str, first_frame: int) -> list[Html]:
    """The last edits of a project, newest first; a row leads to its frame, and those that were undone are marked.

    Args:
        project: whose keypoints were edited.
        me: the author who reads it.
        first_frame: the number that users see for frame 0.
    """
    edits = project.last_said(SHOWN)
    if not edits:
        return [paragraph("No corrections yet.", "dim")]
    now = datetime.now().astimezone()
    rows = [
        _row(entry, _when(entry.time, now), _whose(entry.author, me), first_frame, done=project.stands(entry.id))
        for entry in edits
    ]
    return [table(rows)]


def _row(entry: LogEntry, when: str, whose: str, first_frame: int, *, done: bool) -> Html:
    assert not isinstance(entry.action, Undo | Redo)
    return line(
        when,
        whose,
        opener(describe(entry.action, first_frame), "keypoints.visit", str(entry.id)),
        whole=(0, 1),
        kind="" if done else "off",
        command="keypoints.visit",
        value=str(entry.id),
        hint=f"{'' if done else 'Undone. '}Go to frame {first_frame + entry.action.frames[0]}",
    )


def _whose(author: str, me: str) -> str:
    if author == me:
        return "you"
    return "another browser" if author.startswith((BROWSER, "tab ")) else author


def _when(time: datetime, now: datetime) -> str:
    local = time.astimezone(now.tzinfo)
    return local.strftime("%H:%M") if local.date() == now.date() else local.strftime("%d %b")


_MOST = 5
"""Keypoints that are listed one by one."""


def _detected_by(detector: str) -> list[Html]:
    """Whose the keypoints are, where that is known."""
    return [paragraph(f"Detected by {DETECTOR_TITLES.get(detector, detector)}.", "dim")] if detector else []


_STATES = ("bad", "pinned", "corrected", "detected", "missing")
"""The style sheet knows these names."""


def state_of(corrected: Corrected, frame: int, joint: int) -> str:
    """What a keypoint is, one of _STATES."""
    if corrected.bad[frame, joint]:
        return "bad"
    if corrected.confidence[frame, joint] == 0:
        return "missing"
    if corrected.pinned[frame, joint]:
        return "pinned"
    return "corrected" if corrected.edited[frame, joint] else "detected"


def selection_table(tab: Tab) -> list[Html]:
    """The selected keypoints in the frame on show as HTML, the one selected last at first."""
    chosen, frame = tab.state.selection[::-1], tab.state.frame
    title = f"{len(chosen) or 'No'} keypoint{'s' if len(chosen) != 1 else ''} selected"
    if not chosen:
        return [
            heading(title, first=True),
            paragraph("Click one in the picture, or draw a rectangle with Shift held.", "dim"),
        ]
    head = ("keypoint", "state", "conf.", "x, y in pixels")
    rows = [_line(tab, joint) for joint in chosen[:_MOST]]
    parts = [heading(title, f"frame {frame + tab.first_frame}", first=True), table(rows, head, numbers=(2, 3))]
    if len(chosen) > _MOST:
        counts = Counter(state_of(tab.session.project.corrected, frame, joint) for joint in chosen)
        of_all = ", ".join(f"{counts[state]} {state}" for state in _STATES if counts[state])
        parts.append(paragraph(f"and {len(chosen) - _MOST} more: of all, {of_all}", "dim"))
    return parts


def _line(tab: Tab, joint: int) -> Html:
    frame, corrected = tab.state.frame, tab.session.project.corrected
    name, state = full_name(joint), state_of(corrected, frame, joint)
    shown = tag("span", state, class_=f"tcfit-{state}")
    depth = joined(_depth(corrected, frame, joint), _lock(corrected, frame, joint))
    if state == "missing":
        return line(name, shown, "–", joined(tag("span", "–"), depth), numbers=(2, 3), whole=(1,))
    confidence = f"{corrected.confidence[frame, joint]:.2f}"
    return line(name, shown, confidence, joined(_place(tab, joint), depth), numbers=(2, 3), whole=(1,))


def _place(tab: Tab, joint: int) -> Html:
    """Where a keypoint is, and where it was detected if that is somewhere else."""
    frame, detected = tab.state.frame, tab.session.project.detected
    x, y = tab.session.project.corrected.xy[frame, joint]
    u, v = detected.xy[frame, joint]
    here = tag("span", f"{x:.1f}, {y:.1f}")
    if not detected.confidence[frame, joint] > 0 or (x, y) == (u, v):
        return here
    hint = f"Moved by {x - u:+.1f}, {y - v:+.1f} pixels from where it was detected"
    return joined(here, tag("div", f"was {u:.1f}, {v:.1f}", class_="tcfit-dim", title=hint))


def _lock(corrected: Corrected, frame: int, joint: int) -> Html:
    return tag("div", "turn locked", class_="tcfit-dim") if corrected[frame].locked[joint] else Html()


def _depth(corrected: Corrected, frame: int, joint: int) -> Html:
    """What was said of a keypoint's depth, if anything was."""
    if not np.isfinite(depth := corrected.depth[frame, joint]):
        return Html()
    return tag("div", depth_words(*[round(100 * depth)] * 2), class_="tcfit-dim")
