"""Everything that a key or the command palette can do, in one table."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from fitting_core.errors import InputError
from fitting_core.keypoints import PARTS
from tcfit_app.review.browser.page_states import KeyBinding
from tcfit_app.review.gestures.correcting import Correcting
from tcfit_app.review.gestures.correcting_depth import CorrectingDepth
from tcfit_app.review.gestures.detecting_again import DetectingAgain
from tcfit_app.review.gestures.edit_words import part_name
from tcfit_app.review.gestures.exchanging import Exchanging
from tcfit_app.review.gestures.fitting import Fitting
from tcfit_app.review.gestures.noting import Noting
from tcfit_app.review.gestures.reviewing import Reviewing
from tcfit_app.review.gestures.zooming import next_close_up, show_whole, zoom_to_selection
from tcfit_app.review.scene.windows import ARRANGEMENTS
from tcfit_app.review.tab.state import MODES, OPACITIES, SIDES_SEEN
from tcfit_app.review.tab.tab import Tab


class Gestures:
    """The gestures of one tab; they raise InputError for what cannot be done, and then nothing changes."""

    def __init__(self, tab: Tab) -> None:
        self.tab = tab
        self.correcting, self.reviewing, self.fitting = Correcting(tab), Reviewing(tab), Fitting(tab)
        self.depth = CorrectingDepth(tab, self.correcting)
        self.noting, self.exchanging = Noting(tab), Exchanging(tab, self.correcting)
        self.again = DetectingAgain(tab, self.correcting)


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key as browsers name it."""

    key: str
    """As of `KeyBinding`."""
    shift: bool = False
    ctrl: bool = False
    """Control; Command on a Mac."""

    def __str__(self) -> str:
        name = NAMES.get(self.key, self.key.removeprefix("Digit"))
        name = name.upper() if len(name) == 1 else name
        return "+".join([*(["Ctrl"] if self.ctrl else []), *(["Shift"] if self.shift else []), name])


NAMES = {"ArrowLeft": "←", "ArrowRight": "→", "ArrowUp": "↑", "ArrowDown": "↓", "Escape": "Esc"}
"""Of keys that say something else than their code."""


@dataclass(frozen=True, kw_only=True)
class Action:
    """One command."""

    title: str
    run: Callable[[Gestures], None]
    keys: tuple[Key, ...] = ()
    group: str = ""
    family: str = ""
    """What it and its neighbours of the same family do together: they share a line in lists of keys."""
    repeats: bool = False
    """Whether it goes on while its key is held down."""
    held: bool = False
    """The page does it as long as its key is held down: it is nothing for the command palette."""

    @property
    def key_text(self) -> str | None:
        """Its keys, for the user."""
        return " or ".join(map(str, self.keys)) or None


def _keys(*keys: str, shift: bool = False, ctrl: bool = False) -> tuple[Key, ...]:
    return tuple(Key(key=key, shift=shift, ctrl=ctrl) for key in keys)


def _toggle(name: str) -> Callable[[Gestures], None]:
    return lambda g: g.tab.set(**{name: not getattr(g.tab.state, name)})


def _change_opacity(tab: Tab, more: float) -> None:
    least, most = OPACITIES
    tab.set(opacity=round(min(max(tab.state.opacity + more, least), most), 2))


def _rearrange(gestures: Gestures) -> None:
    """A and B beside each other, stacked, in one picture, and again from the start; elsewhere to A | B."""
    tab, ways = gestures.tab, tuple(ARRANGEMENTS)
    if tab.state.mode != "ab":
        tab.set(mode="ab")
        return
    tab.set(arrangement=ways[(ways.index(tab.arrangement) + 1) % len(ways)])


def _turn_side(gestures: Gestures) -> None:
    """Left, right, top, and again from the start; one that is off is switched on."""
    tab = gestures.tab
    named = SIDES_SEEN.index(tab.state.side_from) if tab.state.side_from in SIDES_SEEN else -1
    tab.set(side=True, side_from=SIDES_SEEN[(named + tab.state.side) % len(SIDES_SEEN)])


def _go_to_next_person(gestures: Gestures) -> None:
    someone = gestures.tab.someone
    if not someone.others:
        raise InputError("This project has one person: there is no other one to go to.")
    everybody = someone.everybody
    gestures.tab.browser.go_to(everybody[(someone.number + 1) % len(everybody)])


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


