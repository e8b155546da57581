"""Downloads of models, from a server of this computer that breaks off, changes and lies."""

import hashlib
import io
import threading
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from fitting_core.detect.download import Downloaded, DownloadProgress, download
from fitting_core.detect.known_models import KNOWN_MODELS, KnownModel, find_model, is_here
from fitting_core.errors import InputError
from tests.fitting_core.detect.onnx_files import brightest_model


@dataclass
class Served:
    """What the server has, and how it behaves."""

    content: bytes = b""
    tag: str | None = '"one"'
    breaks_after: int | None = None
    """Bytes of an answer, after which the connection is closed."""
    status: int = 200
    ranges: bool = True
    asked: list[str] = field(default_factory=list)
    """The range of each request."""
    url: str = ""


@pytest.fixture
def served() -> Iterator[Served]:
    state = Served()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            given = self.headers.get("Range", "")
            state.asked.append(given)
            start = 0
            if given and state.ranges and self.headers.get("If-Range") == state.tag:
                start = int(given.removeprefix("bytes=").rstrip("-"))
            status = 416 if start > len(state.content) else 206 if start else state.status
            self.send_response(status)
            body = state.content[start:] if status < 300 else b""
            self.send_header("Content-Length", str(len(body)))
            if state.tag:
                self.send_header("ETag", state.tag)
            self.end_headers()
            self.wfile.write(body[: state.breaks_after])

        def log_message(self, format: str, *args: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=lambda: server.serve_forever(0.01), daemon=True)
    thread.start()
    state.url = f"http://127.0.0.1:{server.server_port}/model.zip"
    yield state
    server.shutdown()
    server.server_close()


