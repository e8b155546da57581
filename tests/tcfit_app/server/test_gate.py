"""The gate in front of viser, tried with real clients."""

import base64
import logging
import socket
import threading
import time
import webbrowser
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import viser
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, ConnectionClosedError, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from fitting_core.errors import InputError
from tcfit_app.cli.review_command import entry_of
from tcfit_app.options.fit import ServerOptions
from tcfit_app.server import gated_viser
from tcfit_app.server.address import Address, listen
from tcfit_app.server.gate import PROTECTION, Entry
from tcfit_app.server.serving import ReviewServer, browser_at_hand, review_server
from tests.drivers.raw_tab import Answer, admitted, fetched, received
from tests.drivers.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

HOME = "/"


def silent(text: str) -> None:
    """Says nothing."""


def serve(**options) -> AbstractContextManager[ReviewServer]:
    """A server for tests, at any free port."""
    return review_server("A clip", **({"port": 0, "open_browser": False, "say": silent} | options))


@pytest.fixture(scope="module")
def server() -> Iterator[ReviewServer]:
    with serve() as running:
        yield running


def get(server: ReviewServer, path: str, **headers: str) -> Answer:
    return fetched(f"http://127.0.0.1:{server.address.port}{path}", **headers)


def entrance(server: ReviewServer) -> str:
    """The link's path, with the token."""
    return "/?" + server.gate.link.partition("/?")[2]


def admit(server: ReviewServer) -> str:
    """Comes in through the link; the cookie."""
    return admitted(f"http://127.0.0.1:{server.address.port}{entrance(server)}")


@pytest.fixture(scope="module")
def cookie(server: ReviewServer) -> str:
    return admit(server)


def open_websocket(server: ReviewServer, path: str = HOME, **headers: str) -> ClientConnection:
    """As viser's client does it; with the server's own Origin, unless another one or "" is given."""
    origin = headers.pop("Origin", server.address.url)
    return connect(
        f"ws://127.0.0.1:{server.address.port}{path}",
        origin=origin or None,  # pyright: ignore[reportArgumentType]
        additional_headers=headers,
        subprotocols=[f"viser-v{viser.__version__}"],  # pyright: ignore[reportArgumentType]
        max_size=None,
        proxy=None,
        close_timeout=2,
    )


def refusal(server: ReviewServer, path: str = HOME, **headers: str) -> int:
    """The status with which a websocket is refused."""
    with pytest.raises(InvalidStatus) as refused:
        open_websocket(server, path, **headers)
    return refused.value.response.status_code


def raw(server: ReviewServer, request: bytes) -> bytes:
    """All that the server answers to these bytes until it hangs up."""
    with socket.create_connection(("127.0.0.1", server.address.port), timeout=20) as client:
        client.sendall(request)
        return received(client)


def handshake(*, host: str = "127.0.0.1", origin: str = "http://127.0.0.1", cookie: str = "") -> bytes:
    """A request for a websocket, with headers that a library would not send."""
    lines = [
        f"GET / HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nCookie: {cookie}\r\nUpgrade: websocket",
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
        f"Sec-WebSocket-Protocol: viser-v{viser.__version__}\r\n\r\n",
    ]
    return "\r\n".join(lines).encode()


def status_of(server: ReviewServer, request: bytes) -> int:
    """The status of the answer; the connection is closed then."""
    with socket.create_connection(("127.0.0.1", server.address.port), timeout=20) as client:
        client.sendall(request)
        return int(client.recv(12).split()[1])


# Admission


def test_the_link_gives_a_cookie_that_opens_the_page_and_the_websocket(server: ReviewServer):
    answer = get(server, entrance(server))
    cookie, *attributes = answer.headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} == set(attributes)
    assert "url=/'" in answer.body and "Location" not in answer.headers
    page = get(server, HOME, Cookie=cookie)
    assert page.status == 200 and "viser" in page.body.lower()
    with open_websocket(server, Cookie=cookie) as client:
        assert isinstance(client.recv(timeout=10), bytes)


def test_a_link_works_once_and_the_next_one_for_another_browser(server: ReviewServer):
    used = entrance(server)
    first = admit(server)
    assert get(server, used).status == 403
    assert entrance(server) != used
    second = admit(server)
    for cookie in (first, second):
        assert get(server, HOME, Cookie=cookie).status == 200


