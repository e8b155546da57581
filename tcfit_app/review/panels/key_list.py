"""All keys and gestures, listed in the app's keys window; docs/app.md shows them as a table."""

from itertools import groupby

from fitting_core.errors import InputError
from tcfit_app.review.gestures.actions import ACTIONS, Key
from tcfit_app.review.gestures.own_keys import change_keys, keys_of, keys_problem
from tcfit_app.review.panels.elements.field import Field
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    button,
    heading,
    joined,
    line,
    paragraph,
    row,
    table,
    tag,
)
from tcfit_app.review.tab.tab import Tab

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
        ("Drag the left border", "Make it wider"),
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
        ("Drag the bar at the bottom", "Scroll; its ends zoom"),
        ("Drag the upper border", "Make it higher; so do ↑ ↓ once Tab has reached it"),
    ),
}
"""Pointer gestures by place (`browser/web/`): the gesture, and its effect."""


def key_groups() -> dict[str, list[tuple[str, str]]]:
    """Keys and what they do, by group of ACTIONS; actions of one family share a line."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for (group, family, _), found in groupby(filter(keys_of, ACTIONS), _line):
        names = list(found)
        keys = joined_keys(*map(keys_of, names))
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

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._open: _Shown | None = None
        tab.buttons.on("keys.change", lambda _: self._open and self._open.change())
        tab.buttons.on("keys.usual", lambda _: self._open and self._open.change(usual=True))

    def draw(self) -> None:
        """Open or close it, and show the keys as they are."""
        if not self._tab.state.keys and self._open is not None:
            self._open.close()
            self._open = None
        elif self._tab.state.keys:
            self._open = self._open or _Shown(self._tab)
            self._open.draw()


class _Shown:
    """The window while it is open: all keys, and a form to change those of a command."""

    def __init__(self, tab: Tab) -> None:
        self._said = ""
        """Why the last change was refused."""
        gui = tab.client.gui
        self._window = gui.add_modal("Keys")
        with self._window:
            with gui.add_folder("Change keys", expand_by_default=False):
                command = gui.add_dropdown("Command", tuple(_BY_TITLE), hint="Whose keys to change, in all projects")
                self._command = Field(tab, command, self._choose)
                self._chosen = command.value
                self._keys = gui.add_text("Keys", "", hint=_HINT)
                self._form = Board(tab)
            self._list = Board(tab)
        self._choose(self._chosen)

    def _choose(self, title: str) -> None:
        self._chosen, self._said = title, ""
        self._keys.value = " ".join(map(str, keys_of(_BY_TITLE[title])))

    def change(self, *, usual: bool = False) -> None:
        """Take the keys from the form, or the usual ones of its command; what is refused stays there to be mended."""
        try:
            change_keys(_BY_TITLE[self._chosen], None if usual else self._keys.value)
        except InputError as error:
            self._said = str(error)
        else:
            self._choose(self._chosen)

    def draw(self) -> None:
        """Show the keys as they are."""
        self._command.show(self._chosen)
        problem = keys_problem() or self._said
        change = button("Change", "keys.change", kind="main", enter=True)
        self._form.show(
            row(change, button("Usual keys", "keys.usual")), *([paragraph(problem, "warn")] if problem else [])
        )
        self._list.show(keys_html())

    def close(self) -> None:
        """Close the window; its buttons no longer work."""
        self._form.show()
        self._list.show()
        self._window.close()


_BY_TITLE = {action.title: name for name, action in ACTIONS.items()}
assert len(_BY_TITLE) == len(ACTIONS)
_HINT = "Like D, Shift+D, Ctrl+D, F2 or PageDown; several with a space between them, none to leave it without a key"


def keys_html() -> Html:
    """The content of the keys window, with the button that closes it."""
    blocks = [_block(title, tuple(rows)) for title, rows in {**key_groups(), **GESTURES}.items()]
    steps = row(button("First steps", "action", "first_steps"))
    close = button("Close", "action", "help", kind="close")
    return joined(steps, tag("div", joined(*blocks), class_="tcfit-keys"), close)


def _block(title: str, rows: tuple[tuple[str, str], ...]) -> Html:
    lines = [line(tag("kbd", keys), what) for keys, what in rows]
    return tag("section", joined(heading(title, first=True), table(lines)))
