"""The list behind the gate, without a browser: what it sends, what it takes, and whom it refuses."""

import base64
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from tcfit_app.cli.review_command import _of_result, is_list, run_review
from tcfit_app.home.home import SOCKET, Home
from tcfit_app.home.reviews import PATH
from tcfit_app.options.fit import ReviewOptions
from tcfit_app.project.glance import glance
from tcfit_app.project.project import Project
from tcfit_app.review.browser.channel import web_files
from tcfit_app.server.gate import Entry
from tcfit_app.server.serving import ReviewServer, review_server
from tests.drivers.raw_tab import admitted, fetched, raw_tab
from tests.drivers.waiting import until
from tests.samples.media import write_video
from tests.tcfit_app.conftest import FinishedRun
from tests.tcfit_app.home.lists import folder_of_clips

PATIENCE = 60.0


@dataclass
class Served:
    """A list that is served."""

    home: Home
    server: ReviewServer
    cookie: str

    def get(self, path: str, cookie: str | None = None, **headers: str) -> tuple[int, str]:
        cookie = self.cookie if cookie is None else cookie
        answer = fetched(self.server.address.url + path, Cookie=cookie, **headers)
        return answer.status, answer.headers.get("Location") or answer.body

    def socket(self, path: str = SOCKET, cookie: str | None = None, origin: str | None = None) -> Connection:
        address = self.server.address.url
        return connect(
            address.replace("http", "ws", 1) + path,
            origin=origin or address,  # pyright: ignore[reportArgumentType]
            additional_headers={"Cookie": self.cookie if cookie is None else cookie},
            max_size=None,
            proxy=None,
            close_timeout=1,
        )

    def key(self, name: str) -> str:
        return next(row.key for row in self.home.catalogue.rows() if row.name == name or row.place == name)


@contextmanager
def served(root: Path, **options: Any) -> Iterator[Served]:
    home = Home(root)
    with review_server(
        root.name, port=0, open_browser=False, scripts=web_files(), say=lambda text: None, site=home, **options
    ) as server:
        thread = threading.Thread(target=home.run, args=(server,))
        thread.start()
        try:
            until(lambda: home.catalogue.rows())
            yield Served(home, server, admitted(server.gate.link))
        finally:
            home.stop()
            thread.join(PATIENCE)
            home.close()


