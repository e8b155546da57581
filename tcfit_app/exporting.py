"""One export at a time, on a thread of its own: its progress, its end, and the way to stop it."""

import logging
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from fitting_core.errors import InputError
from tcfit_app.exports import Export, ExportSource

_log = logging.getLogger(__name__)


class _Cancelled(Exception):
    """Ends a writer from within its progress."""


class Exporting:
    """An export from its start to its end. Begins at once.

    Args:
        export: what is written.
        source: from what.
        done: gets the file's content, on the export's thread.
    """

    def __init__(self, export: Export, source: ExportSource, done: Callable[[bytes], None]) -> None:
        self.export, self.name = export, source.clip.name + export.suffix
        self.share = 0.0
        self.state: Literal["running", "finished", "cancelled", "failed"] = "running"
        self.reason = ""
        """Why it failed."""
        self.size = 0
        """Bytes."""
        self._source, self._done = source, done
        self._cancelled = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tcfit exports", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Stop, at the writer's next step; nothing is kept."""
        self._cancelled.set()

    @property
    def stopping(self) -> bool:
        """Whether it was cancelled and has not ended yet."""
        return self._cancelled.is_set() and self.state == "running"

    def join(self, timeout: float | None = None) -> None:
        """Wait until it has ended."""
        self._thread.join(timeout)

    def _progress(self, share: float) -> None:
        if self._cancelled.is_set():
            raise _Cancelled
        self.share = share

    def _run(self) -> None:
        try:
            with tempfile.TemporaryDirectory(prefix="tcfit-export-") as folder:
                path = Path(folder) / f"export{self.export.suffix}"
                self._progress(0.0)
                self.export.write(self._source, path, self._progress)
                self._progress(1.0)
                content = path.read_bytes()
            self.size = len(content)
            self._done(content)
            self.state = "finished"
        except _Cancelled:
            self.state = "cancelled"
        except InputError as error:
            self.reason, self.state = str(error), "failed"
        except Exception as error:  # whatever it was: the user is told
            _log.exception("The export %s failed", self.export.title)
            self.reason, self.state = f"{type(error).__name__}: {error}", "failed"
