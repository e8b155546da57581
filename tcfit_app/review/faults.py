"""What goes wrong in a loop that must go on: told once, tried again a little later."""

import logging
from collections.abc import Callable
from dataclasses import dataclass

from tcfit_app.fitting.notices import Notice

AGAIN = 1.0
"""Seconds until something that went wrong is tried again: the loop would do so sixty times a second."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Fault:
    text: str
    again: float


class Faults:
    """Does things over and over, whatever becomes of them.

    Args:
        tell: tells users what has gone wrong, once until it is another fault or was mended.
    """

    def __init__(self, tell: Callable[[Notice], None]) -> None:
        self._tell = tell
        self._known: dict[str, _Fault] = {}

    def attempt(self, what: str, do: Callable[[], object], now: float) -> None:
        """Do something, unless it has just failed.

        Args:
            what: in words, after "could not".
            do: does it.
            now: seconds of a clock.
        """
        known = self._known.get(what)
        if known is not None and now < known.again:
            return
        try:
            do()
        except Exception as error:
            text = f"{type(error).__name__}: {error}"
            self._known[what] = _Fault(text, now + AGAIN)
            if known is None or known.text != text:
                _log.exception("The review app could not %s", what)
                self._tell(_notice(what, text))
        else:
            self._known.pop(what, None)


def _notice(what: str, text: str) -> Notice:
    told = f"It could not {what}: {text}. It goes on trying, and nothing is lost; tcfit's terminal has the details."
    return Notice(title="Something went wrong in tcfit", text=told, kind="error")
