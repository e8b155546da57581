"""What goes wrong in a loop that must go on: told once, tried again a little later."""

import logging
from collections.abc import Callable

from tcfit_app.fitting.reports import Notice

AGAIN = 1.0
"""Seconds until something that went wrong is tried again: the loop would do so sixty times a second."""
_log = logging.getLogger(__name__)


class Faults:
    """Does things over and over, whatever becomes of them.

    Args:
        tell: tells users what has gone wrong, once until it is another fault or was mended.
    """

    def __init__(self, tell: Callable[[Notice], None]) -> None:
        self._tell = tell
        self._known: dict[str, tuple[str, float]] = {}
        """What went wrong, by what was done, and when that is tried again."""

    def attempt(self, what: str, do: Callable[[], object], now: float) -> None:
        """Do something, unless it has just failed, and twice if need be.

        viser's queue may stumble where two threads wake its sender at once (it sets an asyncio event outside of the
        event's loop), so only what fails at the second attempt too is told.

        Args:
            what: in words, after "could not".
            do: does it.
            now: seconds of a clock.
        """
        known, again = self._known.get(what, ("", now))
        if now < again:
            return
        try:
            try:
                do()
            except Exception:
                do()
        except Exception as error:
            text = f"{type(error).__name__}: {error}"
            self._known[what] = (text, now + AGAIN)
            if known != text:
                _log.exception("The review app could not %s", what)
                self._tell(_notice(what, text))
        else:
            self._known.pop(what, None)


def _notice(what: str, text: str) -> Notice:
    told = f"It could not {what}: {text}. It goes on trying, and nothing is lost; tcfit's terminal has the details."
    return Notice(title="Something went wrong in tcfit", text=told, kind="error")