def test_of_many_that_use_a_link_at_the_same_time_one_gets_in(server: ReviewServer):
    link = entrance(server)
    with ThreadPoolExecutor(12) as pool:
        statuses = list(pool.map(lambda _: get(server, link).status, range(12)))
    assert sorted(statuses) == [200, *[403] * 11]


def test_fresh_links_are_said_after_each_use():
    said: list[str] = []
    with serve(say=said.append) as server:
        first = server.gate.link
        assert said[-1].endswith(first)
        admit(server)
        until(lambda: len(said) > 1)
        assert said[-1].endswith(server.gate.link) and server.gate.link != first


# Refusal


@pytest.mark.parametrize(
    "path", [HOME, "/?token=", "/?token=wrong", "/?token=%F0", "/?token=\u00e9".encode().decode("latin1")]
)
def test_without_link_or_cookie_there_is_only_a_hint(server: ReviewServer, path: str):
    answer = raw(server, f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode("latin1"))
    assert answer.startswith(b"HTTP/1.1 403 ") and b"link" in answer
    assert b"Set-Cookie" not in answer and len(answer) < 1000


@pytest.mark.parametrize(
    "change", [lambda c: c[:-1], lambda c: c + "x", lambda c: c.replace("=", "x=", 1), lambda c: ""]
)
def test_a_wrong_cookie_is_refused(server: ReviewServer, cookie: str, change):
    assert get(server, HOME, Cookie=change(cookie)).status == 403
    assert refusal(server, Cookie=change(cookie)) == 403


def test_a_token_opens_no_websocket(server: ReviewServer):
    link = entrance(server)
    assert refusal(server, link) == 403
    assert entrance(server) == link


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "127.0.0.1.evil.example",
        "localhost.",
        "me@127.0.0.1",
        "10.0.0.1",
        "[::2]",
        "",
        "a b",
        "localhost:x",
    ],
)
def test_another_host_is_misdirected(server: ReviewServer, cookie: str, host: str):
    for path in (HOME, entrance(server)):
        request = f"GET {path} HTTP/1.1\r\nHost: {host}\r\nCookie: {cookie}\r\n\r\n"
        assert raw(server, request.encode()).startswith(b"HTTP/1.1 421 ")
    assert status_of(server, handshake(host=host, origin=f"http://{host}", cookie=cookie)) == 421


@pytest.mark.parametrize("hosts", [[], ["127.0.0.1", "127.0.0.1"], ["127.0.0.1", "evil.example"]])
def test_there_must_be_one_host(server: ReviewServer, cookie: str, hosts: list[str]):
    lines = "".join(f"Host: {host}\r\n" for host in hosts)
    assert raw(server, f"GET / HTTP/1.1\r\n{lines}Cookie: {cookie}\r\n\r\n".encode()).startswith(b"HTTP/1.1 421 ")


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST", "127.0.0.1", "[::1]", "localhost:9000"])
def test_its_own_names_are_accepted_also_through_a_tunnel(server: ReviewServer, cookie: str, host: str):
    assert get(server, HOME, Host=host, Cookie=cookie).status == 200
    assert status_of(server, handshake(host=host, origin=f"http://{host}", cookie=cookie)) == 101


FOREIGN = [
    "http://evil.example",
    "null",
    "http://127.0.0.1:1",
    "http://localhost",
    "file://",
    "http://127.0.0.1.evil.example",
]


@pytest.mark.parametrize("origin", FOREIGN)
def test_other_pages_get_nothing_even_with_the_cookie(server: ReviewServer, cookie: str, origin: str):
    assert get(server, HOME, Cookie=cookie, Origin=origin).status == 403
    assert refusal(server, Cookie=cookie, Origin=origin) == 403


def test_a_websocket_needs_an_origin(server: ReviewServer, cookie: str):
    assert refusal(server, Cookie=cookie, Origin="") == 403


def test_another_page_does_not_use_up_a_link(server: ReviewServer):
    link = entrance(server)
    assert get(server, link, Origin="http://evil.example").status == 403
    assert get(server, link, Origin=server.address.url).status == 200


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/..\\..\\x",
        "//evil.example/?x",
        "/index.html",
        "/.",
        "*",
        "http://a/",
    ],
)
def test_there_is_one_path(server: ReviewServer, cookie: str, path: str):
    request = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    assert raw(server, f"{request}Cookie: {cookie}\r\n\r\n".encode()).startswith(b"HTTP/1.1 404 ")
    assert raw(server, f"{request}\r\n".encode()).startswith(b"HTTP/1.1 403 ")
    if path.startswith("/i"):
        assert refusal(server, path, Cookie=cookie) == 404