def archive(*entries: tuple[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as file:
        for name, content in entries:
            file.writestr(name, content)
    return buffer.getvalue()


@pytest.fixture(scope="module")
def onnx_bytes(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return brightest_model(tmp_path_factory.mktemp("m") / "m.onnx", size=(96, 128)).read_bytes()


@pytest.fixture
def known(served: Served, onnx_bytes: bytes) -> KnownModel:
    served.content = archive(("20230728/x/end2end.onnx", onnx_bytes), ("20230728/x/pipeline.json", b"{}"))
    sha256 = hashlib.sha256(onnx_bytes).hexdigest()
    return replace(KNOWN_MODELS["dwpose-l"], url=served.url, sha256=sha256)


def finished(model: KnownModel, folder: Path) -> Downloaded:
    *steps, last = download(model, folder)
    assert isinstance(last, Downloaded)
    assert steps and all(isinstance(step, DownloadProgress) for step in steps)
    return last


def nothing_there(folder: Path) -> bool:
    return not [path for path in folder.iterdir() if not path.name.startswith(".")]


def test_the_model_comes_out_of_its_archive(known: KnownModel, tmp_path: Path, onnx_bytes: bytes):
    got = finished(known, tmp_path)
    assert got.path == tmp_path / "dwpose-l.onnx" and got.path.read_bytes() == onnx_bytes and got.checked
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dwpose-l.json", "dwpose-l.onnx"]
    assert find_model("dwpose-l", tmp_path) == got.path
    assert [name for name in KNOWN_MODELS if is_here(name, tmp_path)] == ["dwpose-l"]


def test_a_file_that_is_no_archive(known: KnownModel, served: Served, tmp_path: Path, onnx_bytes: bytes):
    served.content = onnx_bytes
    assert finished(known, tmp_path).path.read_bytes() == onnx_bytes


@pytest.mark.parametrize("breaks_after", [0, 1, 10_000])
def test_a_download_that_breaks_off_goes_on(
    known: KnownModel, served: Served, tmp_path: Path, onnx_bytes: bytes, breaks_after: int
):
    served.breaks_after = breaks_after
    kept = f"The first {breaks_after / 1e3:g} kB have arrived; another attempt continues from there. "
    with pytest.raises(InputError, match="the connection broke off. " + kept * bool(breaks_after) + "Or download"):
        list(download(known, tmp_path))
    assert nothing_there(tmp_path)
    served.breaks_after = None
    assert finished(known, tmp_path).path.read_bytes() == onnx_bytes
    assert served.asked == ["", f"bytes={breaks_after}-" if breaks_after else ""]


def test_a_download_that_is_cancelled_goes_on(known: KnownModel, tmp_path: Path, onnx_bytes: bytes):
    events = download(known, tmp_path)
    next(events)
    next(events)
    events.close()
    assert nothing_there(tmp_path)
    assert finished(known, tmp_path).path.read_bytes() == onnx_bytes


@pytest.mark.parametrize(("name", "value"), [("tag", '"two"'), ("tag", None), ("ranges", False)])
def test_what_cannot_be_gone_on_with_begins_anew(
    known: KnownModel, served: Served, tmp_path: Path, onnx_bytes: bytes, name: str, value: object
):
    """Another version, a server that names none, and one that sends no part of a file."""
    served.breaks_after = 5000
    with pytest.raises(InputError):
        list(download(known, tmp_path))
    served.breaks_after = None
    setattr(served, name, value)
    assert finished(known, tmp_path).path.read_bytes() == onnx_bytes


def test_a_wrong_checksum_is_refused(known: KnownModel, served: Served, tmp_path: Path, onnx_bytes: bytes):
    wrong = replace(known, sha256="0" * 64)
    with pytest.raises(InputError, match=f"{hashlib.sha256(onnx_bytes).hexdigest()}; {'0' * 64} is known for it"):
        list(download(wrong, tmp_path))
    assert list(tmp_path.iterdir()) == []
    before = finished(known, tmp_path).path
    with pytest.raises(InputError):
        list(download(wrong, tmp_path))
    assert before.read_bytes() == onnx_bytes, "what was there stays"


def test_without_a_known_checksum_the_first_is_remembered(
    known: KnownModel, served: Served, tmp_path: Path, onnx_bytes: bytes
):
    unknown = replace(known, sha256="")
    first = finished(unknown, tmp_path)
    assert not first.checked and first.sha256 == hashlib.sha256(onnx_bytes).hexdigest()
    first.path.unlink()
    assert finished(unknown, tmp_path).checked
    other = brightest_model(tmp_path / "other.bin", size=(48, 64)).read_bytes()
    served.content = archive(("end2end.onnx", other))
    with pytest.raises(InputError, match="of its first download"):
        list(download(unknown, tmp_path))


def test_archives_that_are_none_of_a_model(known: KnownModel, served: Served, tmp_path: Path, onnx_bytes: bytes):
    unknown = replace(known, sha256="")
    whole = served.content
    cases = {
        "holds 0 ONNX files": archive(("readme.txt", b"hello")),
        "holds 2 ONNX files": archive(("a.onnx", onnx_bytes), ("b.onnx", onnx_bytes)),
        "cannot be opened as an ONNX model": archive(("a.onnx", b"hello")),
        "damaged archive": whole[:3000] + bytes(255 - byte for byte in whole[3000:3200]) + whole[3200:],
    }
    for words, content in cases.items():
        served.content = content
        with pytest.raises(InputError, match=words):
            list(download(unknown, tmp_path))
        assert list(tmp_path.iterdir()) == [], words


def test_names_in_archives_do_not_become_paths(known: KnownModel, served: Served, tmp_path: Path, onnx_bytes: bytes):
    served.content = archive(("../../evil/end2end.onnx", onnx_bytes))
    inner = tmp_path / "a" / "b"
    assert finished(known, inner).path == inner / "dwpose-l.onnx"
    assert sorted(p.name for p in tmp_path.rglob("*.onnx")) == ["dwpose-l.onnx"]


def test_servers_that_are_not_there_or_refuse(known: KnownModel, served: Served, tmp_path: Path):
    with pytest.raises(InputError, match=r"cannot be fetched: the server refuses the connection\. Or download it"):
        list(download(replace(known, url="http://127.0.0.1:9/model.zip"), tmp_path))
    served.status = 404
    with pytest.raises(InputError, match="answers 404"):
        list(download(known, tmp_path))
