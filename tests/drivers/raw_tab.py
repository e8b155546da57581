"""A tab without a browser: requests, and a websocket that speaks viser's protocol, to a review that runs anywhere."""

import http.client
import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.drivers import waiting

PATIENCE = 30.0
"""Seconds after which a test gives up."""
_CONNECT = re.compile(r'tcfit\.connect\("([^"]+)"')
_CURSOR = re.compile(r'tcfit\.receive\("cursor", \{"frame":(\d+)')


@dataclass(frozen=True)
class Answer:
    """Of a server, to a request."""

    status: int
    headers: dict[str, str]
    body: str


def fetched(address: str, **headers: str) -> Answer:
    """GET without redirects; underscores in names of headers become dashes."""
    host, _, path = address.removeprefix("http://").partition("/")
    client = http.client.HTTPConnection(host, timeout=2 * PATIENCE)
    client.request("GET", f"/{path}", headers={name.replace("_", "-"): value for name, value in headers.items()})
    response = client.getresponse()
    body = response.read().decode(errors="replace")
    client.close()
    return Answer(response.status, dict(response.getheaders()), body)


def admitted(link: str) -> str:
    """Comes in through a link; the cookie."""
    answer = fetched(link)
    assert answer.status == 200, answer.status
    return answer.headers["Set-Cookie"].partition(";")[0]


def received(client: socket.socket) -> bytes:
    """All that comes until the other end hangs up."""
    found = b""
    with suppress(ConnectionResetError):
        while part := client.recv(65536):
            found += part
    return found


def websocket(address: str, cookie: str, *, version: str = viser.__version__, path: str = "") -> ClientConnection:
    """As the page of a version of viser opens it. `address` as "http://127.0.0.1:8080"."""
    return connect(
        address.replace("http", "ws", 1) + path,
        origin=address,  # pyright: ignore[reportArgumentType]
        additional_headers={"Cookie": cookie},
        subprotocols=[f"viser-v{version}"],  # pyright: ignore[reportArgumentType]
        max_size=None,
        proxy=None,
        close_timeout=1,
    )


def decoded(sent: bytes) -> list[dict[str, Any]]:
    """The messages in what viser's server sends; arrays are left out."""
    size, packed = (int.from_bytes(sent[i : i + 8], "little") for i in (0, 8))
    plain = zstandard.ZstdDecompressor().decompress(sent[16 : 16 + packed], max_output_size=size)
    return msgspec.msgpack.decode(plain)["messages"]


def camera(**changes: object) -> dict[str, Any]:
    """viser's message about the viewer's camera."""
    return {
        "type": "ViewerCameraMessage",
        "wxyz": (1.0, 0.0, 0.0, 0.0),
        "position": (0.0, 0.0, -500.0),
        "fov": 0.004,
        "near": 1.0,
        "far": 4000.0,
        "image_height": 640,
        "image_width": 960,
        "look_at": (0.0, 0.0, 0.0),
        "up_direction": (0.0, -1.0, 0.0),
        **changes,
    }


class RawTab:
    """One that has connected; it reads all the time."""

    until = staticmethod(waiting.until)

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.field: str | None = None
        """Of tcfit's events."""
        self.messages: list[dict[str, Any]] = []
        """What the server has sent."""
        self.widgets: dict[str, str] = {}
        """Types of messages that made inputs, by the inputs' ids."""
        self.frame: int | None = None
        """The one that the server has it show."""
        self._number = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.send(camera())

    def _read(self) -> None:
        try:
            while True:
                sent = self.connection.recv()
                assert isinstance(sent, bytes)
                for message in decoded(sent):
                    self._note(message)
        except (ConnectionClosed, EOFError):
            return

    @property
    def closed(self) -> bool:
        """Whether the server has hung up."""
        return not self._reader.is_alive()

    def _note(self, message: dict[str, Any]) -> None:
        self.messages.append(message)
        if "container_uuid" in message and "uuid" in message:
            self.widgets[message["uuid"]] = message["type"]
        source = message.get("source", "") if message["type"] == "RunJavascriptMessage" else ""
        if found := _CONNECT.search(source):
            self.field = found[1]
        if found := _CURSOR.search(source):
            self.frame = int(found[1])

    def send(self, message: object) -> None:
        """As viser's page does."""
        self.connection.send(msgspec.msgpack.encode(message))

    def set(self, uuid: str, value: object) -> None:
        """Set an input."""
        self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def emit(self, event: dict[str, object]) -> None:
        """As tcfit's script does."""
        self._number += 1
        assert self.field is not None
        self.set(self.field, msgspec.json.encode({"number": self._number, "event": event}).decode())

    def open(self, name: str = "raw") -> None:
        """Until the page is there."""
        self.until(lambda: self.field is not None)
        self.emit({"type": "hello", "tab": name, "width": 960, "height": 640})
        self.until(lambda: len(self.widgets) > 20)

    def seek(self, frame: int) -> float:
        """Go to a frame; seconds until the server has shown it."""
        begin = time.monotonic()
        self.emit({"type": "seek", "frame": frame})
        self.until(lambda: self.frame == frame)
        self.emit({"type": "drawn", "frame": frame})
        return time.monotonic() - begin

    def rest(self) -> None:
        """Until nothing has come for a second."""
        known = -1
        while known != (known := len(self.messages)):
            time.sleep(1.0)


@contextmanager
def raw_tab(address: str, cookie: str, *, path: str = "") -> Iterator[RawTab]:
    """Open one, and close it in the end."""
    connection = websocket(address, cookie, path=path)
    with connection:
        yield RawTab(connection)