def received(socket: Connection, kind: str, so: Callable[[dict[str, Any]], Any] = lambda message: True) -> Any:
    """The next message of a kind of which something is so."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        message = msgspec.json.decode(socket.recv(timeout=PATIENCE))
        if message["type"] == kind and so(message):
            return message
    raise AssertionError(f"no {kind}")


def send(socket: Connection, **message: object) -> None:
    socket.send(msgspec.json.encode(message).decode())


def is_open(lab: Served, key: str) -> bool:
    with lab.home.reviews.writing(key) as project:
        return project is not None


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory, free_body: BodyModel) -> Iterator[Served]:
    with served(folder_of_clips(tmp_path_factory.mktemp("lab") / "<corpus>", free_body)) as running:
        yield running


def test_the_page_its_scripts_and_its_clips_are_for_browsers_that_were_let_in(lab: Served):
    key = lab.key("a new.tcfit")
    for path in ("/", f"{PATH}{key}", "/tcfit/home/list.js"):
        assert lab.get(path)[0] == 200
        assert lab.get(path, cookie="")[0] == 403
    assert "<title>tcfit: &lt;corpus&gt;</title>" in lab.get("/")[1], "names are no HTML"
    assert "viser" in lab.get(f"{PATH}{key}")[1].lower()
    for path in (f"{PATH}000000000000", f"{PATH}..%2f..", "/clip", "/list", f"{PATH}{key}/x"):
        assert lab.get(path)[0] == 404
    assert lab.get(f"{PATH}{key}?websocket=ws://example.org") == (303, f"{PATH}{key}")
    assert lab.get(f"{PATH}{key}?frame=8&run=1&phase=3")[0] == 200


def test_the_websocket_is_for_the_lists_own_page(lab: Served):
    for options in ({"cookie": ""}, {"origin": "http://example.org"}):
        with pytest.raises(InvalidStatus):
            lab.socket(**options)
    with pytest.raises(InvalidStatus):
        lab.socket("/")
    with pytest.raises(InvalidStatus):
        lab.socket(f"{PATH}000000000000")


def test_rows_pictures_approvals_and_notes(lab: Served):
    with lab.socket() as one, lab.socket() as other:
        first = received(one, "rows")
        assert first["whole"] and len(first["rows"]) == 4
        received(other, "rows")
        key = lab.key("set/b fitted.tcfit")
        send(one, type="look", keys=[key])
        assert received(one, "picture")["key"] == key
        send(one, type="approve", keys=[key], approved=True)
        for page in (one, other):
            row = received(page, "rows", lambda m: m["rows"])["rows"][0]
            assert (row["key"], row["state"]) == (key, "approved") and row["reviewer"]
        send(one, type="note", key=key, text="left hand hidden")
        assert received(other, "rows", lambda m: m["rows"])["rows"][0]["note"] == "left hand hidden"
        send(one, type="approve", keys=[key], approved=False)
        assert received(other, "rows", lambda m: m["rows"])["rows"][0]["state"] == "fitted"
        send(one, type="approve", keys=[lab.key("a new.tcfit")], approved=True)
        assert "has no fit yet" in received(one, "refusal")["text"]


@pytest.mark.parametrize(
    "message",
    [
        "{",
        '{"type": "open"}',
        '{"type": "open", "key": "../../etc"}',
        '{"type": "delete", "key": "000000000000"}',
        '{"type": "note", "key": "000000000000", "text": "%s"}' % ("x" * 501),
        '{"type": "export", "keys": [], "formats": ["glb"], "axes": "sideways"}',
    ],
    ids=["no JSON", "no key", "a path", "unknown", "long", "no axes"],
)
def test_what_no_page_sends_is_dropped_and_the_page_goes_on(message: str, lab: Served):
    with lab.socket() as page:
        received(page, "rows")
        page.send(message)
        send(page, type="open", key="000000000000")
        assert "no longer there" in received(page, "refusal")["text"]


def test_a_project_that_somebody_else_has_open_is_not_changed(lab: Served):
    key, folder = lab.key("set/b fitted.tcfit"), lab.home.catalogue.root / "set" / "b fitted.tcfit"
    with Project.open(folder) as project, lab.socket() as page:
        project.tell_who_works("carla")
        received(page, "rows", lambda m: any(row.get("busy") == "carla" for row in m["rows"]))
        send(page, type="note", key=key, text="overwritten")
        assert "open in another tcfit" in received(page, "refusal")["text"]
    assert glance(folder).review.note != "overwritten"


def test_all_videos_that_cannot_be_read_are_named(tmp_path: Path):
    names = [f"{name}.mp4" for name in ("cut", "empty", "text")]
    for name in names:
        (tmp_path / name).write_text("no video")
    with served(tmp_path) as lab, lab.socket() as socket:
        send(socket, type="fit", keys=[lab.key(name) for name in names])
        told = received(socket, "refusal")["text"].splitlines()
        assert [next(name for name in names if name in line) for line in told] == names


def test_a_review_is_open_while_somebody_looks_and_closed_after(lab: Served, monkeypatch: pytest.MonkeyPatch):
    key, folder = lab.key("set/c reviewed.tcfit"), lab.home.catalogue.root / "set" / "c reviewed.tcfit"
    with lab.socket() as page:
        send(page, type="open", key=key)
        assert received(page, "opened")["key"] == key
        assert is_open(lab, key)
        send(page, type="note", key=key, text="said while it is open")
        received(page, "rows", lambda m: any(row.get("note") == "said while it is open" for row in m["rows"]))
    monkeypatch.setattr("tcfit_app.home.reviews.GRACE", 0.0)
    lab.home.reviews.tidy()
    assert not is_open(lab, key)
    Project.open(folder).close()


def test_a_tab_keeps_a_review_open_that_is_released_as_it_comes(lab: Served, monkeypatch: pytest.MonkeyPatch):
    key, reviews = lab.key("set/c reviewed.tcfit"), lab.home.reviews
    open_review, released = reviews.open, list[bool]()

    def open_and_be_released(key: str) -> Any:
        review = open_review(key)
        other = threading.Thread(target=lambda: released.append(reviews.release(key)))  # as the job queue does
        other.start()
        other.join(1.0)
        return review

    monkeypatch.setattr(reviews, "open", open_and_be_released)
    with raw_tab(lab.server.address.url, lab.cookie, path=f"{PATH}{key}"):
        until(lambda: released)
        assert released == [False] and is_open(lab, key) and reviews.viewers(key)
    until(lambda: not reviews.viewers(key))


def test_an_unforeseen_error_ends_neither_the_list_nor_its_pictures(lab: Served, monkeypatch: pytest.MonkeyPatch):
    def fail(*_: object) -> None:
        raise ZeroDivisionError("unforeseen")

    key = lab.key("set/b fitted.tcfit")
    with lab.socket() as page:
        received(page, "rows")
        with monkeypatch.context() as broken:
            broken.setattr(lab.home.catalogue, "refresh", fail)
            broken.setattr("tcfit_app.home.home.picture_of", fail)
            send(page, type="look", keys=[key])
            assert received(page, "picture")["data"] == ""
            lab.home._wake.set()
            until(lambda: not lab.home._wake.is_set())
        send(page, type="look", keys=[key])
        assert received(page, "picture")["data"]
        lab.home._wake.set()
        until(lambda: not lab.home._wake.is_set())


def test_a_result_becomes_a_project_and_is_opened(tmp_path: Path, finished: FinishedRun):
    root = tmp_path / "corpus"
    folder = Path(shutil.copytree(finished.folder, root / "wave"))
    with served(root) as lab, lab.socket() as page:
        key = lab.key("wave")
        send(page, type="open", key=key)
        opened = received(page, "opened")["key"]
        assert [row.kind for row in lab.home.catalogue.rows()] == ["project"] and opened == lab.key("wave.tcfit")
        assert glance(root / "wave.tcfit").state == "fitted" and is_open(lab, opened)
        send(page, type="open", key=key)
        assert "no longer there" in received(page, "refusal")["text"]
    assert _of_result(folder) == root / "wave.tcfit", "which is there already"
    assert not is_list(ReviewOptions(video=root / "wave.tcfit"))


def test_clips_of_one_name_each_have_a_project(tmp_path: Path, finished: FinishedRun):
    """Two videos and a result of a third one."""
    root = tmp_path / "corpus"
    folder = Path(shutil.copytree(finished.folder, root / "walk"))
    other = write_video(tmp_path / "other.mp4", frames=6)
    summary = msgspec.json.decode((folder / "summary.json").read_bytes())
    (folder / "summary.json").write_bytes(msgspec.json.encode({**summary, "video": "../../other.mp4"}))
    for suffix in (".mov", ".mp4"):
        shutil.copyfile(other, root / f"walk{suffix}")
    with served(root) as lab, lab.socket() as page:
        for name, project in (("walk.mov", "walk.tcfit"), ("walk.mp4", "walk.mp4.tcfit"), ("walk", "walk-2.tcfit")):
            send(page, type="open", key=next(row.key for row in lab.home.catalogue.rows() if row.place == name))
            assert received(page, "opened")["key"] == lab.key(project)
        assert sorted(row.place for row in lab.home.catalogue.rows()) == [
            "walk-2.tcfit",
            "walk.mp4.tcfit",
            "walk.tcfit",
        ]
        for project, video in (("walk.tcfit", "walk.mov"), ("walk.mp4.tcfit", "walk.mp4")):
            assert glance(root / project).media[0] == root / video
    assert _of_result(folder) == root / "walk-2.tcfit"


def test_clips_are_exported_in_the_background(lab: Served):
    root = lab.home.catalogue.root
    with lab.socket() as page:
        send(page, type="formats")
        assert "joints" in [choice["value"] for choice in received(page, "formats")["groups"]["Python"]]
        new, fitted = lab.key("a new.tcfit"), lab.key("set/d approved.tcfit")
        send(page, type="export", keys=[new, fitted], formats=["joints"])
        ends: dict[str, Any] = {}
        while len(ends) < 2:
            rows = received(page, "rows", lambda m: m["rows"])["rows"]
            ends |= {row["key"]: row["work"] for row in rows if row.get("work", {}).get("ended")}
        assert ends[fitted]["ended"] == "done" and "d approved.exports" in ends[fitted]["step"]
        assert ends[new]["ended"] == "failed" and "no fit to export" in ends[new]["step"]
        assert [path.suffix for path in (root / "set" / "d approved.exports").iterdir()] == [".csv"]
        send(page, type="cancel", keys=[new, fitted])
        received(page, "rows", lambda m: any(row["key"] == fitted and "work" not in row for row in m["rows"]))


def test_those_who_signed_in_are_named(tmp_path: Path, free_body: BodyModel):
    root = folder_of_clips(tmp_path / "corpus", free_body)
    with served(root, entry=Entry(password="a long password")) as lab:
        code = base64.b64encode(b"dora:a long password").decode()
        asked = PATH + lab.key("a new.tcfit")
        answer = fetched(lab.server.address.url + asked, Authorization=f"Basic {code}")
        assert f"url={asked}" in answer.body, "to where it was asked for"
        cookie = answer.headers["Set-Cookie"].partition(";")[0]
        with lab.socket(cookie=cookie) as page:
            received(page, "rows")
            send(page, type="approve", keys=[lab.key("set/b fitted.tcfit")], approved=True)
            assert received(page, "rows", lambda m: m["rows"])["rows"][0]["reviewer"] == "dora"


def test_which_folders_are_lists(tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture[str]):
    root = folder_of_clips(tmp_path / "corpus", free_body)
    assert is_list(ReviewOptions(video=root))
    (tmp_path / "empty").mkdir()
    assert is_list(ReviewOptions(video=tmp_path / "empty")), "its page says how to add a clip"
    assert not is_list(ReviewOptions(video=root / "a new.tcfit"))
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "0.png").write_bytes(b"x")
    assert not is_list(ReviewOptions(video=tmp_path / "frames"))
    with pytest.raises(InputError, match="--fit is for one"):
        run_review(ReviewOptions(video=root, fit=True))
