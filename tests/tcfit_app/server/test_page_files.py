"""Which files of this computer a page may name: those of a page elsewhere are none of the user's."""

import ipaddress
import os
import socket
from pathlib import Path

import pytest
import viser
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.datastructures import Headers
from websockets.http11 import Request
from websockets.sync.client import connect

from fitting_core.errors import InputError
from tcfit_app.server.address import Address
from tcfit_app.server.gate import Entry, Gate
from tcfit_app.server.gated_viser import is_here, visitor
from tcfit_app.server.page_files import PageFiles, on_this_computer
from tcfit_app.server.serving import review_server
from tests.tcfit_app.server.test_gate import admit


def test_browsers_of_this_computer_and_elsewhere():
    """Behind a proxy nobody is here, whatever it says."""
    for address in ("127.0.0.1", "127.8.9.10", "::1", "::ffff:127.0.0.1"):
        assert on_this_computer(address, Headers()), address
    for address in ("192.168.0.7", "172.17.0.1", "::ffff:10.0.0.1", "fe80::1%eth0", "0.0.0.0", "", "x"):
        assert not on_this_computer(address, Headers()), address
    for name in ("X-Forwarded-For", "x-forwarded-host", "Forwarded", "Via", "X-Real-IP"):
        for address in ("127.0.0.1", "10.0.0.1"):
            assert not on_this_computer(address, Headers({name: "127.0.0.1"})), (address, name)


def test_a_page_here_names_any_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    files = PageFiles(here=True)
    assert files.path(f' "{tmp_path}/a b" ') == tmp_path / "a b"
    assert files.path("~/walk.mp4") == tmp_path / "walk.mp4"


def test_a_page_elsewhere_names_none(tmp_path: Path):
    for text in (str(tmp_path), "/etc/passwd", "walk.mp4", "", "/nowhere"):
        with pytest.raises(InputError, match="Upload the file instead"):
            PageFiles(here=False).path(text)


@pytest.mark.parametrize("here", [True, False])
def test_with_a_folder_for_them_everybody_names_what_lies_there(tmp_path: Path, here: bool):
    root, outside = tmp_path / "clips", tmp_path / "secret"
    (root / "frames").mkdir(parents=True)
    (root / "walk.mp4").write_bytes(b"x")
    outside.mkdir()
    (root / "out").symlink_to(outside)
    (root / "in").symlink_to(root / "walk.mp4")
    (root / "frames" / "1.png").symlink_to(outside / "key")
    files = PageFiles(here=here, root=root)
    for text in ("walk.mp4", "./frames/../walk.mp4", str(root / "walk.mp4"), "in"):
        assert files.path(text) == (root / "walk.mp4").resolve()
    assert files.path("not/there.npz") == root.resolve() / "not" / "there.npz"
    wrong = ("/etc/passwd", "../secret", str(outside), "out", "out/key", "~", "/nowhere", "../nowhere", "frames")
    for text in wrong:
        with pytest.raises(InputError, match="does not lie in"):
            files.path(text)


@pytest.mark.parametrize(
    "text", ["", "   ", "a\0b", 5000 * "x", 300 * "y", "~nosuchuser/x", "/dev/zero", "fifo", "loop"]
)
def test_what_is_no_path_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("fifo")
    os.symlink("loop", "loop")
    for files in (PageFiles(here=True), PageFiles(here=True, root=tmp_path)):
        with pytest.raises(InputError):
            files.path(text)


PUBLIC = "https://fits.example.org"
NGINX = {"Origin": PUBLIC}
"""With the lines of docs/server.md, X-Forwarded-For left out."""
CADDY = {**NGINX, "X-Forwarded-For": "192.0.2.7", "X-Forwarded-Host": "fits.example.org", "X-Forwarded-Proto": "https"}


@pytest.mark.parametrize(
    ("entry", "headers"),
    [
        (Entry(), {}),
        (Entry(), {"X-Forwarded-For": "127.0.0.1"}),
        (Entry(), {"Forwarded": "for=127.0.0.1"}),
        (Entry(public=PUBLIC), NGINX),
        (Entry(public=PUBLIC), CADDY),
        (Entry(public=PUBLIC), {}),
        (Entry(password="correct horse battery"), {}),
    ],
)
def test_the_server_tells_its_pages_apart(entry: Entry, headers: dict[str, str]):
    """A server that was told of browsers elsewhere believes no connection that looks as if it came from here."""
    with review_server("A clip", port=0, open_browser=False, say=lambda text: None, entry=entry) as server:
        cookie = admit(server)
        with connect(
            f"ws://{'fits.example.org' if 'Origin' in headers else '127.0.0.1'}/",
            sock=socket.create_connection(("127.0.0.1", server.address.port)),
            additional_headers={"Cookie": cookie, "Origin": "http://127.0.0.1", **headers},
            subprotocols=[f"viser-v{viser.__version__}"],  # pyright: ignore[reportArgumentType]
            max_size=None,
        ) as tab:
            tab.recv(timeout=20)
            assert visitor(server.viser, 0).here == (entry == Entry() and not headers)
        assert not visitor(server.viser, 1).here


