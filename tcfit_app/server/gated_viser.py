"""viser's server behind the gate: no request reaches it that the gate has not let through.

The one call with which viser starts its network server is answered here (`viser_bridge.network_server`).
"""

import asyncio
import errno
import getpass
import logging
import socket
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import Any, Protocol
from weakref import WeakKeyDictionary

import rich
import viser
import websockets.asyncio.server
from websockets.asyncio.server import Server, ServerConnection
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidMessage
from websockets.frames import CloseCode
from websockets.http11 import Request, Response
from websockets.protocol import State

from tcfit_app.server import viser_bridge
from tcfit_app.server.gate import HOME, Gate, Site, busy, protect
from tcfit_app.server.page_files import on_this_computer
from tcfit_app.server.page_messages import MESSAGE_BYTES
from tcfit_app.server.screen import Screen
from tcfit_app.server.uploads import UploadRoom

REQUEST_SECONDS = 30.0
"""Time limit of a request, from the connection to the answer's last byte: the page (0.7 MB) at 22 KB/s."""
GOODBYE_SECONDS = 1.0
"""Time for browsers to disconnect when the server stops."""
WAITING = 40
"""Maximum number of connections without an answer; a browser has six at a time."""
BACKLOG = 64
"""Length of the queue of new connections. With fewer, a page in a crowd must retry a second later."""
PAGES = 32
"""Maximum number of open websockets, one for each tab."""
_TOLD_AGAIN = 60.0
"""Seconds between two warnings that no connection can be taken."""


@dataclass(frozen=True, kw_only=True)
class Visitor:
    """The user of a browser."""

    here: bool = False
    """The browser runs on this computer."""
    name: str = ""
    """The sign-in name; may be empty."""
    path: str = HOME
    """Of the page."""

    @property
    def reviewer(self) -> str:
        """The name for work and approvals: on this computer that of the user, without a sign-in."""
        return self.name or (_user() if self.here else _UNNAMED)


_UNNAMED = "a guest"


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user that has no name
        return _UNNAMED


class TalkingSite(Site, Protocol):
    """A site whose pages have websockets."""

    async def talk(self, connection: ServerConnection, visitor: Visitor) -> None:
        """Serve such a websocket until it ends, in viser's event loop. Messages come from an admitted browser, and may
        be anything."""
        ...


_visitor: ContextVar[Visitor] = ContextVar("whose connection this is, in its own context")
_screen: ContextVar[Screen] = ContextVar("a connection as viser sees it, in its own context")
_visitors: WeakKeyDictionary[viser.ViserServer, dict[int, Visitor]] = WeakKeyDictionary()

# Below INFO, websockets logs whole requests, with tokens and cookies.
_log = logging.getLogger("tcfit_app.requests")
_log.setLevel(logging.INFO)


def _is_no_noise(record: logging.LogRecord) -> bool:
    """Drop the tracebacks of malformed requests, which they quote, and of browsers that left before the answer, as in a
    reload."""
    return not (record.exc_info and isinstance(record.exc_info[1], InvalidMessage | ConnectionClosed))


_log.addFilter(_is_no_noise)


@contextmanager
def gated_viser(listening: socket.socket, gate: Gate, site: TalkingSite | None = None) -> Iterator[viser.ViserServer]:
    """A viser server on that socket (which it closes) behind that gate, without the share tunnel; stops at the end.
    Raises InputError if the viser that is installed is not one that tcfit knows."""
    viser_bridge.check()
    viser_bridge.keep_icons_open()
    viser_bridge.let_tabs_leave()
    started: list[websockets.asyncio.server.Server] = []

    def serve(handler: Any, host: str, port: int, **options: Any) -> websockets.asyncio.server.serve:
        """In place of websockets' own; host and port are the socket's."""
        options |= {"process_request": _checked(gate, options["process_request"]), "logger": _log}
        options |= {"open_timeout": REQUEST_SECONDS, "close_timeout": REQUEST_SECONDS, "server_header": None}
        options |= {"max_size": MESSAGE_BYTES, "create_connection": Connection, "backlog": BACKLOG}
        serving = websockets.asyncio.server.serve(_screened(gate, handler, site), sock=listening, **options)
        started.append(serving.server)
        serving.server.loop.set_exception_handler(LoopErrors(serving.server))
        return serving

    host, port = listening.getsockname()[:2]
    with viser_bridge.network_server(serve), _quiet():  # viser prints an address that would be refused
        server = viser.ViserServer(host=host, port=port, verbose=False)
    try:
        if not started:
            raise RuntimeError(f"viser {viser.__version__} starts its server in a way that tcfit does not know")
        viser_bridge.check_gui(server)
        _know_clients(server)
        yield server
    finally:
        with suppress(RuntimeError):  # viser was stopped before: its loop is closed
            for network in started:
                server.get_event_loop().call_soon_threadsafe(_hang_up, network)
        with _quiet():
            server.stop()


