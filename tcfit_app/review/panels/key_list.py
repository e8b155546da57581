"""All keys and gestures, listed in the app's keys window; docs/app.md shows them as a table."""

from collections.abc import Callable
from itertools import groupby

from tcfit_app.review.gestures.actions import ACTIONS, Gestures, Key
from tcfit_app.review.panels.elements.html import Board, Html, action, heading, joined, line, row, table, tag

GESTURES = {
    "In the picture": (
        ("Click", "Select a keypoint"),
        ("Drag", "Move the selected keypoints; the fit follows"),
        ("Shift+click", "Add a keypoint to the selection, or take it out"),
        ("Shift+drag", "Select the keypoints in a rectangle"),
        ("Right click", "Menu for the selected keypoints, or for the picture"),
        ("Wheel, right drag", "Zoom, pan"),
    ),
    "In the side view": (
        ("Click", "Select a keypoint of the fit"),
        ("Drag a keypoint", "Move it in depth, along its viewing ray; the fit follows"),
    ),
    "In 3D": (
        ("Drag", "Turn the view"),
        ("Drag a ring", "Turn the selected joint, and lock it; the fit follows"),
        ("Wheel, right drag", "Zoom, pan"),
    ),
    "In the timeline": (
        ("Click, drag", "Go to a frame; on a mark, to what it marks"),
        ("Drag in the ruler, or Shift+drag", "Select frames; their ends can be dragged"),
        ("Double click", "Clear frame selection"),
        ("Right click", "Menu for the frames"),
        ("Drag a keyframe", "Move it to another frame"),
        ("Wheel", "Zoom; with Shift, or sideways, scroll"),
        ("Drag the bar at the bottom", "Scroll"),
    ),
}
"""Pointer gestures by place (`browser/web/`): the gesture, and its effect."""


def key_groups() -> dict[str, list[tuple[str, str]]]:
    """Keys and what they do, by group of ACTIONS; actions of one family share a line."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for (group, family, _), found in groupby((name for name in ACTIONS if ACTIONS[name].keys), _line):
        names = list(found)
        keys = joined_keys(*(ACTIONS[name].keys for name in names))
        groups.setdefault(group, []).append((keys, family or ACTIONS[names[0]].title))
    return groups


def _line(name: str) -> tuple[str, str, str]:
    """The same for actions that share a line."""
    action = ACTIONS[name]
    return action.group, action.family, "" if action.family else action.title


def joined_keys(*keys: tuple[Key, ...]) -> str:
    """The keys of actions, as "Ctrl+← →", with shared modifiers named once."""
    if len(keys) == 1:
        return " or ".join(map(str, keys[0]))
    first = [alike[0] for alike in keys]
    modifiers = {(key.shift, key.ctrl) for key in first}
    if len(modifiers) > 1:
        return ", ".join(map(str, first))
    return " ".join([str(first[0]), *(str(key).rpartition("+")[2] for key in first[1:])])


class KeyWindow:
    """The window of all keys, open while the tab's state says so."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        self._close: Callable[[], None] | None = None
        """Closes it; None while it is closed."""

    def draw(self) -> None:
        """Open or close it."""
        if self._tab.state.keys and self._close is None:
            self._close = self._open()
        elif not self._tab.state.keys and self._close is not None:
            self._close()
            self._close = None

    def _open(self) -> Callable[[], None]:
        window = self._tab.client.gui.add_modal("Keys")
        with window:
            shown = Board(self._tab)
        shown.show(keys_html(self._gestures))

        def close() -> None:
            shown.show()  # its buttons no longer work
            window.close()

        return close


def keys_html(gestures: Gestures) -> Html:
    """The content of the keys window, with the button that closes it."""
    blocks = [_block(title, tuple(rows)) for title, rows in {**key_groups(), **GESTURES}.items()]
    steps = row(action(gestures, "first_steps", "First steps"))
    close = action(gestures, "help", "Close", kind="close")
    return joined(steps, tag("div", joined(*blocks), class_="tcfit-keys"), close)


def _block(title: str, rows: tuple[tuple[str, str], ...]) -> Html:
    lines = [line(tag("kbd", keys), what) for keys, what in rows]
    return tag("section", joined(heading(title, first=True), table(lines)))
