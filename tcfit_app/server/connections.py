"""Limits connections, so that the process can still open files, and takes one request from each."""

import asyncio
import errno
import logging
import time
from typing import Any

from websockets.asyncio.server import Server, ServerConnection
from websockets.protocol import State

WAITING = 40
"""Connections that may wait for a request or its answer; a browser has six at a time."""
BACKLOG = 64
"""New connections that may be waiting to be taken, and are taken at once. Fewer, and a page that comes with a crowd has
to knock again, a second later."""
PAGES = 32
"""Websockets that may be open, one for each tab."""
_TOLD_AGAIN = 60.0
"""Seconds between two warnings that no connection can be taken."""
_log = logging.getLogger(__name__)


def hang_up(server: Server, *, keep: int) -> None:
    """Close connections that wait, until `keep` are left: idle ones first, and of the others the old ones."""
    waiting = [connection for connection in server.handlers if connection.protocol.state is State.CONNECTING]
    waiting.sort(key=lambda connection: connection.request is not None)
    for connection in waiting[: max(len(waiting) - keep, 0)]:
        connection.transport.abort()


_END = b"\r\n\r\n"


class Connection(ServerConnection):
    """A connection that makes room for itself, and reads nothing between a request and its answer.

    Browsers send nothing there. websockets would take it for part of a websocket that does not exist yet, and stumble.
    """

    def __init__(self, protocol: Any, server: Server, **options: Any) -> None:
        hang_up(server, keep=WAITING - 1)
        super().__init__(protocol, server, **options)
        self._before = b""
        """The request's last bytes, for its end may come in two parts."""

    def data_received(self, data: bytes) -> None:
        """As asyncio calls it."""
        if self.protocol.state is State.CONNECTING:
            if self.request is not None:
                return
            begun = self._before + data
            end = begun.find(_END)
            if end >= 0:
                data = begun[len(self._before) : end + len(_END)]
            self._before = begun[1 - len(_END) :]
        super().data_received(data)


class LoopErrors:
    """Handles errors in asyncio's own callbacks, in place of a traceback for each."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._told = -_TOLD_AGAIN

    def __call__(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """As asyncio calls it."""
        error = context.get("exception")
        if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
            self._out_of_files()
        else:
            loop.default_exception_handler(context)

    def _out_of_files(self) -> None:
        hang_up(self._server, keep=WAITING // 8)
        now = time.monotonic()
        if now - self._told >= _TOLD_AGAIN:
            self._told = now
            _log.warning("No connection can be taken: this process may open no more files (ulimit -n)")
