"""Errors in a loop that must go on: reported once, retried a little later."""

import asyncio
import logging
from collections.abc import Callable
from traceback import walk_tb

from tcfit_app.fitting.reports import Notice

AGAIN = 1.0
"""Seconds until something that failed is retried: the loop would do so sixty times a second."""
_log = logging.getLogger(__name__)


class Faults:
    """Runs steps repeatedly, in spite of any errors.

    Args:
        tell: reports an error to users, once until it changes or is gone.
    """

    def __init__(self, tell: Callable[[Notice], None]) -> None:
        self._tell = tell
        self._known: dict[str, tuple[str, float]] = {}
        """What failed, by what was done, and when it is retried."""

    def attempt(self, what: str, do: Callable[[], object], now: float) -> None:
        """Do something, unless it has just failed.

        viser's queue may fail when two threads wake its sender at once, because it sets an asyncio event outside of the
        event's loop. Only that is tried a second time at once: another step may have been half done, and saving again
        would hide the first error.

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
            except RuntimeError as error:
                if not _is_of_an_event(error):
                    raise
                do()
        except Exception as error:
            text = f"{type(error).__name__}: {error}"
            self._known[what] = (text, now + AGAIN)
            if known != text:
                _log.exception("The review app could not %s", what)
                self._tell(_notice(what, text))
        else:
            self._known.pop(what, None)


def _is_of_an_event(error: RuntimeError) -> bool:
    """Whether an asyncio event raised it: its waiters changed in another thread while it woke them."""
    *_, (frame, _) = walk_tb(error.__traceback__)
    return frame.f_code is asyncio.Event.set.__code__


def _notice(what: str, text: str) -> Notice:
    message = f"Could not {what}: {text}. Nothing is lost, and tcfit keeps trying; its terminal has the details."
    return Notice(title="Something went wrong in tcfit", text=message, kind="error")
