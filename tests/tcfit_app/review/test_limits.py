"""What a page can make the app keep has an end, and what an edit costs the drawing thread has one too."""

import os
import threading
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.keypoints import INDEX
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.reports import Notice
from tcfit_app.project.edits.kinds import DetectAgain, Lock, MarkBad, Pin, SetDepth, SwapSides
from tcfit_app.project.project import Project
from tcfit_app.review import app as review_app
from tcfit_app.review.app import ReviewApp
from tcfit_app.review.browser.page_events import Drag, Hello
from tcfit_app.review.panels.review_panel import ReviewPanel
from tcfit_app.review.session.session import Session
from tcfit_app.review.tab.tab import REMEMBERED, Tab
from tests.drivers.lone_page import LonePage, lone_page, sample_project, tiny_page
from tests.samples.project_samples import BODY, CONFIG, sample_clip, sample_fit
from tests.samples.sessions import OneBody


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


# --- long clips ---


WRIST, FRAME = INDEX["right_wrist"], 60
SHORT, LONG = 200, 8000
"""Frames."""


def clip_of(frames: int) -> Clip:
    clip = sample_clip(frames)
    there = np.full(clip.keypoints.confidence.shape, 0.9)
    return replace(clip, keypoints=replace(clip.keypoints, confidence=there))


def drag(page: LonePage) -> None:
    for phase, dx in (("start", 0.0), ("move", 5.0), ("end", 9.0)):
        page.page.receive(Drag(phase, (WRIST,), dx, 0.0, FRAME))  # pyright: ignore[reportArgumentType]


def detect_again(page: LonePage) -> None:
    points = np.full((1, 137, 3), 0.5)
    page.page.gestures.correcting.make(DetectAgain.found((FRAME,), "right_hand", points))


HERE = {"frames": (FRAME,), "joints": (WRIST,)}
DEEDS: dict[str, Callable[[LonePage], None]] = {
    "nudge": lambda page: page.page.gestures.correcting.nudge(1.0, 0.0),
    "drag": drag,
    "mark bad": lambda page: page.page.gestures.correcting.make(MarkBad(**HERE)),
    "swap": lambda page: page.page.gestures.correcting.make(SwapSides(frames=(FRAME,), joints=(4, 7))),
    "depth": lambda page: page.page.gestures.correcting.make(SetDepth(**HERE, depth=((0.1,),))),
    "pin": lambda page: page.page.gestures.correcting.make(Pin(**HERE, xy=((1.0, 2.0),), depth=((0.1,),))),
    "lock": lambda page: page.page.gestures.correcting.make(Lock(**HERE, turn=((0.1, 0.2, 0.3),))),
    "detect again": detect_again,
    "undo": lambda page: page.page.gestures.correcting.undo(),
    "redo": lambda page: page.page.gestures.correcting.redo(),
}


def taken(page: LonePage, deed: Callable[[LonePage], None]) -> int:
    """The most memory in bytes that an edit and the drawing after it take at once: a copy of the clip would show."""
    page.page._next_panels = 0.0  # also menus and panels, which rest at other times
    page.page.draw(time.monotonic())
    tracemalloc.start()
    try:
        deed(page)
        page.page._next_panels = 0.0
        page.page.draw(time.monotonic())
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def costs(folder: Path, frames: int, server: viser.ViserServer) -> dict[str, int]:
    with Project.create(folder, clip_of(frames)) as project:
        run = project.runs.start(CONFIG, body=BODY, edits_seen=0)
        project.runs.finish(run.id, sample_fit(1, frames=frames))
        with lone_page(server, project, bodies=OneBody(None)) as page:
            page.page.receive(Hello(tab="a", browser="b", dark=False, width=1000, height=700, hinted=True))
            tab = page.page.tab
            tab.session.edit_follower.after_edits = False
            page.html()
            tab.set(frame=FRAME, selection=(WRIST,), plots=())
            for deed in DEEDS.values():  # once for what is made at first
                taken(page, deed)
            return {name: taken(page, deed) for name, deed in DEEDS.items()}


@pytest.mark.thorough
def test_an_edit_and_the_drawing_after_it_take_no_more_in_a_long_clip(tmp_path: Path, panel_server: viser.ViserServer):
    short, long = (costs(tmp_path / str(frames), frames, panel_server) for frames in (SHORT, LONG))
    # One byte for each keypoint of the longer clip would be a megabyte more.
    grown = {name: long[name] - short[name] for name in DEEDS}
    assert max(grown.values()) < 200_000, grown
