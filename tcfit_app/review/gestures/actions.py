"""Everything that a key or the command palette can do, in one table."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError
from tcfit_app.review.browser.page_states import KeyBinding
from tcfit_app.review.gestures.correcting import Correcting
from tcfit_app.review.gestures.fitting import Fitting
from tcfit_app.review.gestures.reviewing import Reviewing
from tcfit_app.review.tab.state import MODES
from tcfit_app.review.tab.tab import Tab


class Gestures:
    """The gestures of one tab; they raise InputError for what cannot be done, and then nothing changes."""

    def __init__(self, tab: Tab) -> None:
        self.tab = tab
        self.correcting, self.reviewing, self.fitting = Correcting(tab), Reviewing(tab), Fitting(tab)


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key as browsers name it: `KeyboardEvent.code`, or `.key` for signs."""

    code: str
    shift: bool = False
    ctrl: bool = False
    """Control; Command on a Mac."""

    def __str__(self) -> str:
        name = NAMES.get(self.code, self.code.removeprefix("Key").removeprefix("Digit"))
        return "+".join([*(["Ctrl"] if self.ctrl else []), *(["Shift"] if self.shift else []), name])


NAMES = {
    "ArrowLeft": "←",
    "ArrowRight": "→",
    "ArrowUp": "↑",
    "ArrowDown": "↓",
    "Escape": "Esc",
    "BracketLeft": "[",
    "BracketRight": "]",
    "Slash": "/",
}
"""Of keys whose code is not their name."""


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

    @property
    def key_text(self) -> str | None:
        """Its keys, for the user."""
        return " or ".join(map(str, self.keys)) or None


def _keys(*codes: str, shift: bool = False, ctrl: bool = False) -> tuple[Key, ...]:
    return tuple(Key(code=code, shift=shift, ctrl=ctrl) for code in codes)


def _toggle(name: str) -> Callable[[Gestures], None]:
    return lambda g: g.tab.set(**{name: not getattr(g.tab.state, name)})


