"""Everything that a key or the command palette can do, in one table."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import ParamSpec

from fitting_core.body.handshapes import HANDSHAPES
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, GROUPS, PARTS
from tcfit_app.exports.table import exports
from tcfit_app.fitting.fits import passes_of
from tcfit_app.project.edits.kinds import SWAPPABLE
from tcfit_app.review.browser.page_states import KeyBinding
from tcfit_app.review.gestures.correcting import NUDGES, Correcting
from tcfit_app.review.gestures.correcting_depth import CorrectingDepth, limbs_of
from tcfit_app.review.gestures.detecting_again import DetectingAgain
from tcfit_app.review.gestures.edit_words import part_name
from tcfit_app.review.gestures.exchanging import Exchanging
from tcfit_app.review.gestures.exporting import Exporting
from tcfit_app.review.gestures.fitting import Fitting
from tcfit_app.review.gestures.keyframing import keys_in
from tcfit_app.review.gestures.noting import Noting
from tcfit_app.review.gestures.reviewing import Reviewing
from tcfit_app.review.gestures.shaping import ShapingHands
from tcfit_app.review.gestures.turning import Turning
from tcfit_app.review.gestures.viewing import OtherViews
from tcfit_app.review.gestures.zooming import next_close_up, show_whole, zoom_to_selection
from tcfit_app.review.scene.side_view import DIRECTION_TEXTS
from tcfit_app.review.tab.state import CONTROLS, MODES, OPACITIES, Section
from tcfit_app.review.tab.tab import Tab

P = ParamSpec("P")


class Gestures:
    """The gestures of one tab. They raise InputError for what cannot be done, and then change nothing."""

    def __init__(self, tab: Tab) -> None:
        self.tab = tab
        self.correcting, self.reviewing, self.fitting = Correcting(tab), Reviewing(tab), Fitting(tab)
        self.depth = CorrectingDepth(tab, self.correcting)
        self.turning = Turning(tab, self.correcting)
        self.shaping = ShapingHands(tab, self.correcting)
        self.noting, self.exchanging = Noting(tab), Exchanging(tab, self.correcting)
        self.again = DetectingAgain(tab, self.correcting)
        self.views = OtherViews(tab, self.correcting)
        self.exporting = Exporting(tab)

    def run(self, name: str) -> None:
        """Do one of ACTIONS on what is on show."""
        action = ACTIONS[name]
        self.tab.doing = action.title
        self.tab.look()
        action.do(self)


Need = Callable[[Gestures], object]
"""Raises InputError saying what is missing, and what to do."""


def refusal(check: Callable[P, object], *given: P.args, **named: P.kwargs) -> str:
    """The message of the InputError that a check raises; empty if it passes."""
    try:
        check(*given, **named)
    except InputError as error:
        return str(error)
    return ""


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key as browsers name it."""

    key: str
    """As in `KeyBinding`."""
    shift: bool = False
    ctrl: bool = False
    """Control; Command on a Mac."""

    def __str__(self) -> str:
        name = NAMES.get(self.key, self.key.removeprefix("Digit"))
        name = name.upper() if len(name) == 1 else name
        return "+".join([*(["Ctrl"] if self.ctrl else []), *(["Shift"] if self.shift else []), name])


NAMES = {"ArrowLeft": "←", "ArrowRight": "→", "ArrowUp": "↑", "ArrowDown": "↓", "Escape": "Esc"}
"""Names of keys whose label differs from their code."""