NAMES = (
    "Host", "Origin", "Forwarded", "Via", "X-Forwarded-For", "X-Forwarded-Host", "X-Forwarded-Proto", "X-Real-IP",
    "x-forwarded-for", "X_Forwarded_For", "Cookie", "Authorization", "Sec-Fetch-Site", "Upgrade", "Connection",
)  # fmt: skip
VALUES = (
    "", " ", "127.0.0.1", "localhost", "[::1]", "::1", "::ffff:127.0.0.1", "[::ffff:7f00:1]", "0.0.0.0", "127.1",
    "2130706433", "fe80::1%lo", "127.0.0.1:8080", "localhost:99999", "127.0.0.1, 192.0.2.7", "for=127.0.0.1",
    'for="[::1]";host=localhost', "null", "http://127.0.0.1", PUBLIC, "fits.example.org", "fits.example.org.",
    "FITS.example.org", "fits.example.org:443", "unknown", "_hidden", "tcfit-1=..", "tcfit-1=.x", "Basic Og==",
    "Basic " + "A" * 5000, "websocket", "x" * 5000, "%00", "cross-site",
)  # fmt: skip
PROXIES: dict[str, dict[str, str]] = {
    "nginx": {},
    "nginx with the sender": {"X-Forwarded-For": "192.0.2.7"},
    "Caddy": CADDY,
    "Apache": {"X-Forwarded-For": "192.0.2.7", "X-Forwarded-Host": "fits.example.org", "X-Forwarded-Server": "x"},
    "Traefik": {"X-Real-IP": "192.0.2.7", "X-Forwarded-For": "192.0.2.7", "X-Forwarded-Port": "443"},
    "RFC 7239": {"Forwarded": "for=192.0.2.7;proto=https"},
}
"""What proxies on this computer add to whatever a browser sends."""


@settings(max_examples=300, deadline=None)
@given(
    sent=st.lists(st.tuples(st.sampled_from(NAMES), st.sampled_from(VALUES)), max_size=8),
    proxy=st.sampled_from(list(PROXIES)),
    entry=st.sampled_from([Entry(), Entry(public=PUBLIC), Entry(password="correct horse battery", public=PUBLIC)]),
    path=st.sampled_from(["/", "/?token=", "/?frame=1", "//", "/?token=%00", "/\udce4", "*", "http://x/"]),
)
def test_whatever_a_browser_elsewhere_sends_through_a_proxy_it_is_not_here_and_not_in(
    sent: list[tuple[str, str]], proxy: str, entry: Entry, path: str
):
    headers = Headers(sent)
    for name, value in PROXIES[proxy].items():
        headers[name] = value
    gate = Gate(Address(asked="127.0.0.1", ip=ipaddress.ip_address("127.0.0.1"), port=1), entry=entry)
    assert gate.answer(Request(path, headers), "127.0.0.1") is not None
    assert gate.name_of(headers) is None
    if entry.for_others or PROXIES[proxy]:
        assert not is_here(gate, "127.0.0.1", headers)
    assert not is_here(gate, "192.0.2.7", headers)


def test_a_browser_that_comes_over_the_network_is_elsewhere():
    with review_server("A clip", host="0.0.0.0", port=0, open_browser=False, say=lambda text: None) as server:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as route:
            try:
                route.connect(("192.0.2.1", 9))  # sends nothing: only asks under which address this computer would
            except OSError:
                pytest.skip("this computer has no network")
            own = route.getsockname()[0]
        if own.startswith("127."):
            pytest.skip("this computer has no network")
        place = f"{own}:{server.address.port}"
        with connect(
            f"ws://{place}/",
            origin=f"http://{place}",  # pyright: ignore[reportArgumentType]
            additional_headers={"Cookie": admit(server)},
            subprotocols=[f"viser-v{viser.__version__}"],  # pyright: ignore[reportArgumentType]
            max_size=None,
        ) as tab:
            tab.recv(timeout=20)
            assert not visitor(server.viser, 0).here
