"""The list of a folder's clips as a site: its page, its websockets, and the reviews that are opened from it."""

import asyncio
import base64
import logging
import threading
import time
from collections.abc import Callable, Collection, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from fitting_core.errors import InputError
from fitting_core.files.regular import legible
from tcfit_app.home.catalogue import Catalogue, Entry
from tcfit_app.home.messages import (
    Approve,
    AskFormats,
    Cancel,
    Export,
    Fit,
    FromPage,
    Look,
    Open,
    Opened,
    Picture,
    Refusal,
    Row,
    Rows,
    ToPage,
    WriteNote,
    decode,
    encode,
    unforeseen,
)
from tcfit_app.home.pictures import picture_of
from tcfit_app.home.queue import Job, JobQueue, export_job, fit_job
from tcfit_app.home.reviews import PATH, Reviews
from tcfit_app.project.storage.clip_review import ReviewOfClip, reviewed
from tcfit_app.server.gate import HOME
from tcfit_app.server.gated_viser import Visitor
from tcfit_app.server.screen import Dropped
from tcfit_app.server.serving import ReviewServer

SOCKET = "/list"
"""Where the page's websocket is."""
EVERY = 3.0
"""Seconds between two scans of the disk while a browser shows the list."""
_SHARE = 0.05
"""Fraction of the time spent on scans: a slow one is followed by a longer rest."""
_GONE = "This clip is no longer there: it was moved or deleted."
_log = logging.getLogger(__name__)


@dataclass(kw_only=True, eq=False)
class _Watcher:
    connection: ServerConnection
    loop: asyncio.AbstractEventLoop
    visitor: Visitor
    wanted: tuple[str, ...] = ()
    """Visible clips whose pictures have not been sent yet."""
    dropped: Dropped = field(default_factory=Dropped)

    def send(self, message: ToPage) -> None:
        """Send from any thread; a closed page is ignored."""
        text = encode(message)

        async def send() -> None:
            with suppress(ConnectionClosed):
                await self.connection.send(text)

        asyncio.run_coroutine_threadsafe(send(), self.loop)


