"""The projects that are open: each is reviewed by an app of its own, at a path of its own, behind the one server.

Reviews without a viewer are closed after a while, unless work goes on in them.
"""

import asyncio
import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import viser

from tcfit_app.server.gated_viser import visitor
from tcfit_app.server.serving import set_title
from tcfit_app.server.viser_bridge import run_javascript

if TYPE_CHECKING:
    from tcfit_app.fitting.bodies import Bodies
    from tcfit_app.project.project import Project
    from tcfit_app.review.app import ReviewApp

PATH = "/clip/"
"""Before the key of a clip in the address of its review."""
GRACE = 20.0
"""Seconds after which a review without a viewer is closed. A page that is reloaded is back by then."""
_log = logging.getLogger(__name__)


class Reviews:
    """Thread-safe.

    Args:
        folder_of: Returns the project folder of a key. Raises InputError if there is no such project.
        changed: Called with a key when its viewers have changed.
        files: As of `ReviewApp`.
        models: Folder of body models.
    """

    def __init__(
        self,
        folder_of: Callable[[str], Path],
        changed: Callable[[str], None],
        *,
        files: Path | None = None,
        models: Path | None = None,
    ) -> None:
        self._folder_of, self._changed, self._files, self._models = folder_of, changed, files, models
        self._server: viser.ViserServer | None = None
        self._open: dict[str, ReviewApp] = {}
        self._guard = threading.RLock()
        self._bodies: Bodies | None = None

    def serve(self, server: viser.ViserServer) -> None:
        """Serve the tabs of a server."""
        self._server = server
        server.on_client_connect(self._connected)
        server.on_client_disconnect(self._disconnected)

    def open(self, key: str) -> "ReviewApp":
        """The review of a clip, opened if it is not yet. Takes a moment, and the first one torch's two seconds. Raises
        InputError if there is no such project, or it cannot be opened."""
        with self._guard:
            review = self._open.get(key)
            if review is not None and review.project.read_only and not review.busy:
                self._close(key)  # it may be free by now
                review = None
            if review is None:
                review = self._open[key] = self._opened(self._folder_of(key))
            review.left = time.monotonic()
            return review

    def _opened(self, folder: Path) -> "ReviewApp":
        from tcfit_app.fitting.bodies import Bodies
        from tcfit_app.review.app import ReviewApp
        from tcfit_app.review.opening import open_project
        from tcfit_app.review.session.session import Session

        assert self._server is not None
        self._bodies = self._bodies or Bodies(self._models)
        project = open_project(folder)
        try:
            app = ReviewApp(Session(project, self._bodies), self._server, files=self._files, listen=False)
        except BaseException:
            project.close()
            raise
        app.start()
        return app

    def _entered(self, key: str, client: int, name: str) -> "ReviewApp":
        """As `open`, for a tab: nothing can close the review before it counts the tab."""
        with self._guard:
            review = self.open(key)
            review.viewers[client] = name
            return review

    @contextmanager
    def writing(self, key: str) -> "Iterator[Project | None]":
        """A project that is open for writing, and stays open within the `with` block; None if it is not."""
        with self._guard:
            review = self._open.get(key)
            yield None if review is None or review.project.read_only else review.project

    def viewers(self, key: str) -> str:
        """Who has a review open, for the user; empty if no one."""
        review = self._open.get(key)
        return "" if review is None else ", ".join(dict.fromkeys(review.viewers.values()))

    def release(self, key: str, *, grace: float = 0.0) -> bool:
        """Close a review that is not busy, and has not been for `grace` seconds. Returns whether it is closed."""
        with self._guard:
            review = self._open.get(key)
            if review is not None and not review.busy and time.monotonic() - review.left >= grace:
                self._close(key)
            return key not in self._open

    def tidy(self) -> None:
        """Close what has not been looked at for a while."""
        for key in list(self._open):
            self.release(key, grace=GRACE)

    def close(self) -> None:
        """Close all. Everything is on the disk."""
        with self._guard:
            for key in list(self._open):
                self._close(key)

    def _close(self, key: str) -> None:
        review = self._open.pop(key)
        try:
            review.close()
        finally:
            review.project.close()
        self._changed(key)

    # --- tabs, in viser's event loop ---

    async def _connected(self, client: viser.ClientHandle) -> None:
        assert self._server is not None
        whose = visitor(self._server, client.client_id)
        key = whose.path.removeprefix(PATH)
        try:
            review = await asyncio.to_thread(self._entered, key, client.client_id, whose.reviewer)
        except Exception as error:  # any error: the list reports it
            if not isinstance(error, ValueError):
                _log.exception("A review could not be opened")
            run_javascript(client, f"location.replace('/#{key}');")
            return
        if client.client_id not in self._server.get_clients():
            review.left = time.monotonic()
            review.viewers.pop(client.client_id, None)
            return
        set_title(client, review.project.footage.name)
        await review.connected(client)
        await asyncio.to_thread(self._tell, key, review)

    async def _disconnected(self, client: viser.ClientHandle) -> None:
        for key, review in list(self._open.items()):
            if client.client_id in review.viewers:
                review.left = time.monotonic()
                review.viewers.pop(client.client_id, None)
                await review.disconnected(client)
                await asyncio.to_thread(self._tell, key, review)

    def _tell(self, key: str, review: "ReviewApp") -> None:
        """Report the viewers to other processes and lists."""
        with suppress(OSError):
            review.project.tell_who_works(self.viewers(key))
        self._changed(key)