@dataclass(frozen=True, kw_only=True)
class Action:
    """A command."""

    title: str
    run: Callable[[Gestures], object]
    keys: tuple[Key, ...] = ()
    group: str = ""
    family: str = ""
    """The shared line for actions of one family in lists of keys."""
    repeats: bool = False
    """Whether it repeats while its key is held down."""
    needs: tuple[str, ...] = ()
    """What must hold before it can be done: names in NEEDS."""

    def obstacle(self, gestures: Gestures, *, but: Collection[str] = ()) -> str:
        """Why it cannot be done now; empty if it can. Keys, menus and panels all use this.

        Args:
            gestures: Of the tab.
            but: Needs to ignore, because they will be met by then.
        """
        return next((why for need in self.needs if need not in but and (why := refusal(NEEDS[need], gestures))), "")

    def do(self, gestures: Gestures) -> None:
        """Do it. Raises InputError if that is not possible, and then changes nothing."""
        for need in self.needs:
            NEEDS[need](gestures)
        self.run(gestures)


def _key(text: str) -> Key:
    """The key written as "Ctrl+Shift+z"."""
    *held, name = text.split("+")
    return Key(key=name, shift="Shift" in held, ctrl="Ctrl" in held)


def _toggle(name: str) -> Callable[[Gestures], None]:
    return lambda g: g.tab.set(**{name: not getattr(g.tab.state, name)})


def _change_opacity(tab: Tab, more: float) -> None:
    least, most = OPACITIES
    tab.set(opacity=round(min(max(tab.state.opacity + more, least), most), 2))


def _wipe(gestures: Gestures) -> None:
    """Switch the wipe of A and B; from other modes, go to it."""
    state = gestures.tab.state
    gestures.tab.set(mode="ab", wipe=state.mode != "ab" or not state.wipe)


def _turn_side(gestures: Gestures) -> None:
    """Cycle through the clip's other views, and the side view from left, right and top; switch it on if it is off."""
    tab = gestures.tab
    sides = (*tab.session.views, *DIRECTION_TEXTS)
    now = tab.state.side_from if tab.view else tab.direction
    tab.set(side=True, side_from=sides[(sides.index(now) + tab.state.side) % len(sides)])


def _go_to_next_person(gestures: Gestures) -> None:
    someone = gestures.tab.someone
    all_people = someone.all_people
    gestures.tab.go_to(all_people[(someone.number + 1) % len(all_people)])


def _escape(gestures: Gestures) -> None:
    gestures.correcting.abandon()
    if gestures.again.give_up_framing():
        return
    tab = gestures.tab
    tab.set(selection=(), **({} if tab.state.selection else {"frames": None}))


def _edge(gestures: Gestures, *, first: bool) -> None:
    tab = gestures.tab
    frame, frames = tab.state.frame, tab.state.frames
    start, last = (frames[0], frames[-1]) if frames is not None else (frame, frame)
    start, last = (frame, max(frame, last)) if first else (min(start, frame), frame)
    tab.set(frames=range(start, last + 1))


# --- what actions need ---


def _required(holds: Callable[[Gestures], object], otherwise: str) -> Need:
    def check(g: Gestures) -> None:
        if not holds(g):
            raise InputError(otherwise)

    return check


_bodies = _required(lambda g: g.tab.session.fits.runs, "There is no fit yet: fit everything first.")


def _beside(g: Gestures) -> None:
    if not g.tab.session.views:
        _bodies(g)


def _two_fits(g: Gestures) -> None:
    _bodies(g)
    showable = g.tab.session.fits.showable()
    if len(showable) == 1 and not passes_of(showable[0]):
        raise InputError("There is only one fit, without an earlier pass: fit again or import another to compare.")


