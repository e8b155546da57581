"""Clients that send what no page sends, while others work: nobody notices."""

import gc
import logging
import os
import shutil
import statistics
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tcfit_app.fitting.bodies import Bodies
from tcfit_app.project.project import Project
from tcfit_app.review.app import ReviewApp
from tcfit_app.review.browser.channel import web_files
from tcfit_app.review.session.session import Session
from tcfit_app.server.serving import ReviewServer, review_server
from tcfit_app.server.viser_bridge import let_tabs_leave
from tests.drivers.raw_tab import admitted, raw_tab
from tests.drivers.waiting import until
from tests.tcfit_app.hostile.forged_messages import FORGED, KINDS

pytestmark = pytest.mark.thorough

CLIENTS = 3
ROOM = 50 << 20
"""Bytes by which the server may have grown."""


@dataclass(frozen=True)
class Review:
    """A review without a browser."""

    app: ReviewApp
    server: ReviewServer
    cookie: str
    thread: threading.Thread

    def attacked(self, messages: int, meanwhile: Callable[[], None]) -> None:
        """Let hostile clients loose, each in a process of its own, and do something again and again meanwhile."""
        command = [sys.executable, "-m", "tests.tcfit_app.hostile.forged_messages"]
        given = [self.server.address.url, self.cookie]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        clients = [
            subprocess.Popen(
                [*command, *given, str(seed), str(messages // CLIENTS)], env=environment, stderr=subprocess.PIPE
            )
            for seed in range(CLIENTS)
        ]
        try:
            while any(client.poll() is None for client in clients):
                meanwhile()
                time.sleep(0.05)
        finally:
            for client in clients:
                client.kill()
        for client in clients:
            told = client.communicate()[1].decode()
            assert client.returncode == 0, told


@pytest.fixture(scope="module")
def review(demo_project: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Review]:
    folder = Path(shutil.copytree(demo_project, tmp_path_factory.mktemp("fuzzed") / "demo.tcfit"))
    server = review_server("test", port=0, open_browser=False, scripts=web_files(), say=lambda text: None)
    with Project.open(folder) as project, server as running:
        app = ReviewApp(Session(project, Bodies()), running.viser)
        thread = threading.Thread(target=app.run)
        thread.start()
        try:
            yield Review(app=app, server=running, cookie=admitted(running.gate.link), thread=thread)
        finally:
            app.stop()
            thread.join(30)
            app.close()


def memory() -> int:
    """Bytes of this process."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def seen_by_a_new_tab(review: Review) -> list[str]:
    """What a tab gets to see that opens now, in words that compare; nothing of it was forged."""
    with raw_tab(review.server.address.url, review.cookie) as tab:
        tab.open(f"tab {time.monotonic()}")
        tab.seek(3)
        tab.rest()
        assert FORGED not in repr(tab.messages)
        kinds = {message["type"] for message in tab.messages}
        return sorted(kinds)


def endure(review: Review, messages: int, log: pytest.LogCaptureFixture, capture: pytest.CaptureFixture[str]) -> None:
    """Let hostile clients send that many messages, and look at everything."""
    before, project = seen_by_a_new_tab(review), review.app.session.project
    edits = project.last_edit
    waits: list[float] = []
    with (
        log.at_level(logging.INFO),
        warnings.catch_warnings(record=True) as warned,
        raw_tab(review.server.address.url, review.cookie) as honest,
    ):
        warnings.simplefilter("always")
        let_tabs_leave()
        honest.open("honest")
        until(lambda: len(review.app.pages) <= 1, "the other tabs' end")
        for frame in range(1, review.app.data.length):
            honest.seek(frame)  # what is made for it stays

        def work() -> None:
            frame = len(waits) % 9
            waits.append(honest.seek(2 * frame + 2))

        review.attacked(messages // 5, work)  # the first ones load modules, and heaps become as large as they stay
        until(lambda: len(review.app.pages) <= 1, "the other tabs' end")
        size = memory()
        review.attacked(messages, work)
        until(lambda: len(review.app.pages) <= 1, "the other tabs' end")
        honest.seek(1)
        assert FORGED not in repr(honest.messages)
        honest.messages.clear()  # its own, not the server's
        grown = memory() - size
    assert seen_by_a_new_tab(review) == before
    assert project.last_edit == edits and review.thread.is_alive()
    said = capture.readouterr()
    loud = [record for record in log.records if record.levelno > logging.INFO]
    assert not loud, "\n".join(map(logging.Formatter().format, loud[:3]))
    assert not said.err and not said.out, (said.err + said.out)[:3000]
    assert not warned, {f"{w.filename}:{w.lineno} {w.message}" for w in warned}
    noted = [record.getMessage() for record in log.records if "Dropped" in record.getMessage()]
    assert noted and not any("\x1b" in text or len(text) > 500 for text in noted)
    print(f"{len(waits)} answers, median {statistics.median(waits):.3f} s, grown by {grown / 2**20:.1f} MB")
    assert statistics.median(waits) < 0.3
    assert grown < ROOM


def test_the_protocol_is_known():
    assert len(KINDS) > 80


needs_proc = pytest.mark.skipif(
    not Path("/proc/self/statm").exists(), reason="this system does not say how large a process is"
)


@needs_proc
def test_hundreds_of_forged_messages(
    review: Review, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
):
    endure(review, 750, caplog, capfd)


@needs_proc
@pytest.mark.slow
def test_20000_forged_messages(review: Review, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]):
    endure(review, 20_000, caplog, capfd)