def _escape(gestures: Gestures) -> None:
    gestures.correcting.abandon()
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
            keys=_keys(code, shift=abs(frames) > 1),
            family="A frame back, on" if abs(frames) == 1 else f"{abs(frames)} frames back, on",
            repeats=True,
        )
        for name, title, frames, code in (
            ("previous", "Previous frame", -1, "ArrowLeft"),
            ("next", "Next frame", 1, "ArrowRight"),
            ("previous10", "10 frames back", -10, "ArrowLeft"),
            ("next10", "10 frames on", 10, "ArrowRight"),
        )
    },
    "first": Action(
        title="First frame", run=lambda g: g.tab.step(-g.tab.length), keys=_keys("Home"), family="First, last frame"
    ),
    "last": Action(
        title="Last frame", run=lambda g: g.tab.step(g.tab.length), keys=_keys("End"), family="First, last frame"
    ),
    "loop": Action(title="Loop or not", run=_toggle("loop"), keys=_keys("KeyL")),
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
    "blink": Action(title="Blink: A in B's place", run=_toggle("blinked"), keys=_keys("KeyB")),
    "bodies": Action(title="Bodies on or off", run=_toggle("bodies"), keys=_keys("KeyM")),
    "bones": Action(title="Keypoints on or off", run=_toggle("keypoints"), keys=_keys("KeyK")),
    "wireframe": Action(title="Wireframe on or off", run=_toggle("wireframe"), keys=_keys("KeyG")),
    "difference": Action(title="Colour by distance between A and B", run=_toggle("difference"), keys=_keys("KeyD")),
    "fit_view": Action(title="Whole picture", run=lambda g: g.tab.scene.cameras.reset(), keys=_keys("KeyF")),
    "zoom": Action(title="Zoom to the selected keypoints", run=lambda g: zoom_to_selection(g.tab), keys=_keys("KeyZ")),
    "help": Action(title="Show all keys", run=_toggle("keys"), keys=_keys("KeyH")),
}
_KEYPOINTS = {
    "bad": Action(title="Mark bad, or restore", run=lambda g: g.correcting.toggle_bad(), keys=_keys("KeyX")),
    "reset": Action(
        title="Reset to the detection", run=lambda g: g.correcting.reset(), keys=_keys("Backspace", "Delete")
    ),
    "copy": Action(
        title="Copy from the previous frame", run=lambda g: g.correcting.copy_previous(), keys=_keys("KeyC")
    ),
    "interpolate": Action(title="Interpolate", run=lambda g: g.correcting.interpolate(), keys=_keys("KeyI")),
    "swap_body": Action(
        title="Swap left and right of the body", run=lambda g: g.correcting.swap_sides("body"), keys=_keys("KeyS")
    ),
    "swap_hands": Action(
        title="Swap the hands", run=lambda g: g.correcting.swap_sides("hands"), keys=_keys("KeyS", shift=True)
    ),
    **{
        f"nudge_{name}": Action(
            title=f"Nudge {name} by 1 px",
            run=lambda g, dx=dx, dy=dy: g.correcting.nudge(dx, dy),
            keys=_keys(code, ctrl=True),
            family="Nudge by 1 px",
            repeats=True,
        )
        for name, code, dx, dy in (
            ("left", "ArrowLeft", -1.0, 0.0),
            ("right", "ArrowRight", 1.0, 0.0),
            ("up", "ArrowUp", 0.0, -1.0),
            ("down", "ArrowDown", 0.0, 1.0),
        )
    },
    "all": Action(
        title="Select all keypoints on show", run=lambda g: g.correcting.select_all(), keys=_keys("KeyA", ctrl=True)
    ),
    "escape": Action(title="Cancel, select nothing", run=_escape, keys=_keys("Escape")),
    "undo": Action(title="Undo", run=lambda g: g.correcting.undo(), keys=_keys("KeyZ", ctrl=True), repeats=True),
    "redo": Action(
        title="Redo",
        run=lambda g: g.correcting.redo(),
        keys=(*_keys("KeyZ", shift=True, ctrl=True), *_keys("KeyY", ctrl=True)),
        repeats=True,
    ),
}
_FRAMES = {
    "range_start": Action(
        title="Select frames from here on",
        run=lambda g: _edge(g, first=True),
        keys=_keys("BracketLeft"),
        family="Select frames from here on, up to here",
    ),
    "range_end": Action(
        title="Select frames up to here",
        run=lambda g: _edge(g, first=False),
        keys=_keys("BracketRight"),
        family="Select frames from here on, up to here",
    ),
    "next_suspect": Action(
        title="Next suspicious frame",
        run=lambda g: g.reviewing.go(1),
        keys=_keys("KeyN"),
        family="Next, previous suspicious frame",
    ),
    "previous_suspect": Action(
        title="Previous suspicious frame",
        run=lambda g: g.reviewing.go(-1),
        keys=_keys("KeyN", shift=True),
        family="Next, previous suspicious frame",
    ),
    "fine": Action(title="Looks fine, or not", run=lambda g: g.reviewing.dismiss(), keys=_keys("KeyO")),
    "flag": Action(title="Flag, or not", run=lambda g: g.reviewing.flag(), keys=_keys("KeyT")),
}
_FIT = {
    "rerun": Action(title="Re-run the selected frames", run=lambda g: g.fitting.frames(), keys=_keys("KeyR")),
    "rerun_edited": Action(title="Re-run around edited and flagged frames", run=lambda g: g.fitting.edited()),
    "rerun_shape": Action(title="Re-run the shape", run=lambda g: g.fitting.shape()),
    "fit": Action(title="Fit everything", run=lambda g: g.fitting.everything(), keys=_keys("KeyR", shift=True)),
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
        KeyBinding(key=key.code, action=name, shift=key.shift, ctrl=key.ctrl)
        for name, action in ACTIONS.items()
        for key in action.keys
    )


_LEAST_MARGIN, _MARGIN = 1 / 12, 1 / 4
"""Around keypoints that are zoomed to: of the image's diagonal at least, and of their own extent."""


def zoom_to_selection(tab: Tab) -> None:
    """Zoom to the selected keypoints. Raises InputError without any that are in the picture."""
    if not tab.state.selection or tab.state.mode == "space":
        raise InputError("Select keypoints in Edit or A | B first: the view then zooms to them.")
    chosen = tab.session.project.corrected.at((tab.state.frame,), tuple(tab.state.selection))
    # Undetected ones lie at (0, 0), and so do copies of them.
    xy = chosen.xy[(chosen.confidence > 0) | (chosen.edited & chosen.xy.any(-1))]
    if not len(xy):
        raise InputError("None of the selected keypoints was detected in this frame: there is nothing to zoom to.")
    low, high = surroundings(xy, tab.session.project.clip.camera.size)
    tab.scene.zoom_to((*low.tolist(), *high.tolist()))


def surroundings(xy: Float[np.ndarray, "n 2"], size: tuple[int, int]) -> Float[np.ndarray, "2 2"]:
    """A rectangle around points, with a margin as far as the image goes: first its least, then its largest corner."""
    low, high = xy.min(0), xy.max(0)
    margin = max(_LEAST_MARGIN * float(np.hypot(*size)), _MARGIN * float((high - low).max()))
    inside = np.array([np.maximum(low - margin, 0), np.minimum(high + margin, size)])
    return np.array([np.minimum(inside[0], low), np.maximum(inside[1], high)])
