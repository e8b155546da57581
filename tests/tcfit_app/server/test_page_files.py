"""Which files of this computer a page may name: those of a page elsewhere are none of the user's."""

import os
import socket
from pathlib import Path

import pytest
import viser
from websockets.datastructures import Headers
from websockets.sync.client import connect

from fitting_core.errors import InputError
from tcfit_app.server.gate import Entry
from tcfit_app.server.gated_viser import visitor
from tcfit_app.server.page_files import PageFiles, on_this_computer
from tcfit_app.server.serving import review_server
from tests.tcfit_app.server.test_gate import admit


@pytest.mark.parametrize("address", ["127.0.0.1", "127.8.9.10", "::1", "::ffff:127.0.0.1"])
def test_browsers_of_this_computer(address: str):
    assert on_this_computer(address, Headers())


@pytest.mark.parametrize(
    "address", ["192.168.0.7", "172.17.0.1", "::ffff:10.0.0.1", "fe80::1%eth0", "0.0.0.0", "", "x"]
)
def test_browsers_elsewhere(address: str):
    assert not on_this_computer(address, Headers())


@pytest.mark.parametrize("name", ["X-Forwarded-For", "x-forwarded-host", "Forwarded", "Via", "X-Real-IP"])
def test_behind_a_proxy_nobody_is_here_whatever_it_says(name: str):
    assert not on_this_computer("127.0.0.1", Headers({name: "127.0.0.1"}))
    assert not on_this_computer("10.0.0.1", Headers({name: "127.0.0.1"}))


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
