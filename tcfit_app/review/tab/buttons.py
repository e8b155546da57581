"""Buttons in the HTML of panels: what each does, and which can be pressed now.

A press comes from the page and may be anything: a foreign page sends what it likes, a slow one sends what was shown a
moment ago. So a button works only while a panel shows it, enabled.
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
"""Seconds for which a value just replaced still counts: the press was on its way."""
_TAG = re.compile(r"<(?:button|tr)\b([^>]*)>")
_ATTRIBUTE = re.compile(r'([\w-]+)(?:="([^"]*)")?')


class Buttons:
    """The buttons of one tab."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[Callable[[Any], None], Callable[[str], Any]]] = {}
        self._shown: dict[object, frozenset[tuple[str, str]]] = {}
        """Command and value of the enabled buttons, by who shows them."""
        self._until: dict[tuple[str, str], float] = {}
        """When a removed button stops counting."""
        self._dropped = Dropped()

    def on(self, command: str, run: Callable[[Any], None], read: Callable[[str], Any] = str) -> None:
        """Register what a button does.

        Args:
            command: a unique name.
            run: does it, given the result of `read`.
            read: parses the button's value; raises KeyError or ValueError for one that no button has.
        """
        assert command not in self._known, f"{command} is taken"
        self._known[command] = (run, read)

    def show(self, owner: object, html: str) -> None:
        """Set the buttons that an owner shows to those in this HTML; an empty text removes them."""
        now, there = time.monotonic(), offered(html)
        self._until = {button: end for button, end in self._until.items() if end > now}
        self._until |= dict.fromkeys(self._shown.get(owner, frozenset()) - there, now + LATE)
        self._shown.pop(owner, None)
        if there:
            self._shown[owner] = there

    def on_show(self, command: str, value: str) -> bool:
        """Whether such a button can be pressed: it is shown, or its command is, with a value that was just replaced."""
        there = frozenset[tuple[str, str]]().union(*self._shown.values())
        if (command, value) in there:
            return True
        replaced = self._until.get((command, value), 0.0) > time.monotonic()
        return replaced and any(command == other for other, _ in there)

    def take(self, event: Press) -> None:
        """Do what a button does; presses of buttons not shown are dropped."""
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
    """Command and value of every enabled button and row in HTML made by `panels/elements/html.py`."""
    found = set()
    for tag in _TAG.finditer(html):
        given = {name: unescape(value) for name, value in _ATTRIBUTE.findall(tag[1])}
        if given.get("data-tcfit") and "disabled" not in given:
            found.add((given["data-tcfit"], given.get("data-value", "")))
    return frozenset(found)


def one_of(names: Collection[Name]) -> Callable[[str], Name]:
    """A parser that accepts only these names."""

    def read(value: str) -> Name:
        if (found := next((name for name in names if name == value), None)) is None:
            raise ValueError(value)
        return found

    return read
