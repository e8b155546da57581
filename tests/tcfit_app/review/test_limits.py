"""What a page can make the app keep has an end."""

import os
import threading
import time
from pathlib import Path
from unittest.mock import MagicMock

import pytest
import viser

from fitting_core.body.model import BodyModel
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.reports import Notice
from tcfit_app.review import app as review_app
from tcfit_app.review.app import ReviewApp
from tcfit_app.review.browser.page_events import Hello
from tcfit_app.review.panels.review_panel import ReviewPanel
from tcfit_app.review.session.session import Session
from tcfit_app.review.tab.tab import REMEMBERED, Tab
from tests.drivers.lone_page import LonePage, sample_project, tiny_page


def test_tabs_that_were_closed_are_forgotten_in_the_end(sample_page: LonePage):
    page, remembered = sample_page.page, sample_page.page.tab._remembered

    def greet(name: str) -> None:
        page.receive(Hello(tab=name, width=960, height=640))

    greet("an old one that is still there")
    page.tab.set(frame=3)
    for i in range(2 * REMEMBERED):
        greet(f"forged {i}")
        if i % 100 == 0:
            greet("an old one that is still there")
            assert [*remembered][-1] == "an old one that is still there"
    assert len(remembered) == REMEMBERED
    assert "an old one that is still there" in remembered and "forged 0" not in remembered


def test_a_key_that_is_refused_again_and_again_shows_one_notice(sample_page: LonePage):
    sample_page.page.tab.client = client = MagicMock()
    for title in ("Undo", "Undo", "Redo"):
        Tab.notify(sample_page.page.tab, Notice(title=f"{title}: not possible", text="", kind="error"))
    assert client.add_notification.call_count == 2


def test_what_pages_ask_for_waits_only_so_long(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(review_app, "MOST_COMMANDS", 10)
    done: list[int] = []
    with sample_project(tmp_path / "walk.tcfit") as project:
        app = ReviewApp(Session(project, Bodies()), MagicMock())
        for i in range(30):
            app._take(lambda i=i: done.append(i))
        app.post(lambda: done.append(-1))
        app._obey(0.0)
        app.close()
    assert done == [*range(10), -1], "and what the app itself asks for is done"


def test_drawing_an_unchanged_page_asks_the_file_system_for_nothing(
    panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    """It was drawn with 126 stats, 60 times a second for each tab."""
    with tiny_page(panel_server, tmp_path / "walk.tcfit", tiny_body, ReviewPanel) as tested:
        tested.fit()
        tested.page.receive(Hello("me", 1000, 700))
        tested.settle()
        tested.page.draw(time.monotonic())
        asked, usual, mine = [], os.stat, threading.get_ident()

        def stat(path: object, *given: object, **named: object) -> object:
            if threading.get_ident() == mine:
                asked.append(path)
            return usual(path, *given, **named)  # pyright: ignore[reportArgumentType, reportCallIssue]

        monkeypatch.setattr(os, "stat", stat)
        tested.page.draw(time.monotonic())  # panels rest for ten times as long as they took
        monkeypatch.undo()
    assert not asked