NEEDS: dict[str, Need] = {
    "writable": lambda g: g.tab.refuse_read_only(),
    "keypoints": lambda g: g.tab.session.refuse_without_keypoints(),
    "frames": lambda g: g.tab.require_visible_frames(),
    "selected_frames": lambda g: g.fitting.selected_frames(),
    "joints": lambda g: g.correcting.selected(),
    "any_joints": lambda g: g.correcting.selected_anywhere(),
    "limbs": lambda g: limbs_of(g.correcting.selected()),
    "lockable": lambda g: g.depth.lockable(),
    "hand": lambda g: g.shaping.side(),
    "some_key": _required(
        lambda g: g.tab.session.project.corrected.key[g.tab.state.frame].any(),
        "No keypoint has a keyframe in this frame.",
    ),
    "key": lambda g: keys_in(g.tab.session.project.corrected, g.correcting.selected(), g.tab.state.frame),
    "fit": lambda g: g.fitting.base(),
    "bodies": _bodies,
    "beside": _beside,
    "two_fits": _two_fits,
    "finished": lambda g: g.reviewing.refuse_unfinished(),
    "settings": lambda g: g.fitting.refuse_wrong_settings(),
    "picture": _required(
        lambda g: g.tab.state.mode != "space", "3D has no picture for that: go to Edit (1) or Compare (2) first."
    ),
    "silhouettes": _required(
        lambda g: g.tab.session.project.footage.silhouettes is not None,
        "There is no silhouette: only keypoints detected by tcfit come with one.",
    ),
    "others": _required(lambda g: g.tab.someone.others, "This project has only one person."),
    "listed": lambda g: g.reviewing.refuse_without_list(),
    "suspects": _required(
        lambda g: (g.reviewing.queue is None or g.reviewing.queue.left) and g.tab.session.fits.showable(),
        "There are no suspicious frames: either there is no fit yet, or all were reviewed.",
    ),
    "detector": lambda g: g.again.refuse(),
    "undoable": _required(lambda g: g.tab.session.project.undoable, "There is nothing to undo."),
    "redoable": _required(lambda g: g.tab.session.project.redoable, "There is nothing to redo."),
    **{f"export_{name}": lambda g, name=name: g.exporting.refuse(name) for name in exports()},
}
"""By the names in rows of actions and of TabState. `joints` are selected in the clip's picture, `any_joints` also in
another view's. `frames`: if some are selected, the one on show is among them. `bodies` may still be fitted."""
OF_SELECTION = ("joints", "any_joints", "limbs", "lockable", "hand", "key")
"""Needs that a menu opened on a keypoint ignores: it will be selected by then."""
_EDIT = "writable keypoints frames"
_OF_JOINTS = f"{_EDIT} joints"
_OF_ANY_JOINTS = f"{_EDIT} any_joints"
_OF_HAND = f"{_EDIT} hand fit"
_AGAIN = "writable keypoints settings fit"
_WAYS = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "up": (0.0, -1.0), "down": (0.0, 1.0)}
"""Image directions."""
_NUDGES = dict(zip(NUDGES, ("Ctrl", "Ctrl+Shift"), strict=True))
"""Pixels of a nudge, and the keys held for it."""


def _nudge(name: str, pixels: int) -> str:
    return f"nudge_{name}" if pixels == 1 else f"nudge{pixels}_{name}"


_Row = tuple[str, str, str, Callable[[Gestures], object], str]
"""By action: its name, title, keys as "Shift+m Delete", what does it, and the names of its needs."""


def _switches(*sections: Section) -> tuple[_Row, ...]:
    """The rows of TabState's switches."""
    return tuple(
        (name, row.title, row.keys, _toggle(name), " ".join(row.needs))
        for section in sections
        for name, row in CONTROLS.items()
        if row.section == section
    )