def test_the_icon_that_browsers_ask_for_is_nothing(server: ReviewServer, cookie: str):
    request = "GET /favicon.ico HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    assert raw(server, f"{request}Cookie: {cookie}\r\n\r\n".encode()).startswith(b"HTTP/1.1 204 ")
    assert raw(server, f"{request}\r\n".encode()).startswith(b"HTTP/1.1 403 ")


def test_scripts_are_for_browsers_that_were_let_in():
    text = b"export const answer = 42;"
    with serve(scripts={"/tcfit/main.js": text}) as server:
        assert get(server, "/tcfit/main.js").status == 403
        cookie = admit(server)
        answer = get(server, "/tcfit/main.js", Cookie=cookie)
        assert (answer.status, answer.body) == (200, text.decode())
        assert answer.headers["Content-Type"].startswith("text/javascript")
        assert PROTECTION.items() <= answer.headers.items()
        for path in ("/tcfit/", "/tcfit/../gate.py", "/tcfit/main.js?x", "/tcfit/other.js"):
            assert get(server, path, Cookie=cookie).status == 404
        assert refusal(server, "/tcfit/main.js", Cookie=cookie) == 404


@pytest.mark.parametrize(
    "query", ["websocket=ws://evil.example", "frame=1&websocket=ws://evil.example", "frame=1&run=", "frame=x", "run=1"]
)
def test_no_other_query_than_that_of_links_to_frames_reaches_the_page(server: ReviewServer, cookie: str, query: str):
    """viser's page would connect to the server that ?websocket= names, and run the scripts that it sends."""
    answer = get(server, f"/?{query}", Cookie=cookie)
    assert (answer.status, answer.headers["Location"]) == (303, "/")


PLACE = "/?frame=-3&run=2&phase=1&person=4"


def test_a_link_to_a_frame_is_the_page_itself(server: ReviewServer, cookie: str):
    assert get(server, PLACE, Cookie=cookie).body == get(server, HOME, Cookie=cookie).body
    assert refusal(server, PLACE, Cookie=cookie) == 404
    assert get(server, PLACE).status == 403


def test_a_link_to_a_frame_that_was_clicked_elsewhere_goes_on_with_the_cookie(server: ReviewServer):
    clicked = get(server, PLACE, **{"Sec-Fetch-Site": "cross-site"})
    assert "url=/?frame=-3&amp;run=2&amp;phase=1&amp;person=4'" in clicked.body and "Set-Cookie" not in clicked.headers


def test_every_answer_is_protected(server: ReviewServer, cookie: str):
    for answer in (
        get(server, HOME),
        get(server, HOME, Cookie=cookie),
        get(server, "/x", Cookie=cookie),
        get(server, HOME, Host="evil.example"),
        get(server, entrance(server)),
    ):
        assert PROTECTION.items() <= answer.headers.items()
    assert PROTECTION["Referrer-Policy"] == "no-referrer"


# Robustness


@pytest.mark.parametrize(
    "request_bytes",
    [
        b"GET /?token=" + b"a" * 20000 + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: " + b"a" * 20000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 1000 + b"\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 5\r\n\r\nhello",
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 0\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\r\n\r\n",
        b"\r\n\r\n",
    ],
    ids=["long path", "long header", "many headers", "body", "POST", "TLS", "empty"],
)
def test_what_is_no_small_get_is_cut_off(server: ReviewServer, request_bytes: bytes):
    assert raw(server, request_bytes) == b""
    assert get(server, HOME).status == 403