_PLAYING = {
    "play": Action(title="Play or pause", run=lambda g: g.tab.toggle_playing(), keys=_keys("Space")),
    **{
        name: Action(
            title=title,
            run=lambda g, frames=frames: g.tab.step(frames),
            keys=_keys(key, shift=abs(frames) > 1),
            family="Previous, next frame" if abs(frames) == 1 else f"{abs(frames)} frames back, forward",
            repeats=True,
        )
        for name, title, frames, key in (
            ("previous", "Previous frame", -1, "ArrowLeft"),
            ("next", "Next frame", 1, "ArrowRight"),
            ("previous10", "10 frames back", -10, "ArrowLeft"),
            ("next10", "10 frames forward", 10, "ArrowRight"),
        )
    },
    "first": Action(
        title="First frame", run=lambda g: g.tab.step(-g.tab.length), keys=_keys("Home"), family="First, last frame"
    ),
    "last": Action(
        title="Last frame", run=lambda g: g.tab.step(g.tab.length), keys=_keys("End"), family="First, last frame"
    ),
    "loop": Action(title="Loop or not", run=_toggle("loop"), keys=_keys("l")),
}
_VIEW = {
    **{
        mode: Action(
            title=f"Mode: {name}",
            run=lambda g, mode=mode: g.tab.set(mode=mode),
            keys=_keys(f"Digit{number}"),
            family=f"Mode {', '.join(MODES.values())}",
        )
        for number, (mode, name) in enumerate(MODES.items(), 1)
    },
    "blink": Action(title="Blink: A in B's place", run=_toggle("blinked"), keys=_keys("b")),
    "arrangement": Action(title="A | B: side by side, stacked or wipe", run=_rearrange, keys=_keys("w")),
    "bodies": Action(title="Bodies on or off", run=_toggle("bodies"), keys=_keys("m")),
    "bones": Action(title="Keypoints on or off", run=_toggle("keypoints"), keys=_keys("k")),
    "next_person": Action(title="Next person of the clip", run=_go_to_next_person, keys=_keys("q")),
    "peek": Action(title="Video only, while held", run=lambda g: None, keys=_keys("p"), held=True),
    **{
        name: Action(
            title=f"{word} opacity",
            run=lambda g, more=more: _change_opacity(g.tab, more),
            keys=_keys(key),
            family="Less, more opacity",
            repeats=True,
        )
        for name, word, more, key in (("fainter", "Less", -0.1, ","), ("denser", "More", 0.1, "."))
    },
    "wireframe": Action(title="Wireframe on or off", run=_toggle("wireframe"), keys=_keys("g")),
    "outline": Action(title="Outline on or off", run=_toggle("outline"), keys=_keys("u")),
    "silhouette": Action(
        title="Silhouette on or off", run=lambda g: g.tab.switch_silhouette(), keys=_keys("u", shift=True)
    ),
    "difference": Action(title="Colour by distance between A and B", run=_toggle("difference"), keys=_keys("d")),
    "side": Action(title="Side view on or off", run=_toggle("side"), keys=_keys("v")),
    "turn_side": Action(title="Side view from the next side", run=_turn_side, keys=_keys("v", shift=True)),
    "fit_view": Action(title="Whole picture", run=lambda g: show_whole(g.tab), keys=_keys("f")),
    "zoom": Action(title="Zoom to the selected keypoints", run=lambda g: zoom_to_selection(g.tab), keys=_keys("z")),
    "close_up": Action(
        title="Close-up that follows: right hand, left hand, face, off",
        run=lambda g: next_close_up(g.tab),
        keys=_keys("e"),
    ),
    "trail": Action(title="Trail of the selected keypoints on or off", run=_toggle("trail"), keys=_keys("j")),
    "save_picture": Action(title="Save the picture", run=lambda g: g.tab.save_picture()),
    "first_steps": Action(title="Show the first steps", run=lambda g: g.tab.show_first_steps()),
    "help": Action(title="Show all keys", run=_toggle("keys"), keys=_keys("h")),
}
_KEYPOINTS = {
    "bad": Action(title="Mark bad, or restore", run=lambda g: g.correcting.toggle_bad(), keys=_keys("x")),
    "reset": Action(
        title="Reset to the detection", run=lambda g: g.correcting.reset(), keys=_keys("Backspace", "Delete")
    ),
    "copy": Action(title="Copy from the previous frame", run=lambda g: g.correcting.copy_previous(), keys=_keys("c")),
    "interpolate": Action(title="Interpolate", run=lambda g: g.correcting.interpolate(), keys=_keys("i")),
    "keyframes": Action(title="Keyframes on or off", run=_toggle("keyframes"), keys=_keys("a")),
    "delete_key": Action(
        title="Delete the keyframe",
        run=lambda g: g.correcting.delete_key(),
        keys=_keys("Backspace", "Delete", shift=True),
    ),
    "hand_along": Action(title="The hand goes with its wrist, or not", run=_toggle("hand_along")),
    "swap_body": Action(
        title="Swap left and right of the body", run=lambda g: g.correcting.swap_sides("body"), keys=_keys("s")
    ),
    "swap_hands": Action(
        title="Swap the hands", run=lambda g: g.correcting.swap_sides("hands"), keys=_keys("s", shift=True)
    ),
    "mirror_depth": Action(title="Mirror in depth", run=lambda g: g.depth.send("mirror"), keys=_keys("m", shift=True)),
    "in_front": Action(title="Put in front of shoulder or hip", run=lambda g: g.depth.send("front")),
    "behind": Action(title="Put behind shoulder or hip", run=lambda g: g.depth.send("behind")),
    "interpolate_depth": Action(title="Interpolate depth", run=lambda g: g.depth.interpolate_depth()),
    "pin": Action(
        title="Pin in space over the selected frames", run=lambda g: g.depth.pin(), keys=_keys("p", shift=True)
    ),
    "lock": Action(title="Lock the joint as it is turned", run=lambda g: g.depth.lock(), keys=_keys("l", shift=True)),
    "unlock": Action(title="Unlock the joint", run=lambda g: g.depth.unlock()),
    "clear_depth": Action(title="Clear depth", run=lambda g: g.depth.clear_depth()),
    **{
        f"nudge_{name}": Action(
            title=f"Nudge {name} by 1 px",
            run=lambda g, dx=dx, dy=dy: g.correcting.nudge(dx, dy),
            keys=_keys(key, ctrl=True),
            family="Nudge by 1 px",
            repeats=True,
        )
        for name, key, dx, dy in (
            ("left", "ArrowLeft", -1.0, 0.0),
            ("right", "ArrowRight", 1.0, 0.0),
            ("up", "ArrowUp", 0.0, -1.0),
            ("down", "ArrowDown", 0.0, 1.0),
        )
    },
    **{
        f"detect_{part}": Action(
            title=f"Detect the {part_name(part)} again", run=lambda g, part=part: g.again.look(part)
        )
        for part in PARTS
    },
    **{
        f"frame_{part}": Action(
            title=f"Detect the {part_name(part)} in a rectangle", run=lambda g, part=part: g.again.frame(part)
        )
        for part in PARTS
    },
    "cancel_detecting": Action(title="Cancel detecting again", run=lambda g: g.again.cancel()),
    "all": Action(
        title="Select all keypoints on show", run=lambda g: g.correcting.select_all(), keys=_keys("a", ctrl=True)
    ),
    "escape": Action(title="Cancel, select nothing", run=_escape, keys=_keys("Escape")),
    "undo": Action(title="Undo", run=lambda g: g.correcting.undo(), keys=_keys("z", ctrl=True), repeats=True),
    "redo": Action(
        title="Redo",
        run=lambda g: g.correcting.redo(),
        keys=(*_keys("z", shift=True, ctrl=True), *_keys("y", ctrl=True)),
        repeats=True,
    ),
}
_FRAMES = {
    "range_start": Action(
        title="Select frames from here on",
        run=lambda g: _edge(g, first=True),
        keys=_keys("["),
        family="Select frames from here on, up to here",
    ),
    "range_end": Action(
        title="Select frames up to here",
        run=lambda g: _edge(g, first=False),
        keys=_keys("]"),
        family="Select frames from here on, up to here",
    ),
    "next_suspect": Action(
        title="Next suspicious frame",
        run=lambda g: g.reviewing.go(1),
        keys=_keys("n"),
        family="Next, previous suspicious frame",
    ),
    "previous_suspect": Action(
        title="Previous suspicious frame",
        run=lambda g: g.reviewing.go(-1),
        keys=_keys("n", shift=True),
        family="Next, previous suspicious frame",
    ),
    "fine": Action(title="Looks fine, or not", run=lambda g: g.reviewing.dismiss(), keys=_keys("o")),
    "flag": Action(title="Flag, or not", run=lambda g: g.reviewing.flag(), keys=_keys("t")),
    "note": Action(title="Write a note", run=lambda g: g.noting.begin(), keys=_keys("y")),
    "copy_link": Action(title="Copy a link to this frame and fit", run=lambda g: g.noting.copy_link()),
}
_FIT = {
    "rerun": Action(title="Re-run the selected frames", run=lambda g: g.fitting.frames(), keys=_keys("r")),
    "rerun_edited": Action(title="Re-run around edited and flagged frames", run=lambda g: g.fitting.edited()),
    "rerun_shape": Action(title="Re-run the shape", run=lambda g: g.fitting.shape()),
    "fit": Action(title="Fit everything", run=lambda g: g.fitting.everything(), keys=_keys("r", shift=True)),
    "cancel": Action(title="Cancel all fitting", run=lambda g: g.tab.session.cancel()),
}
ACTIONS: dict[str, Action] = {
    name: replace(action, group=group)
    for group, actions in {
        "Playing": _PLAYING,
        "View": _VIEW,
        "Keypoints": _KEYPOINTS,
        "Frames": _FRAMES,
        "Fit": _FIT,
    }.items()
    for name, action in actions.items()
}
"""By the name under which the page sends them."""


def bindings() -> tuple[KeyBinding, ...]:
    """All keys, as the page wants them."""
    return tuple(
        KeyBinding(key=key.key, action=name, shift=key.shift, ctrl=key.ctrl, held=action.held)
        for name, action in ACTIONS.items()
        for key in action.keys
    )