class Home:
    """A site of a folder's clips. See `TalkingSite`.

    Args:
        root: The folder.
        files: Folder whose files pages may name; None: see `PageFiles`.
        models: Folder of body models.
    """

    def __init__(self, root: Path, *, files: Path | None = None, models: Path | None = None) -> None:
        self._models = models
        self._queue = JobQueue(self._place_of, self._refresh)
        self.catalogue = Catalogue(root, self._queue.on)
        self.reviews = Reviews(self._folder_of, lambda key: self._refresh([key]), files=files, models=models)
        self._watchers: set[_Watcher] = set()
        self._pool = ThreadPoolExecutor(4, "tcfit list")
        self._drawing = ThreadPoolExecutor(1, "tcfit pictures")
        """One at a time: decoding takes a core."""
        self._making = threading.Lock()
        """Held while a project is made."""
        self._made: dict[str, Path] = {}
        """Projects made here, by the keys of what they were made from."""
        self._wake = threading.Event()
        self._stop = False

    # --- the site ---

    def page(self, path: str) -> bytes | None:
        """See `Site.page`."""
        if path == HOME:
            return _PAGE.format(title=escape(legible(self.catalogue.root.name))).encode()
        return None

    def has_review(self, path: str) -> bool:
        """See `Site.has_review`."""
        return path.startswith(PATH) and self.catalogue.get(path.removeprefix(PATH)) is not None

    def talks_at(self, path: str) -> bool:
        """See `Site.talks_at`."""
        return path == SOCKET

    async def talk(self, connection: ServerConnection, visitor: Visitor) -> None:
        """See `TalkingSite.talk`."""
        watcher = _Watcher(connection=connection, loop=asyncio.get_running_loop(), visitor=visitor)
        self._watchers.add(watcher)
        self._wake.set()
        try:
            watcher.send(Rows(rows=self.catalogue.rows(), whole=True))
            with suppress(ConnectionClosed):
                async for message in connection:
                    await self._take(watcher, message)
        finally:
            self._watchers.discard(watcher)

    async def _take(self, watcher: _Watcher, message: str | bytes) -> None:
        try:
            asked = decode(message)
        except msgspec.DecodeError as error:
            watcher.dropped.note(error)
            return
        # One after the other: a page that asks for more waits.
        await watcher.loop.run_in_executor(self._pool, self._obey, watcher, asked)

    # --- what pages ask for ---

    def _obey(self, watcher: _Watcher, asked: FromPage) -> None:
        try:
            _RECEIVERS[type(asked)](self, watcher, asked)
        except InputError as error:
            watcher.send(Refusal(text=str(error)))
        except Exception as error:
            _log.exception("What a page asked for went wrong")
            watcher.send(Refusal(text=unforeseen(error)))

    def _look(self, watcher: _Watcher, asked: Look) -> None:
        idle, watcher.wanted = not watcher.wanted, asked.keys
        if idle and asked.keys:
            self._drawing.submit(self._draw, watcher)

    def _draw(self, watcher: _Watcher) -> None:
        """Send the pictures that are visible now; those scrolled past are dropped."""
        while watcher.wanted and watcher in self._watchers and not self._stop:
            key, *rest = watcher.wanted
            watcher.wanted = tuple(rest)
            if (entry := self.catalogue.get(key)) is not None:
                try:
                    data = picture_of(entry, self.catalogue)
                except Exception:  # the other clips have pictures all the same
                    _log.exception("%s: has no picture", entry.found.path)
                    data = b""
                watcher.send(Picture(key=key, data=base64.b64encode(data).decode()))
                if entry.found.is_footage:
                    self._refresh([key])

    def _open(self, watcher: _Watcher, asked: Open) -> None:
        key = self._as_project(self._entry(asked.key)).found.key
        self.reviews.open(key)
        watcher.send(Opened(key=key))

    def _as_project(self, entry: Entry) -> Entry:
        """A clip's project, made beside it if it is missing."""
        if entry.found.kind == "project":
            return entry
        from tcfit_app.home.fitting import make_project

        with self._making:
            if self.catalogue.get(entry.found.key) is not None:  # else another page has just made it
                self._made[entry.found.key] = make_project(entry.found)
                self.look()
        made = self._made.get(entry.found.key)
        entries = (self.catalogue.get(row.key) for row in self.catalogue.rows())
        found = next((one for one in entries if one is not None and one.found.path == made), None)
        if found is None:
            raise InputError(_GONE)
        return found

    def _fit(self, watcher: _Watcher, asked: Fit) -> None:
        self._begin(watcher, list(map(self._entry, asked.keys)), fit_job(self._models))

    def _begin(self, watcher: _Watcher, entries: Iterable[Entry], job: Job) -> None:
        refused: list[str] = []
        for entry in entries:
            try:
                self._queue.add([self._as_project(entry).found.key], job)
            except InputError as error:  # the others are done all the same
                refused.append(str(error))
        if refused:
            watcher.send(Refusal(text="\n".join(refused)))

    def _ask_formats(self, watcher: _Watcher, asked: AskFormats) -> None:
        from tcfit_app.home.exporting import offered

        watcher.send(offered())

    def _export(self, watcher: _Watcher, asked: Export) -> None:
        entries = list(map(self._entry, asked.keys))
        if without := [entry.row.name for entry in entries if entry.found.is_footage]:
            raise InputError(f"{without[0]}: has no fit yet that could be exported. Fit it first.")
        self._begin(watcher, entries, export_job(asked, self._models))

    def _cancel(self, watcher: _Watcher, asked: Cancel) -> None:
        self._queue.cancel(asked.keys)

    def _approve(self, watcher: _Watcher, asked: Approve) -> None:
        entries = list(map(self._entry, asked.keys))
        if asked.approved and (without := [e.row.name for e in entries if e.row.state == "new"]):
            raise InputError(f"{without[0]}: has no fit yet that could be approved.")
        me = watcher.visitor.reviewer
        for key in asked.keys:
            self._say(key, lambda review: review.approve(me) if asked.approved else review.withdraw())

    def _write_note(self, watcher: _Watcher, asked: WriteNote) -> None:
        self._say(asked.key, lambda review: review.set_note(asked.text))

    def _say(self, key: str, say: Callable[[ReviewOfClip], None]) -> None:
        """Store a reviewer's statement about a clip; it is on the disk when this returns."""
        entry = self._entry(key)
        if entry.found.kind != "project":
            raise InputError(f"{entry.row.name}: is no project yet. Open or fit it first.")
        with self.reviews.writing(key) as project:
            if project is not None:
                say(project.review)
            else:
                with reviewed(entry.found.path) as review:
                    say(review)
        self._refresh([key])

    # --- clips ---

    def _entry(self, key: str) -> Entry:
        entry = self.catalogue.get(key)
        if entry is None:
            raise InputError(_GONE)
        return entry

    def _folder_of(self, key: str) -> Path:
        entry = self._entry(key)
        if entry.found.kind != "project":
            raise InputError(f"{entry.row.name}: is no project. Open it from the list.")
        return entry.found.path

    def _place_of(self, key: str, job: Job) -> Path:
        folder = self._folder_of(key)
        if job.writes and not self.reviews.release(key):
            raise InputError(f"{self.reviews.viewers(key) or 'Another user'} has it open: fit it there.")
        return folder

    # --- news ---

    def look(self) -> None:
        """Scan the disk, and send all pages the changes."""
        self._tell(*self.catalogue.refresh())

    def _refresh(self, keys: Collection[str]) -> None:
        self._tell(self.catalogue.refresh_some(keys), [])

    def _tell(self, changed: list[Row], gone: Iterable[str]) -> None:
        gone = list(gone)
        if changed or gone:
            for watcher in list(self._watchers):
                watcher.send(Rows(rows=changed, gone=gone))

    # --- life ---

    def run(self, server: ReviewServer, then: Callable[[], None] = lambda: None) -> None:
        """Serve until Ctrl-C; `then` runs in its own thread once the list is ready."""
        self.reviews.serve(server.viser)
        self.look()
        threading.Thread(target=then, daemon=True).start()
        rest = 0.0
        while not self._stop:
            self._wake.wait(max(EVERY, rest) if self._watchers else EVERY)
            self._wake.clear()
            begun = time.monotonic()
            try:
                self.reviews.tidy()
                if self._watchers:
                    self.look()
            except Exception:  # the reviews that are open go on
                _log.exception("The list could not be refreshed")
            if self._watchers:
                rest = (time.monotonic() - begun) / _SHARE

    def stop(self) -> None:
        """End `run`, from any thread."""
        self._stop = True
        self._wake.set()

    def close(self) -> None:
        """End all work. Finished work is on the disk."""
        self._stop = True
        self._queue.close()
        self.reviews.close()
        self._pool.shutdown(cancel_futures=True)
        self._drawing.shutdown(cancel_futures=True)


_RECEIVERS: dict[type, Callable[[Home, _Watcher, Any], None]] = {
    Look: Home._look,
    Open: Home._open,
    Fit: Home._fit,
    AskFormats: Home._ask_formats,
    Export: Home._export,
    Cancel: Home._cancel,
    Approve: Home._approve,
    WriteNote: Home._write_note,
}
_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>tcfit: {title}</title><meta name="color-scheme" content="dark light">
<style>@media (prefers-color-scheme: dark) {{ html {{ background: #14171c; }} }}</style>
<script type="module" src="/tcfit/home/list.js"></script></head>
<body><h1 id="title">{title}</h1><noscript>The list needs JavaScript.</noscript></body></html>
"""
