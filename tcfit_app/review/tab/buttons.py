"""Buttons in the HTML of panels: what each does, and which of them can be pressed now.

A press comes from the page and may be anything: a strange page sends what it likes, and a slow one sends what was on
show a moment ago. So a button does something only while a panel shows it, switched on.
"""

import re
import time
from collections.abc import Callable, Collection
from html import unescape
from typing import Any, TypeVar

from tcfit_app.review.browser.page_events import Press
from tcfit_app.server.screen import Dropped

Name = TypeVar("Name", bound=str)
LATE = 2.0
"""Seconds for which a value still counts that has just been replaced: the press was on its way."""
_TAG = re.compile(r"<(?:button|tr)\b([^>]*)>")
_ATTRIBUTE = re.compile(r'([\w-]+)(?:="([^"]*)")?')


class Buttons:
    """The buttons of one tab."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[Callable[[Any], None], Callable[[str], Any]]] = {}
        self._shown: dict[object, frozenset[tuple[str, str]]] = {}
        """Command and value of what can be pressed, by who shows it."""
        self._until: dict[tuple[str, str], float] = {}
        """When a button that is gone stops to count."""
        self._dropped = Dropped()

    def on(self, command: str, run: Callable[[Any], None], read: Callable[[str], Any] = str) -> None:
        """What a button does.

        Args:
            command: a name that is not taken.
            run: does it, given what `read` makes of the button's value.
            read: raises KeyError or ValueError for what no button has.
        """
        assert command not in self._known, f"{command} is taken"
        self._known[command] = (run, read)

    def show(self, owner: object, html: str) -> None:
        """From now on the buttons in this HTML are those that its owner shows; none in an empty text."""
        now, there = time.monotonic(), offered(html)
        self._until = {button: end for button, end in self._until.items() if end > now}
        self._until |= dict.fromkeys(self._shown.get(owner, frozenset()) - there, now + LATE)
        self._shown.pop(owner, None)
        if there:
            self._shown[owner] = there

    def on_show(self, command: str, value: str) -> bool:
        """Whether such a button can be pressed: it is there, or its command is, with a value that was just replaced."""
        there = frozenset[tuple[str, str]]().union(*self._shown.values())
        if (command, value) in there:
            return True
        replaced = self._until.get((command, value), 0.0) > time.monotonic()
        return replaced and any(command == other for other, _ in there)

    def take(self, event: Press) -> None:
        """Do what a button does; a press of what is not on show is dropped."""
        try:
            run, read = self._known[event.command]
            value = read(event.value)
        except (KeyError, ValueError):
            self._dropped.note(event)
            return
        if not self.on_show(event.command, event.value):
            self._dropped.note(f"not on show: {event}")
            return
        run(value)


def offered(html: str) -> frozenset[tuple[str, str]]:
    """Command and value of every button and row in HTML of `panels/elements/html.py` that can be pressed."""
    found = set()
    for tag in _TAG.finditer(html):
        given = {name: unescape(value) for name, value in _ATTRIBUTE.findall(tag[1])}
        if given.get("data-tcfit") and "disabled" not in given:
            found.add((given["data-tcfit"], given.get("data-value", "")))
    return frozenset(found)


def one_of(names: Collection[Name]) -> Callable[[str], Name]:
    """Reads one of these names."""

    def read(value: str) -> Name:
        if (found := next((name for name in names if name == value), None)) is None:
            raise ValueError(value)
        return found

    return read