def test_slow_requests_are_cut_off_and_hold_up_nobody(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(gated_viser, "REQUEST_SECONDS", 4.0)
    with serve() as server, ExitStack() as clients:
        address = ("127.0.0.1", server.address.port)
        slow = [clients.enter_context(socket.create_connection(address, timeout=10)) for _ in range(20)]
        start = time.monotonic()
        for client in slow[1:]:
            client.sendall(b"GET / HTTP/1.1\r\nHost: ")
        assert get(server, entrance(server)).status == 200
        assert time.monotonic() - start < 3.8, "the slow ones held up the other"
        dripping = slow[-1]
        with pytest.raises(ConnectionError):
            while time.monotonic() - start < 12:
                dripping.sendall(b"1")
                time.sleep(0.1)
        for client in slow[:-1]:
            assert client.recv(1) == b""


def test_neither_token_nor_cookie_gets_into_logs(
    caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    caplog.set_level(logging.DEBUG)
    monkeypatch.setattr(gated_viser._log, "filters", [gated_viser._is_no_noise])  # viser adds one, which hides more
    with serve() as server:
        link = entrance(server)
        raw(server, f"GET {link} HTTP/1.0\r\n\r\n".encode())  # quoted in the traceback of websockets
        cookie = admit(server)
        raw(server, f"GET / HTTP/1.1\r\nCookie: {cookie}\x01\r\n\r\n".encode())
        with open_websocket(server, Cookie=cookie) as client:
            client.recv(timeout=10)
    ours = [record for record in caplog.records if record.name.startswith("tcfit_app")]
    assert "connection open" in [record.getMessage() for record in ours], "the log is not recorded"
    text = "".join(map(logging.Formatter().format, ours)) + "".join(capfd.readouterr())
    for secret in (link.partition("=")[2], cookie.partition("=")[2]):
        assert secret not in text


@pytest.mark.parametrize(("error", "told"), [(ConnectionClosedError(None, None), False), (RuntimeError(), True)])
def test_a_browser_that_leaves_before_it_is_answered_is_no_news(error: Exception, told: bool):
    record = logging.makeLogRecord({"msg": "opening handshake failed", "exc_info": (type(error), error, None)})
    assert gated_viser._is_no_noise(record) == told


def test_the_end_closes_everything_at_once(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(gated_viser, "GOODBYE_SECONDS", 5.0)
    before = set(threading.enumerate())
    with ExitStack() as stack:
        with serve() as server:
            address = ("127.0.0.1", server.address.port)
            idle = stack.enter_context(socket.create_connection(address, timeout=5))
            client = open_websocket(server, Cookie=admit(server))
            client.recv(timeout=10)
            start = time.monotonic()
        assert time.monotonic() - start < 3
        assert idle.recv(1) == b""
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                client.recv(timeout=5)
        assert closed.value.rcvd and closed.value.rcvd.code == 1001
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(address)
    client.close()
    left = [
        thread for thread in set(threading.enumerate()) - before if not thread.name.startswith("ThreadPoolExecutor")
    ]
    for thread in left:
        thread.join(5)  # the client's own ends a moment later
    assert not any(thread.is_alive() for thread in left)


def test_the_end_does_not_wait_for_a_browser_that_is_silent():
    with serve() as server:
        cookie = admit(server)
        client = socket.create_connection(("127.0.0.1", server.address.port), timeout=5)
        client.sendall(handshake(cookie=cookie))
        assert client.recv(12) == b"HTTP/1.1 101"
        start = time.monotonic()
    assert time.monotonic() - start < gated_viser.GOODBYE_SECONDS + 3
    client.close()


def test_an_exception_inside_closes_the_server_too():
    with pytest.raises(KeyError), serve() as server:
        raise KeyError
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", server.address.port))


def test_two_servers_do_not_share_their_visitors(server: ReviewServer, cookie: str):
    said: list[str] = []
    with serve(port=server.address.port, say=said.append) as other:
        assert other.address.port > server.address.port
        assert f"Port {server.address.port} is in use" in said[0]
        assert get(other, HOME, Cookie=cookie).status == 403
        assert get(other, entrance(server)).status == 403
        both = f"{cookie}; {admit(other)}"  # a browser sends its cookies to all ports of a host
        for one in (server, other):
            assert get(one, HOME, Cookie=both).status == 200
            with open_websocket(one, Cookie=both) as client:
                assert client.recv(timeout=10)
    assert get(server, HOME, Cookie=cookie).status == 200


def test_other_software_on_websockets_is_left_alone(server: ReviewServer):
    from viser.infra import _infra
    from websockets.asyncio import server as network

    assert _infra.websockets.asyncio.server.serve is network.serve  # pyright: ignore[reportPrivateImportUsage]


# Address


def address(ip: str, asked: str | None = None) -> Address:
    return Address(asked=asked or ip, ip=ip_address(ip), port=8080)


@pytest.mark.parametrize(
    ("listening", "host", "accepted"),
    [
        (address("127.0.0.1", "review.test"), "review.test:8080", True),
        (address("127.0.0.1"), "192.168.1.5:8080", False),
        (address("192.168.1.5"), "192.168.1.5:8080", True),
        (address("192.168.1.5", "Box.example.org"), "box.example.org:8080", True),
        (address("192.168.1.5"), "box.example.org:8080", False),
        (address("0.0.0.0"), "192.168.1.5:8080", True),
        (address("0.0.0.0"), f"{socket.gethostname()}:8080", True),
        (address("0.0.0.0"), f"{socket.gethostname()}.evil.example:8080", False),
        (address("0.0.0.0"), "1.2.3.4.evil.example", False),
        (address("::"), "[fe80::1]:8080", True),
    ],
)
def test_names_that_an_address_has(listening: Address, host: str, accepted: bool):
    assert listening.accepts(host) is accepted


def test_only_this_computer_reaches_it_unless_asked(server: ReviewServer):
    assert server.address.loopback and server.viser.get_host() == "127.0.0.1"


def test_other_computers_bring_a_warning_and_need_the_link_as_well():
    said: list[str] = []
    with serve(host="0.0.0.0", say=said.append) as server:
        assert "Warning" in said[0] and "encrypted" in said[0]
        assert get(server, HOME, Host="192.168.1.5").status == 403
        assert get(server, HOME, Host="evil.example").status == 421
        assert get(server, HOME, Host="192.168.1.5", Cookie=admit(server)).status == 200


@pytest.mark.parametrize(
    ("host", "port", "message"),
    [
        ("no-such-host.invalid", 0, "not known"),
        ("", 0, "not known"),
        ("192.0.2.1", 0, "Cannot listen"),
        ("127.0.0.1", 70000, "no port 70000"),
        ("127.0.0.1", -1, "no port -1"),
    ],
)
def test_where_nothing_can_listen(host: str, port: int, message: str):
    with pytest.raises(InputError, match=message), serve(host=host, port=port):
        pass


def test_all_ports_in_use(monkeypatch: pytest.MonkeyPatch, server: ReviewServer):
    monkeypatch.setattr("tcfit_app.server.address.PORTS_TRIED", 1)
    with pytest.raises(InputError, match="in use"):
        listen("127.0.0.1", server.address.port)


# Browser


@pytest.mark.parametrize(
    ("environment", "platform", "there"),
    [
        ({}, "linux", False),
        ({"DISPLAY": ":0"}, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({"DISPLAY": ":0", "CI": "true"}, "linux", False),
        ({"DISPLAY": "localhost:10.0", "SSH_CONNECTION": "1"}, "linux", False),
        ({"SSH_CONNECTION": "1", "BROWSER": "/code/helper"}, "linux", True),
        ({}, "darwin", True),
        ({}, "win32", True),
        ({"CI": "1"}, "darwin", False),
    ],
)
def test_where_a_browser_is_opened(environment: dict[str, str], platform: str, there: bool):
    assert browser_at_hand(environment, platform) is there


@pytest.mark.parametrize("wanted", [True, False])
def test_the_browser_is_opened_at_the_link(monkeypatch: pytest.MonkeyPatch, wanted: bool):
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr("tcfit_app.server.serving.browser_at_hand", lambda *_: True)
    with serve(open_browser=wanted) as server:
        assert opened == [server.gate.link] * wanted


READY = "() => Boolean(window.__viserMutable?.canvas && window.__viserMutable?.cameraControl)"
CLICK = "link => { document.body.innerHTML = `<a href='${link}'>Review</a>`; document.querySelector('a').click(); }"


WEBSOCKET = """([url, protocol]) => new Promise(done => {
    const socket = new WebSocket(url, protocol);
    socket.onopen = () => done("open");
    socket.onerror = () => done("refused");
})"""


def test_in_a_browser(browser: "Browser"):
    with serve() as server, serve() as foreign:
        page, requests = browser.new_page(), []
        page.on("request", lambda request: requests.append(request))
        pages_before = page.evaluate("history.length")
        page.goto(server.gate.link)
        page.wait_for_url(f"{server.address.url}/")
        page.wait_for_function(READY, timeout=60_000)
        page.wait_for_function("document.title === 'A clip'")
        assert page.locator("canvas").count() >= 1
        assert len(server.viser.get_clients()) == 1
        assert page.evaluate("[document.cookie, document.referrer, history.length]") == ["", "", pages_before + 1]
        assert not [r.url for r in requests if not r.url.startswith((server.address.url, "data:", "blob:"))]
        assert not [r.headers["referer"] for r in requests if "referer" in r.headers]

        page.reload()
        page.wait_for_function(READY, timeout=60_000)

        stranger = browser.new_context().new_page()
        answer = stranger.goto(server.address.url)
        assert answer and answer.status == 403 and "link" in stranger.inner_text("body")

        # A link in a page of another site: the cookie has to be sent right after it was set.
        stranger.goto("data:text/html,elsewhere")
        stranger.evaluate(CLICK, server.gate.link)
        stranger.wait_for_function(READY, timeout=60_000)
        # From another port, the browser sends the cookie all the same.
        stranger.goto(foreign.gate.link)
        stranger.wait_for_url(f"{foreign.address.url}/")
        target = server.address.url.replace("http", "ws")
        assert stranger.evaluate(WEBSOCKET, [target, f"viser-v{viser.__version__}"]) == "refused"


# --- a password, and a proxy ---

PUBLIC = "https://fits.example.org"


@pytest.fixture(scope="module")
def lab() -> Iterator[ReviewServer]:
    """As a laboratory's server runs it: a password, and a proxy before it."""
    with serve(entry=Entry(password="correct horse: battery", public=PUBLIC)) as running:
        yield running


def basic(password: str, user: str = "anna") -> str:
    return "Basic " + base64.b64encode(f"{user}:{password}".encode()).decode()


def test_the_password_lets_browsers_in(lab: ReviewServer):
    asked = get(lab, HOME, Host="fits.example.org")
    assert asked.status == 401 and asked.headers["WWW-Authenticate"].startswith("Basic ")
    for _ in range(2):
        let_in = get(lab, HOME, Host="fits.example.org", Authorization=basic("correct horse: battery"))
        assert let_in.status == 200 and let_in.headers["Set-Cookie"].endswith("; Secure")
    cookie = let_in.headers["Set-Cookie"].partition(";")[0]
    assert "<script" in get(lab, HOME, Host="fits.example.org", Cookie=cookie).body
    assert not get(lab, entrance(lab)).headers["Set-Cookie"].endswith("Secure"), "over plain http the browser drops it"


def signed_in(server: ReviewServer, user: str) -> tuple[str, str | None]:
    """The cookie of somebody who signs in, and the name that the gate then knows."""
    let_in = get(server, HOME, Host="fits.example.org", Authorization=basic("correct horse: battery", user))
    cookie = let_in.headers["Set-Cookie"].partition(";")[0]
    return cookie, server.gate.name_of(Headers({"Cookie": cookie}))


@pytest.mark.parametrize(
    ("user", "name"),
    [("anna", "anna"), ("Ana  María\t", "Ana María"), ("\u202eevil\x00", "evil"), ("x" * 99, "x" * 40)],
)
def test_the_name_of_whoever_signs_in_is_known(lab: ReviewServer, user: str, name: str):
    assert signed_in(lab, user)[1] == name


def test_nobody_can_make_a_cookie_of_another_name(lab: ReviewServer):
    anna, _ = signed_in(lab, "anna")
    ben, _ = signed_in(lab, "ben")
    known, _, anna_s = anna.partition("=")
    code, _, seal = ben.partition("=")[2].partition(".")
    assert anna_s.partition(".")[2] != seal
    for forged in (f"{anna_s.partition('.')[0]}.{seal}", f"{code}.", "%%%.x", ".", ""):
        assert lab.gate.name_of(Headers({"Cookie": f"{known}={forged}"})) is None
        assert get(lab, HOME, Host="fits.example.org", Cookie=f"{known}={forged}").status == 401
    assert lab.gate.name_of(Headers({"Cookie": admit(lab)})) == "", "who came by a link has given none"


def test_a_client_has_the_name_of_its_browser(lab: ReviewServer):
    cookie, _ = signed_in(lab, "anna")
    with open_websocket(lab, Cookie=cookie) as client:
        client.recv(timeout=10)
        until(lambda: any(gated_viser.visitor(lab.viser, number).name == "anna" for number in range(99)))


def test_through_the_proxy_only_its_own_page_talks(lab: ReviewServer):
    given = {"Host": "fits.example.org", "Authorization": basic("correct horse: battery")}
    assert get(lab, HOME, Origin=PUBLIC, **given).status == 200
    for origin in ("http://fits.example.org", "https://evil.example", "null"):
        assert get(lab, HOME, Origin=origin, **given).status == 403
    assert get(lab, HOME, Host="evil.example", Authorization=given["Authorization"]).status == 421
    assert lab.gate.link.startswith(f"{PUBLIC}/?token=")


def test_the_password_leads_on_to_the_frame_of_a_link(lab: ReviewServer):
    assert "url=/?frame=3'" in get(lab, "/?frame=3", Authorization=basic("correct horse: battery")).body


@pytest.mark.parametrize("header", ["Basic", "Basic %%%", "Bearer correct", basic(""), basic("correct horse")])
def test_other_passwords_let_nobody_in(header: str):
    with serve(entry=Entry(password="correct horse: battery")) as running:
        assert get(running, HOME, Authorization=header).status == 401


def test_guessing_ends_while_links_and_browsers_that_are_in_go_on():
    with serve(entry=Entry(password="correct horse: battery")) as running:
        cookie = get(running, entrance(running)).headers["Set-Cookie"].partition(";")[0]
        statuses = [get(running, HOME, Authorization=basic(f"guess {n}")).status for n in range(24)]
        assert statuses == [401] * 20 + [429] * 4
        assert get(running, HOME, Authorization=basic("correct horse: battery")).status == 429
        assert get(running, HOME, Cookie=cookie).status == 200 and get(running, entrance(running)).status == 200


def test_guesses_from_one_place_lock_nobody_else_out(lab: ReviewServer):
    """The proxy adds where a request comes from behind what that has said of itself."""

    def status(place: str, password: str) -> int:
        given = {"Host": "fits.example.org", "X-Forwarded-For": f"10.0.0.7, {place}"}
        return get(lab, HOME, Authorization=basic(password), **given).status

    right = "correct horse: battery"
    assert [status("203.0.113.9", f"guess {n}") for n in range(21)] == [401] * 20 + [429]
    assert status("203.0.113.10", "guess") == 401 and status("203.0.113.10", right) == 200
    assert get(lab, HOME, Host="fits.example.org").status == 401, "a newcomer is asked"
    assert get(lab, HOME, Authorization=basic(right), **{"X-Forwarded-For": "203.0.113.9"}).status == 200, "no proxy"
    assert [status(f"2001:db8:1:2::{n}", f"guess {n}") for n in range(21)] == [401] * 20 + [429], "one network"
    assert status("2001:db8:1:3::1", right) == 200


def test_a_websocket_asks_for_no_password(lab: ReviewServer):
    with pytest.raises(InvalidStatus, match="403"):
        connect(
            f"ws://127.0.0.1:{lab.address.port}",
            origin=f"http://127.0.0.1:{lab.address.port}",  # pyright: ignore[reportArgumentType]
            additional_headers={"Authorization": basic("correct horse: battery")},
        )


def test_what_is_said_behind_a_proxy():
    said: list[str] = []
    with serve(host="0.0.0.0", entry=Entry(public=PUBLIC), say=said.append):
        assert "Allow only its proxy to reach port" in said[0] and said[1].startswith(f"Review: {PUBLIC}/?token=")
        assert len(said) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"public": "fits.example.org"}, "--public fits.example.org: expected an address such as https"),
        ({"public": "https://a.b/c"}, "without a path"),
        ({"password_file": "short"}, "has 5 characters; expected 12 or more"),
        ({"password_file": "empty"}, "has 0 characters"),
        ({"password_file": "missing"}, "cannot be read"),
    ],
)
def test_an_entry_that_cannot_be(options: dict, message: str, tmp_path: Path):
    (tmp_path / "short").write_text("short\n")
    (tmp_path / "empty").write_text("")
    if "password_file" in options:
        options = {"password_file": tmp_path / options["password_file"]}
    with pytest.raises(InputError, match=message):
        entry_of(ServerOptions(**options))


def test_a_password_is_the_first_line_of_its_file(tmp_path: Path):
    (tmp_path / "secret").write_text("correct horse: battery\n# of the lab\n")
    entry = entry_of(ServerOptions(password_file=tmp_path / "secret", public="https://Fits.example.org/"))
    assert entry == Entry(password="correct horse: battery", public=PUBLIC)
