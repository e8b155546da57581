"""Too many connections, and requests that come too soon: no traceback, and whoever is let in gets in."""

import logging
import os
import resource
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from tcfit_app.server import gated_viser
from tcfit_app.server.serving import ReviewServer, review_server
from tests.drivers.processes import ended, needs_fork, start
from tests.drivers.raw_tab import PATIENCE, admitted, fetched, received, websocket

pytestmark = pytest.mark.thorough

DESCRIPTORS, IDLE = 170, 287
"""How many files more than before a server may open, and how many connections come."""
SOON = 5.0
"""Seconds in which a browser should get in."""


def serving() -> AbstractContextManager[ReviewServer]:
    return review_server("A clip", port=0, open_browser=False, say=lambda text: None)


def connected(address: str) -> socket.socket:
    host, port = address.removeprefix("http://").split(":")
    return socket.create_connection((host, int(port)), timeout=PATIENCE)


def loud(records: list[logging.LogRecord]) -> list[str]:
    return [logging.Formatter().format(record) for record in records if record.levelno > logging.INFO]


@pytest.mark.parametrize("known", [False, True], ids=["a stranger", "a browser that is in"])
@pytest.mark.parametrize("upgrade", [False, True], ids=["page", "websocket"])
@pytest.mark.parametrize("pieces", [1, 7], ids=["at once", "in pieces"])
def test_requests_behind_each_other(
    known: bool,
    upgrade: bool,
    pieces: int,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(gated_viser._log, "filters", [gated_viser._is_no_noise])  # viser adds one, which hides more
    with serving() as server:
        address, cookie = server.address.url, admitted(server.gate.link)
        lines = ["GET / HTTP/1.1", f"Host: {address.removeprefix('http://')}", f"Cookie: {cookie if known else 'x'}"]
        if upgrade:
            lines += [f"Origin: {address}", "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"]
            lines += ["Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="]
        sent = ("\r\n".join(lines) + "\r\n\r\n").encode() * 2
        with connected(address) as client:
            for i in range(pieces):
                client.sendall(sent[len(sent) * i // pieces : len(sent) * (i + 1) // pieces])
                time.sleep(0.02 if pieces > 1 else 0.0)
            answer = client.recv(12) if known and upgrade else received(client)
        assert answer.startswith(
            b"HTTP/1.1 101" if known and upgrade else b"HTTP/1.1 200" if known else b"HTTP/1.1 403"
        )
        assert fetched(address, Cookie=cookie).status == 200
    assert not loud(caplog.records)
    assert capfd.readouterr() == ("", "")


@dataclass
class Elsewhere:
    """A server in another process."""

    link: str
    loud: list[str] = field(default_factory=list)
    """What it has logged above INFO, once it has ended."""

    @property
    def address(self) -> str:
        return self.link.partition("/?")[0]


@contextmanager
def elsewhere(folder: Path, descriptors: Callable[[], int]) -> Iterator[Elsewhere]:
    """A server in a forked process that may open so many files, asked for there once it runs."""

    def work(report: Callable[[str], None]) -> None:
        records: list[logging.LogRecord] = []
        handler = logging.Handler()
        handler.emit = records.append  # pyright: ignore[reportAttributeAccessIssue]
        logging.getLogger().addHandler(handler)
        with serving() as server:
            most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
            resource.setrlimit(resource.RLIMIT_NOFILE, (descriptors(), most))
            report(server.gate.link)
            while not (folder / "stop").exists():
                time.sleep(0.05)
        for text in loud(records):
            report(text.replace("\n", " "))

    child, source = start(work)
    found = Elsewhere(os.read(source, 1000).decode().strip())
    try:
        yield found
    finally:
        (folder / "stop").touch()
        status, found.loud = ended(child, source)
    assert status == 0, found.loud


@needs_fork
def test_idle_connections_where_few_files_may_be_open(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    with elsewhere(tmp_path, lambda: len(os.listdir("/dev/fd")) + DESCRIPTORS) as server, ExitStack() as opened:
        for _ in range(IDLE):
            opened.enter_context(connected(server.address))
        begin = time.monotonic()
        cookie = admitted(server.link)
        assert fetched(server.address, Cookie=cookie).status == 200
        tab = opened.enter_context(websocket(server.address, cookie))
        assert tab.recv(timeout=PATIENCE)
        waited = time.monotonic() - begin
        for _ in range(50):
            opened.enter_context(connected(server.address))
        assert fetched(server.address, Cookie=cookie).status == 200
        assert tab.ping().wait(PATIENCE), "whoever is in stays in"
    assert not server.loud
    assert waited < SOON
    assert capfd.readouterr() == ("", "")


@needs_fork
def test_no_file_can_be_opened_any_more(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    with elsewhere(tmp_path, lambda: len(os.listdir("/dev/fd")) + 30) as server, ExitStack() as opened:
        for _ in range(70):
            opened.enter_context(connected(server.address))
        begin = time.monotonic()
        assert fetched(server.address, Cookie=admitted(server.link)).status == 200
        waited = time.monotonic() - begin
    [told] = server.loud
    assert "may open no more files" in told and len(told) < 200
    assert waited < SOON
    assert capfd.readouterr() == ("", "")


def test_there_are_so_many_tabs_and_no_more(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(gated_viser, "PAGES", 3)
    with serving() as server, ExitStack() as opened:
        address, cookie = server.address.url, admitted(server.gate.link)
        tabs = [opened.enter_context(websocket(address, cookie)) for _ in range(3)]
        with pytest.raises(InvalidStatus) as refused:
            websocket(address, cookie)
        assert refused.value.response.status_code == 503
        tabs[0].close()
        with websocket(address, cookie) as another:
            assert another.recv(timeout=PATIENCE)


def test_a_page_of_another_viser_is_refused_in_silence(capfd: pytest.CaptureFixture[str]):
    with serving() as server:
        address, cookie = server.address.url, admitted(server.gate.link)
        with websocket(address, cookie, version="0.0.1") as client, pytest.raises(ConnectionClosed) as closed:
            client.recv(timeout=PATIENCE)
    assert closed.value.rcvd and closed.value.rcvd.code == 1002  # so viser's page knows that it is another one's
    assert capfd.readouterr() == ("", "")
