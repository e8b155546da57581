"""Two people with the list of the same folder, and a review beside it, who ask for whatever there is: nothing breaks,
and what is said of a clip is on the disk. What they do in a review is played in tests/flows."""

import logging
import threading
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.connection import Connection

from fitting_core.body.model import BodyModel
from fitting_core.io.result_files import write_result
from tcfit_app.home.reviews import PATH
from tcfit_app.project.glance import glance
from tcfit_app.project.project import Project
from tests.drivers.raw_tab import RawTab, raw_tab
from tests.samples.project_samples import sample_clip
from tests.samples.waving import waving_fit
from tests.tcfit_app.conftest import FRAMES
from tests.tcfit_app.home.lists import folder_of_clips
from tests.tcfit_app.home.test_home import Served, received, send, served, until


@dataclass
class Person:
    """Somebody with the list, and at times a review, open."""

    lab: Served
    rng: np.random.Generator
    socket: Connection = field(init=False)
    """Of the list."""
    opened: ExitStack = field(default_factory=ExitStack)
    tab: RawTab | None = None

    def __post_init__(self) -> None:
        self.come()

    def come(self) -> None:
        """See the list, for the first time or once more; what it is sent is read, or it would be taken for gone."""
        self.socket = self.lab.socket()
        threading.Thread(target=_read, args=(self.socket,), daemon=True).start()

    def keys(self, most: int = 3) -> list[str]:
        known = [row.key for row in self.lab.home.catalogue.rows()]
        return [str(key) for key in self.rng.choice([*known, "0" * 12], size=int(self.rng.integers(1, most + 1)))]

    def close(self) -> None:
        self.tab = None
        with suppress(ConnectionClosed):
            self.opened.close()


def _read(socket: Connection) -> None:
    with suppress(ConnectionClosed):
        while True:
            socket.recv()


def _open(person: Person) -> None:
    """Go to a clip from the list, from another review too."""
    (key,) = person.keys(1)
    send(person.socket, type="open", key=key)
    person.close()
    clip = person.lab.home.catalogue.get(key)
    if clip is not None and clip.found.kind == "project":
        address, cookie = person.lab.server.address.url, person.lab.cookie
        person.tab = person.opened.enter_context(raw_tab(address, cookie, path=PATH + key))
        if person.rng.random() < 0.9:
            _greet(person.tab, f"raw {person.rng.integers(3)}")


def _greet(tab: RawTab, name: str) -> None:
    """As a page that has loaded; what it is shown comes when it comes."""
    until(lambda: tab.field is not None or tab.closed or _sent_away(tab))
    assert tab.field is not None, "the review was not opened"
    tab.emit({"type": "hello", "tab": name, "width": 960, "height": 640})


def _sent_away(tab: RawTab) -> bool:
    return any("location.replace" in message.get("source", "") for message in list(tab.messages))


def _say(person: Person) -> None:
    """Something of clips, in the list."""
    rng = person.rng
    message = [
        lambda: {"type": "approve", "keys": person.keys(), "approved": bool(rng.random() < 0.6)},
        lambda: {"type": "note", "key": person.keys(1)[0], "text": f"<i>{rng.integers(1000)}"},
        lambda: {"type": "look", "keys": person.keys(9)},
        lambda: {"type": "cancel", "keys": person.keys()},
        lambda: {"type": "formats"},
        lambda: {"type": "nothing"},
    ][int(rng.integers(6))]()
    send(person.socket, **message)


def _export(person: Person) -> None:
    send(person.socket, type="export", keys=person.keys(), formats=["joints"])


def _reload(person: Person) -> None:
    """The list."""
    person.socket.close()
    person.come()


DEEDS = [(0.27, _open), (0.67, _say), (0.02, _export), (0.04, _reload)]


def _let_loose(root: Path, body: BodyModel, actions: int, log: pytest.LogCaptureFixture) -> None:
    folder_of_clips(root, body)
    write_result(root / "result", waving_fit(0.0), sample_clip(FRAMES), body)
    rng, shares = np.random.default_rng(1), np.array([share for share, _ in DEEDS])
    with log.at_level(logging.WARNING), served(root) as lab:
        people = [Person(lab, rng) for _ in range(2)]
        for _ in range(actions):
            DEEDS[int(rng.choice(len(DEEDS), p=shares / shares.sum()))][1](people[int(rng.integers(2))])
        for person in people:
            person.close()
            person.socket.close()
        with lab.socket() as socket:
            _still_answers(lab, socket)
    loud = [record for record in log.records if record.levelno >= logging.ERROR]
    assert not loud, loud
    for folder in (folder for folder in root.rglob("*.tcfit") if folder.is_dir()):
        with Project.open(folder) as project:
            assert not project.damage
            assert [entry.id for entry in project.log] == list(range(1, len(project.log) + 1))


def _still_answers(lab: Served, socket: Connection) -> None:
    """What is said last stands, however much was asked for before."""
    folder = lab.home.catalogue.root / "set" / "b fitted.tcfit"
    send(socket, type="note", key=lab.key("set/b fitted.tcfit"), text="the last word")
    until(lambda: glance(folder).review.note == "the last word")
    send(socket, type="formats")
    assert received(socket, "formats")["groups"]


@pytest.mark.slow
def test_300_random_actions(free_body: BodyModel, tmp_path: Path, caplog: pytest.LogCaptureFixture):
    _let_loose(tmp_path / "lab", free_body, 300, caplog)
