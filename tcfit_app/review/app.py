"""The review app: the one loop that draws, and the tabs that it draws."""

import logging
import queue
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import viser

from tcfit_app.fitting.reports import Notice
from tcfit_app.review.faults import Faults
from tcfit_app.review.page import Page
from tcfit_app.review.session.session import Session
from tcfit_app.review.shared.drawing_data import DrawingData
from tcfit_app.review.tab.state import TabState
from tcfit_app.server.gated_viser import is_here
from tcfit_app.server.page_files import PageFiles

TICK = 1 / 60
"""Seconds between two drawings while something moves."""
REST = 0.25
"""Seconds between two drawings while nothing does: messages end, the worker's news are looked for."""
MOST_COMMANDS = 5000
"""That may wait for the drawing thread; what pages ask for beyond is dropped."""
_log = logging.getLogger(__name__)


class ReviewApp:
    """Draws a session in every tab that is connected to a server.

    Args:
        session: the open project.
        server: behind its gate.
        files: the folder that alone pages may name files of; None: see `PageFiles`.
    """

    def __init__(self, session: Session, server: viser.ViserServer, *, files: Path | None = None) -> None:
        self.session, self._server, self._files = session, server, files
        self._commands: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._stop = threading.Event()
        self.data = DrawingData(session, lambda: self.post(lambda: None))
        self.pages: dict[int, Page] = {}
        self._remembered: dict[str, TabState] = {}
        self._faults = Faults(self._tell)
        session.tell = self._tell
        session.tasks.arrived = session.worker.reports.arrived = lambda: self.post(lambda: None)
        server.on_client_connect(self._connected)
        server.on_client_disconnect(self._disconnected)

    async def _connected(self, client: viser.ClientHandle) -> None:
        self.post(lambda: self._open(client))

    async def _disconnected(self, client: viser.ClientHandle) -> None:
        self.post(lambda: self._close(client.client_id))

    def post(self, command: Callable[[], None]) -> None:
        """Do something on the drawing thread, soon; from any thread."""
        self._commands.put(command)

    def _take(self, command: Callable[[], None]) -> None:
        """Something that a page asks for: a strange one asks for more than can be done."""
        if self._commands.qsize() < MOST_COMMANDS:
            self.post(command)

    def _open(self, client: viser.ClientHandle) -> None:
        files = PageFiles(here=is_here(self._server, client.client_id), root=self._files)
        self.pages[client.client_id] = Page(client, self.data, self._take, self._remembered, files)

    def _close(self, client: int) -> None:
        if (page := self.pages.pop(client, None)) is not None:
            page.close()

    def _tell(self, notice: Notice) -> None:
        for page in self.pages.values():
            page.tab.notify(notice)

    def run(self) -> None:
        """Draw until `stop` is called."""
        self.data.warm_up()  # while the browser loads the page
        while not self._stop.is_set():
            self._obey(TICK if self._moving() else REST)
            now = time.monotonic()
            self._faults.attempt("take the worker's news", self.session.take_news, now)
            for number, page in list(self.pages.items()):
                self._faults.attempt(f"draw tab {number}", partial(page.draw, now), now)

    def stop(self) -> None:
        """End `run`, from any thread."""
        self._stop.set()
        self.post(lambda: None)

    def close(self) -> None:
        """End all work. What was done is on the disk."""
        for page in self.pages.values():
            page.close()
        self.session.close()
        self.data.close()

    def _moving(self) -> bool:
        return any(page.tab.state.playing for page in self.pages.values())

    def _obey(self, patience: float) -> None:
        """Do what was asked for, waiting a while for the first."""
        try:
            command = self._commands.get(timeout=patience)
            while True:
                self._do(command)
                command = self._commands.get_nowait()
        except queue.Empty:
            return

    @staticmethod
    def _do(command: Callable[[], None]) -> None:
        """The loop outlives whatever goes wrong in a command; those of tabs tell it there themselves."""
        try:
            command()
        except Exception:
            _log.exception("The review app could not do what was asked")
