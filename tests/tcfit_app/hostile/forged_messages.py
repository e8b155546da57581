"""A hostile client: messages of viser's whole protocol, and what is none, to a review that runs in another process.

`python -m tests.tcfit_app.hostile.forged_messages ADDRESS COOKIE SEED COUNT`
"""

import dataclasses
import random
import socket
import sys
import typing
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

import msgspec
from viser import _messages
from websockets.exceptions import ConnectionClosed, InvalidHandshake

from tests.drivers.raw_tab import RawTab, camera, raw_tab

FORGED = "FORGED"
"""In every text that is made up: nothing of it may get to another tab."""
KINDS = sorted(
    (kind for kind in _messages.Message.get_subclasses() if dataclasses.is_dataclass(kind)), key=lambda k: k.__name__
)
"""All messages of viser's protocol, in both directions."""
_PARTS = 512 << 10


class Forger:
    """Makes up messages for a tab."""

    def __init__(self, tab: RawTab, rng: random.Random) -> None:
        self._tab, self._rng = tab, rng
        self._number = 1_000_000

    def __call__(self) -> bytes | str:
        """The next one."""
        ways: dict[Callable[[], bytes | str], int] = {
            self._of_any_kind: 8,
            self._value: 8,
            self._upload: 4,
            self._event: 4,
            self._camera: 2,
            self._torn: 4,
        }
        return self._rng.choices([*ways], [*ways.values()])[0]()

    # --- the ways ---

    def _of_any_kind(self) -> bytes:
        kind = self._rng.choice(KINDS)
        hints = typing.get_type_hints(kind)
        message = {field.name: self._like(hints[field.name]) for field in dataclasses.fields(kind)}
        return self._packed({"type": kind.__name__, **self._mutated(message)})

    def _value(self) -> bytes:
        updates = self._mutated({"value": self._junk()}) if self._rng.random() < 0.2 else {"value": self._junk()}
        return self._packed({"type": "GuiUpdateMessage", "uuid": self._uuid(), "updates": updates})

    def _upload(self) -> bytes:
        rng = self._rng
        about = {"source_component_uuid": self._uuid(), "transfer_uuid": f"{FORGED} {rng.randrange(8)}"}
        if rng.random() < 0.5:
            size = rng.choice([0, 10, 4 * _PARTS, 255 << 20, 1 << 40, -5])
            count = rng.choice([size // _PARTS, 4, 0, size, -1])
            start = {"filename": FORGED, "mime_type": FORGED, "part_count": count, "size_bytes": size}
            return self._packed({"type": "FileTransferStartUpload", **about, **start})
        content = bytes(rng.choice([0, 3, _PARTS]))
        part = {"part_index": rng.choice([0, 1, 2, 3, -1, 1 << 40]), "content": content}
        return self._packed({"type": "FileTransferPart", **about, **part})

    def _event(self) -> bytes:
        rng = self._rng
        self._number += rng.choice([1, 1, 1, 0, -5])
        event = rng.choice(
            [
                {"type": "hello", "tab": f"{FORGED} {rng.random()}", "width": rng.randrange(70_000), "height": 1},
                {"type": "resized", "width": rng.randrange(70_000), "height": rng.randrange(3)},
                {"type": "key", "action": FORGED, "repeat": True},
                {"type": "press", "command": FORGED, "value": self._junk()},
                {"type": "seek", "frame": rng.choice([0, 5, 1 << 40, -1])},
                {"type": "range", "first": rng.choice([0, 1 << 62, None]), "last": rng.choice([3, 1 << 62])},
                {"type": "plot", "name": FORGED, "shown": True},
                {"type": "select", "joints": rng.choices(range(200), k=4), "how": "toggle"},
                {"type": "drag", "phase": "move", "joints": [1], "dx": 1e6, "dy": self._junk(), "frame": 1 << 40},
                {"type": "go_to_person", "person": rng.choice([0, 1, 999, 1 << 40, -1])},
                {
                    "type": "open_link",
                    "frame": rng.choice([0, 5, 1 << 40, -1]),
                    "run": rng.choice([None, 1, 1 << 40, -1]),
                    "person": rng.choice([None, 0, 1, 999, 1 << 40, -1, FORGED]),
                },
                {"type": "stranger", "viser": FORGED, "missing": [FORGED]},
                {"type": "too_large", "name": "x", "size": 1 << 50},
                {"type": FORGED},
            ]
        )
        try:
            text = msgspec.json.encode({"number": self._number, "event": self._mutated(event)}).decode()
        except ValueError:  # junk that JSON has no form for
            text = "[" * rng.randrange(20_000)
        return self._packed({"type": "GuiUpdateMessage", "uuid": self._tab.field, "updates": {"value": text}})

    def _camera(self) -> bytes:
        name = self._rng.choice([*camera()])
        return self._packed(camera(**{name: self._rng.choice([self._junk(), (0.0, 0.0, 0.0), 1e9, 0.0])}))

    def _torn(self) -> bytes | str:
        rng = self._rng
        whole = self._of_any_kind()
        return rng.choice(
            [
                FORGED,
                b"",
                whole[: rng.randrange(len(whole))],
                whole + b"\xc1",
                rng.randbytes(rng.randrange(1, 2000)),
                b"\x91" * rng.randrange(1, 300_000),
                b"\x81\xa1a" * rng.randrange(1, 100_000),
                b"\x82\xa4type\xb0GuiUpdateMessage\xa4type\xafShareUrlRequest",
                b"\xdd\xff\xff\xff\xff",
                b"\xc6\xff\xff\xff\xff",
            ]
        )

    # --- their fields ---

    def _mutated(self, fields: dict[str, Any]) -> dict[str, Any]:
        rng, found = self._rng, dict(fields)
        for _ in range(rng.choice([0, 0, 1, 1, 2])):
            name = rng.choice([*found, FORGED])
            if rng.random() < 0.15:
                found.pop(name, None)
            else:
                found[name] = self._junk()
        return found

    def _like(self, hint: Any) -> Any:
        """A value of a field's type, roughly."""
        rng = self._rng
        if hint is str:
            return rng.choice([self._uuid(), FORGED])
        if hint in (int, float, bool):
            return hint(rng.choice([0, 1, 7]))
        if typing.get_origin(hint) is tuple:
            return [self._like(part) for part in typing.get_args(hint) if part is not Ellipsis]
        if typing.get_origin(hint) is typing.Literal:
            return rng.choice(typing.get_args(hint))
        return self._junk()

    def _uuid(self) -> str:
        return self._rng.choice([*self._tab.widgets, FORGED, "root", str(self._tab.field)])

    def _junk(self) -> Any:
        rng = self._rng
        deep: Any = FORGED
        for _ in range(rng.randrange(400)):
            deep = [deep]
        return rng.choice(
            [
                *(None, True, False, 0, -1, 7, 2**64 - 1, -(2**63), 0.5, 1e308, -1e308, float("nan"), float("inf")),
                *("", FORGED, f"{FORGED}\x1b[31m\0", FORGED * 20_000, "3", "body"),
                *(FORGED.encode(), bytes(300_000), [], {}, [1.0, 2.0], [1e308, float("nan")], deep),
                {"value": FORGED},
                {FORGED: [FORGED] * 50},
                [FORGED] * 10_000,
            ]
        )

    @staticmethod
    def _packed(message: object) -> bytes:
        return msgspec.msgpack.encode(message)


def outside(address: str, rng: random.Random, count: int) -> None:
    """Requests of somebody who was not let in."""
    host, port = address.removeprefix("http://").split(":")
    request = f"GET / HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()
    upgrade = request[:-2] + f"Origin: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n".encode()
    for _ in range(count):
        junk = rng.randbytes(rng.randrange(1, 500))
        sent = rng.choice([junk, request + request, upgrade + junk, request * 50, upgrade + upgrade, request[:-9], b""])
        with suppress(OSError), socket.create_connection((host, int(port)), timeout=5) as client:
            client.sendall(sent)
            if rng.random() < 0.7:
                client.settimeout(0.05)
                client.recv(1000)


def attack(address: str, cookie: str, seed: int, count: int) -> None:
    """Send so many messages, over as many connections as that takes."""
    rng = random.Random(seed)
    outside(address, rng, count // 20 + 5)
    left = count
    while left > 0:
        with suppress(ConnectionClosed, InvalidHandshake, OSError), ExitStack() as opened:
            tab = opened.enter_context(raw_tab(address, cookie))
            if rng.random() < 0.9:
                tab.open(f"{FORGED} {rng.random()}")
            forge = Forger(tab, rng)
            for _ in range(min(left, rng.randrange(50, 500))):
                left -= 1
                tab.connection.send(forge())
            if rng.random() < 0.3:
                tab.connection.send(bytes(2 << 20))  # which ends it


if __name__ == "__main__":
    attack(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
