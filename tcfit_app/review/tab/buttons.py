"""Buttons in the HTML of panels: what each does, and which can be pressed now.

A press comes from the page and may be anything: a foreign page sends what it likes, a slow one sends what was shown a
moment ago. So a button works only while a panel shows it, enabled.
"""

import time
from collections.abc import Callable

from tcfit_app.review.browser.page_events import Press
from tcfit_app.server.screen import Dropped

LATE = 2.0
"""Seconds for which a value just replaced still counts: the press was on its way."""
Presses = dict[tuple[str, str], Callable[[], object]]
"""What buttons do, by command and value."""


class Buttons:
    """The buttons of one tab."""

    def __init__(self) -> None:
        self._shown: dict[object, Presses] = {}
        """The enabled buttons, by who shows them."""
        self._replaced: dict[tuple[str, str], tuple[float, Callable[[], object]]] = {}
        """Removed buttons, and until when they count."""
        self._dropped = Dropped()

    def show(self, owner: object, presses: Presses) -> None:
        """Set the enabled buttons that an owner shows; none removes them."""
        before, now = self._shown.pop(owner, {}), time.monotonic()
        if gone := before.keys() - presses.keys():
            self._replaced = {key: known for key, known in self._replaced.items() if known[0] > now}
            self._replaced |= {key: (now + LATE, before[key]) for key in gone}
        if presses:
            self._shown[owner] = presses

    def find(self, command: str, value: str = "") -> Callable[[], object] | None:
        """What a button does that can be pressed: it is shown, or its command is, with a value that was just
        replaced. None if there is no such button."""
        for presses in self._shown.values():
            if (do := presses.get((command, value))) is not None:
                return do
        until, do = self._replaced.get((command, value), (0.0, None))
        there = any(command == other for presses in self._shown.values() for other, _ in presses)
        return do if there and until > time.monotonic() else None

    def take(self, event: Press) -> None:
        """Do what a button does; presses of buttons not shown are dropped."""
        if (do := self.find(event.command, event.value)) is None:
            self._dropped.note(f"not on show: {event}")
        else:
            do()