def visitor(server: viser.ViserServer, client: int) -> Visitor:
    """The user of a client of a gated server, by the client's number."""
    return _visitors.get(server, {}).get(client, Visitor())


def _screened(
    gate: Gate, handler: Callable[[Any], Awaitable[None]], site: TalkingSite | None
) -> Callable[[ServerConnection], Awaitable[None]]:
    """viser's handler of a websocket, which gets to see a Screen instead, and not those of the site's own pages."""
    room = UploadRoom()

    async def screened(connection: ServerConnection) -> None:
        whose = _whose(gate, connection)
        if site is not None and site.talks_at(whose.path):
            await site.talk(connection, whose)
            return
        found, known = connection.subprotocol, f"viser-v{viser.__version__}"
        if found != known:  # viser would say so in the terminal, each time
            await connection.close(CloseCode.PROTOCOL_ERROR, f"This page is of {found}, and the server of {known}")
            return
        screen = Screen(connection, room)
        _screen.set(screen)
        _visitor.set(whose)
        try:
            await handler(screen)
        finally:
            screen.end()

    return screened


def is_here(gate: Gate, address: str, headers: Headers) -> bool:
    """Whether a request certainly comes from a browser on this computer."""
    return not gate.entry.for_others and on_this_computer(address, headers)


def _whose(gate: Gate, connection: ServerConnection) -> Visitor:
    request, other_end = connection.request, connection.remote_address
    assert request is not None
    here = bool(other_end) and is_here(gate, other_end[0], request.headers)
    return Visitor(here=here, name=gate.name_of(request.headers) or "", path=request.path)


def _know_clients(server: viser.ViserServer) -> None:
    """Register each screen's client and its visitor. No link exists yet, so none is missed."""
    known = _visitors.setdefault(server, {})

    def connected(client: int) -> None:
        screen = _screen.get()
        screen.client = lambda: server.get_clients().get(client)
        known[client] = _visitor.get()

    def gone(client: int) -> None:
        known.pop(client, None)

    viser_bridge.watch_connections(server, connected, gone)


def _checked(gate: Gate, answer: Callable[[Any, Request], Response | None]) -> Callable[..., Response | None]:
    """viser's answers to requests, where the gate has none."""

    def checked(connection: Any, request: Request) -> Response | None:
        response = gate.answer(request, str((connection.remote_address or [""])[0]))
        if response is None and "Upgrade" in request.headers and len(connection.server.connections) >= PAGES:
            response = busy()
        if response is None:
            # viser has one page, wherever it is offered.
            page = request if "Upgrade" in request.headers else replace(request, path=HOME)
            response = answer(connection, page)
            if response is not None:
                response.body = viser_bridge.curtained(response.headers, bytes(response.body))
        if response is not None:
            protect(response.headers)
        return response

    return checked


def _hang_up(server: websockets.asyncio.server.Server) -> None:
    """End connections that would delay the stop: browsers keep idle ones open, and a sleeping tab does not answer.

    viser's stop waited 6 s for each such connection, and left its thread behind.
    """
    hang_up(server, keep=0)
    server.get_loop().call_later(GOODBYE_SECONDS, lambda: [c.transport.abort() for c in list(server.handlers)])


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress viser's messages about its start and end."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


# --- connections: as many as leave the process able to open files, and one request from each ---


def hang_up(server: Server, *, keep: int) -> None:
    """Close connections without an answer until `keep` are left: idle ones first, then the oldest."""
    waiting = [connection for connection in server.handlers if connection.protocol.state is State.CONNECTING]
    waiting.sort(key=lambda connection: connection.request is not None)
    for connection in waiting[: max(len(waiting) - keep, 0)]:
        connection.transport.abort()


_END = b"\r\n\r\n"


class Connection(ServerConnection):
    """A connection that closes old ones if there are too many, and reads nothing between a request and its answer.

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