_PLAYING: tuple[_Row, ...] = (
    ("play", "Play or pause", "Space", lambda g: g.tab.toggle_playing(), ""),
    ("previous", "Previous frame", "ArrowLeft", lambda g: g.tab.step(-1), ""),
    ("next", "Next frame", "ArrowRight", lambda g: g.tab.step(1), ""),
    ("previous10", "10 frames back", "Shift+ArrowLeft", lambda g: g.tab.step(-10), ""),
    ("next10", "10 frames forward", "Shift+ArrowRight", lambda g: g.tab.step(10), ""),
    ("first", "First frame", "Home", lambda g: g.tab.step(-g.tab.length), ""),
    ("last", "Last frame", "End", lambda g: g.tab.step(g.tab.length), ""),
    *_switches("playing"),
)
_VIEW: tuple[_Row, ...] = (
    *(
        (
            mode,
            f"Mode: {name}",
            f"Digit{number}",
            lambda g, mode=mode: g.tab.set(mode=mode),
            {"edit": "", "ab": "two_fits", "space": "bodies"}[mode],
        )
        for number, (mode, name) in enumerate(MODES.items(), 1)
    ),
    *_switches("shown", "body", "compare", "camera"),
    ("wipe", "Compare with a divider, on or off", "w", _wipe, "two_fits"),
    ("next_person", "Next person of the clip", "q", _go_to_next_person, "others"),
    ("fainter", "Less opacity", ",", lambda g: _change_opacity(g.tab, -0.1), "bodies"),
    ("denser", "More opacity", ".", lambda g: _change_opacity(g.tab, 0.1), "bodies"),
    ("turn_side", "Side view from the next side", "Shift+v", _turn_side, "bodies"),
    ("fit_view", "Whole picture", "f", lambda g: show_whole(g.tab), ""),
    ("zoom", "Zoom to the selected keypoints", "z", lambda g: zoom_to_selection(g.tab), "joints"),
    (
        "close_up",
        "Close-up that follows: right hand, left hand, face, off",
        "e",
        lambda g: next_close_up(g.tab),
        "picture",
    ),
    ("first_steps", "Show the first steps", "", lambda g: g.tab.set(keys=False, steps=True), ""),
    ("help", "Show all keys", "h", _toggle("keys"), ""),
)
_KEYPOINTS: tuple[_Row, ...] = (
    ("bad", "Mark bad, or restore", "x", lambda g: g.correcting.toggle_bad(), _OF_ANY_JOINTS),
    ("reset", "Reset to the detection", "Backspace Delete", lambda g: g.correcting.reset(), _OF_ANY_JOINTS),
    ("copy", "Copy from the previous frame", "c", lambda g: g.correcting.copy_previous(), _OF_JOINTS),
    ("interpolate", "Interpolate", "i", lambda g: g.correcting.interpolate(), _OF_JOINTS),
    *_switches("keyframes"),
    (
        "delete_key",
        "Delete the keyframe",
        "Shift+Backspace Shift+Delete",
        lambda g: g.correcting.delete_key(),
        "writable keypoints some_key joints key",
    ),
    *(
        (f"swap_{name}", f"Swap left and right: {name}", key, lambda g, name=name: g.correcting.swap_sides(name), _EDIT)
        for name, key in ({name: "" for name in SWAPPABLE} | {"body": "s", "hands": "Shift+s"}).items()
    ),
    ("mirror_depth", "Mirror in depth", "Shift+m", lambda g: g.depth.send("mirror"), f"{_EDIT} limbs fit"),
    ("in_front", "Put in front of shoulder or hip", "", lambda g: g.depth.send("front"), f"{_EDIT} limbs fit"),
    ("behind", "Put behind shoulder or hip", "", lambda g: g.depth.send("behind"), f"{_EDIT} limbs fit"),
    ("pin", "Pin in space over the selected frames", "Shift+p", lambda g: g.depth.pin(), f"{_OF_JOINTS} fit"),
    ("lock", "Lock the joint's rotation", "Shift+l", lambda g: g.depth.lock(), f"{_EDIT} lockable fit"),
    (
        "lock_throughout",
        "Lock the joint's rotation in all frames, or unlock it",
        "",
        lambda g: g.depth.lock_throughout(),
        f"{_EDIT} lockable fit",
    ),
    ("unlock", "Unlock the joint", "", lambda g: g.depth.unlock(), f"{_EDIT} lockable"),
    ("keep", "Keep for the whole clip, or the selected frames", "", lambda g: g.depth.keep(), f"{_OF_JOINTS} fit"),
    ("release", "Remove the kept offset", "", lambda g: g.depth.release(), _OF_JOINTS),
    ("clear_depth", "Clear depth", "", lambda g: g.depth.clear_depth(), f"{_EDIT} limbs"),
    *(
        (f"shape_{name}", f"Hand shape: {name}", "", lambda g, name=name: g.shaping.give_named(name), _OF_HAND)
        for name in HANDSHAPES
    ),
    ("shape_other", "Hand shape: that of the other hand, mirrored", "", lambda g: g.shaping.give_other(), _OF_HAND),
    ("shape_copied", "Hand shape: the copied one", "", lambda g: g.shaping.give_copied(), _OF_HAND),
    ("shape_last", "Hand shape: the one given last", "Shift+h", lambda g: g.shaping.give_last(), _OF_HAND),
    ("copy_shape", "Copy the hand's shape in the fit", "Shift+c", lambda g: g.shaping.copy(), "hand fit"),
    ("free_hand", "Remove hand shape", "", lambda g: g.shaping.free(), _OF_HAND),
    *(
        (
            _nudge(name, pixels),
            f"Nudge {name} by {pixels} px",
            f"{held}+Arrow{name.title()}",
            lambda g, by=(pixels * x, pixels * y): g.correcting.nudge(*by),
            "writable keypoints joints",
        )
        for pixels, held in _NUDGES.items()
        for name, (x, y) in _WAYS.items()
    ),
    *(
        (f"detect_{p}", f"Detect the {part_name(p)} again", "", lambda g, p=p: g.again.look(p), "detector frames")
        for p in PARTS
    ),
    *(
        (
            f"frame_{p}",
            f"Detect the {part_name(p)} in a rectangle",
            "",
            lambda g, p=p: g.again.frame(p),
            "detector picture",
        )
        for p in PARTS
    ),
    ("cancel_detecting", "Cancel detecting again", "", lambda g: g.again.task.cancel(), ""),
    ("all", "Select all keypoints on show", "Ctrl+a", lambda g: g.correcting.select_all(), ""),
    *(
        (
            f"select_{group}",
            f"Select the {group.replace('_', ' ')}",
            "",
            lambda g, group=group: g.tab.set(selection=tuple(range(COUNT)[GROUPS[group]])),
            "keypoints",
        )
        for group in GROUPS
    ),
    ("escape", "Cancel, or clear the selection", "Escape", _escape, ""),
    ("undo", "Undo", "Ctrl+z", lambda g: g.correcting.undo(), "writable undoable"),
    ("redo", "Redo", "Ctrl+Shift+z Ctrl+y", lambda g: g.correcting.redo(), "writable redoable"),
)
_FRAMES: tuple[_Row, ...] = (
    ("range_start", "Select frames from here on", "[", lambda g: _edge(g, first=True), ""),
    ("range_end", "Select frames up to here", "]", lambda g: _edge(g, first=False), ""),
    ("next_suspect", "Next suspicious frame", "n", lambda g: g.reviewing.go(1), "suspects"),
    ("previous_suspect", "Previous suspicious frame", "Shift+n", lambda g: g.reviewing.go(-1), "suspects"),
    ("fine", "Looks fine, on or off", "o", lambda g: g.reviewing.dismiss(), "writable frames"),
    ("all_fine", "All listed look fine", "Shift+f", lambda g: g.reviewing.dismiss_listed(), "writable suspects"),
    ("flag", "Flag on or off", "t", lambda g: g.reviewing.flag(), "writable frames"),
    ("note", "Write a note", "y", lambda g: g.noting.begin(), "writable frames"),
    ("copy_link", "Copy a link to this frame and fit", "", lambda g: g.noting.copy_link(), ""),
)
_FIT: tuple[_Row, ...] = (
    ("rerun", "Fit the selected frames", "r", lambda g: g.fitting.frames(), f"{_AGAIN} selected_frames"),
    ("rerun_shape", "Fit the shape again", "", lambda g: g.fitting.shape(), _AGAIN),
    ("fit", "Fit everything", "Shift+r", lambda g: g.fitting.everything(), "writable keypoints settings"),
    ("cancel", "Cancel all fitting", "", lambda g: g.tab.session.cancel(), ""),
)
_CLIPS: tuple[_Row, ...] = (
    ("approve", "Approve clip / withdraw approval", "Shift+o", lambda g: g.reviewing.approve(), "writable finished"),
    ("approve_next", "Approve and next", "", lambda g: g.reviewing.leave_approved(), "writable finished listed"),
    ("next_clip", "Next clip of the list", "PageDown", lambda g: g.reviewing.leave("next"), "listed"),
    ("previous_clip", "Previous clip of the list", "PageUp", lambda g: g.reviewing.leave("previous"), "listed"),
    ("list", "All clips", "Shift+Home", lambda g: g.reviewing.leave("list"), "listed"),
)
_EXPORT: tuple[_Row, ...] = tuple(
    (
        f"export_{name}",
        f"Export: {export.title}{'' if export.group in ('Video', 'Project') else f', for {export.group}'}",
        "",
        lambda g, name=name: g.exporting.begin(name),
        f"export_{name}",
    )
    for name, export in exports().items()
)
_FAMILIES = {
    "Previous, next frame": ("previous", "next"),
    "10 frames back, forward": ("previous10", "next10"),
    "First, last frame": ("first", "last"),
    f"Mode {', '.join(MODES.values())}": tuple(MODES),
    "Less, more opacity": ("fainter", "denser"),
    **{f"Nudge by {pixels} px": tuple(_nudge(name, pixels) for name in _WAYS) for pixels in _NUDGES},
    "Select frames from here on, up to here": ("range_start", "range_end"),
    "Next, previous suspicious frame": ("next_suspect", "previous_suspect"),
    "Next, previous clip of the list": ("next_clip", "previous_clip"),
}
_FAMILY = {name: family for family, names in _FAMILIES.items() for name in names}
_REPEATING = {
    *"previous next previous10 next10 fainter denser undo redo".split(),
    *(_nudge(name, pixels) for name in _WAYS for pixels in _NUDGES),
}
_GROUPS = {
    "Playing": _PLAYING,
    "View": _VIEW,
    "Keypoints": _KEYPOINTS,
    "Frames": _FRAMES,
    "Fit": _FIT,
    "Clips": _CLIPS,
    "Export": _EXPORT,
}
ACTIONS: dict[str, Action] = {
    name: Action(
        title=title,
        run=run,
        keys=tuple(map(_key, keys.split())),
        group=group,
        family=_FAMILY.get(name, ""),
        repeats=name in _REPEATING,
        needs=tuple(needs.split()),
    )
    for group, rows in _GROUPS.items()
    for name, title, keys, run, needs in rows
}
"""By the name that the page sends. The panels' own are added by `add_panel`."""


def panel_actions(titles: Sequence[str]) -> dict[str, Action]:
    """The actions that show the panels with these titles."""
    return {
        f"panel_{title.lower()}": Action(
            title=f"Panel: {title}",
            run=lambda g, title=title: g.tab.show_panel(title),
            keys=(Key(key=f"Digit{number}", shift=True),) if number < 10 else (),
            group="View",
            family=f"Panel {', '.join(titles)}",
        )
        for number, title in enumerate(titles, 1)
    }


def bindings() -> tuple[KeyBinding, ...]:
    """All keys, in the page's form."""
    return tuple(
        KeyBinding(key=key.key, action=name, shift=key.shift, ctrl=key.ctrl)
        for name, action in ACTIONS.items()
        for key in action.keys
    )


def key_text(name: str) -> str:
    """The keys of an action in words; empty without any."""
    return " or ".join(map(str, ACTIONS[name].keys))
