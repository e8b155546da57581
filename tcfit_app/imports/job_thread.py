"""Something that a user began in a panel, on a thread of its own."""

import logging
import threading
from abc import ABC, abstractmethod
from typing import Literal

from fitting_core.errors import InputError

_log = logging.getLogger(__name__)


class _Cancelled(Exception):
    """Ends the work from within."""


class JobThread(ABC):
    """Runs from `start` to its end, however that comes: finished, cancelled, or failed with a reason.

    Args:
        title: what it is, for the log.
    """

    def __init__(self, title: str) -> None:
        self.state: Literal["running", "finished", "cancelled", "failed"] = "running"
        self.reason = ""
        """Why it failed."""
        self._title = title
        self._cancelled = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"tcfit: {title}", daemon=True)

    @abstractmethod
    def _work(self) -> None:
        """The work itself, which calls `_go_on` at every step."""

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def cancel(self) -> None:
        """Stop at the work's next step."""
        self._cancelled.set()

    @property
    def stopping(self) -> bool:
        """Whether it was cancelled and has not ended yet."""
        return self._cancelled.is_set() and self.state == "running"

    def join(self, timeout: float | None = None) -> None:
        """Wait until it has ended."""
        self._thread.join(timeout)

    def _go_on(self) -> None:
        if self._cancelled.is_set():
            raise _Cancelled

    def _run(self) -> None:
        try:
            self._work()
            self.state = "finished"
        except _Cancelled:
            self.state = "cancelled"
        except InputError as error:
            self.reason, self.state = str(error), "failed"
        except Exception as error:  # whatever it was: the user is told
            _log.exception("%s failed", self._title)
            self.reason, self.state = f"{type(error).__name__}: {error}", "failed"
