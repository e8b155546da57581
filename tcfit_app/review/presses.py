"""Buttons in the HTML of panels: what each does, given a value that comes from the page and may be anything."""

import logging
from collections.abc import Callable, Collection
from typing import Any

from tcfit_app.review.browser.page_events import Press

_log = logging.getLogger(__name__)


class Presses:
    """The commands of one page's buttons."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[Callable[[Any], None], Callable[[str], Any]]] = {}

    def on(self, command: str, run: Callable[[Any], None], read: Callable[[str], Any] = str) -> None:
        """What a button does.

        Args:
            command: a name that is not taken.
            run: does it, given what `read` makes of the button's value.
            read: raises KeyError or ValueError for what no button has.
        """
        assert command not in self._known, f"{command} is taken"
        self._known[command] = (run, read)

    def take(self, event: Press) -> None:
        """Do what a button does; what no button sends is dropped, and the log says so."""
        try:
            run, read = self._known[event.command]
            value = read(event.value)
        except (KeyError, ValueError):
            _log.warning("A press in the page is dropped: %r with %r", event.command, event.value)
            return
        run(value)


def one_of(names: Collection[str]) -> Callable[[str], str]:
    """Reads one of these names."""

    def read(value: str) -> str:
        if value not in names:
            raise ValueError(value)
        return value

    return read
