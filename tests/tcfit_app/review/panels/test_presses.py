"""Buttons of panels: values that no button has, as only a strange page sends them."""

import logging
from pathlib import Path

import pytest
import viser

from tcfit_app.review.browser.page_events import Drag, Press
from tcfit_app.review.panels import WITHOUT_KEYPOINTS
from tcfit_app.review.presses import Presses, one_of
from tests.drivers.lone_page import LonePage, lone_page, sample_project

_NO_VALUES = ("x", "-1", "999999", "1.5", "nan", "inf", "1e308", "<b>", "é", "a b c", "")
"""Of buttons that have values, these have none; but a run or frame may have a strange number."""


def test_a_press_that_no_button_sends_is_one_line_in_the_log(caplog: pytest.LogCaptureFixture):
    presses, taken = Presses(), []
    presses.on("frame", taken.append, int)
    presses.on("side", taken.append, one_of(("a", "b")))
    for command, value in (("frame", "7"), ("frame", "x"), ("side", "c"), ("none", "7"), ("side", "b")):
        presses.take(Press(command, value))
    assert taken == [7, "b"]
    assert [record.levelno for record in caplog.records] == 3 * [logging.WARNING]
    assert not any(record.exc_info for record in caplog.records)


def test_what_a_button_does_is_not_hidden():
    presses = Presses()
    presses.on("broken", lambda _: {}["missing"])
    with pytest.raises(KeyError):
        presses.take(Press("broken", ""))


@pytest.fixture
def panel_page(panel_server: viser.ViserServer, tmp_path: Path):
    with sample_project(tmp_path / "walk.tcfit", "first") as project, lone_page(panel_server, project) as made:
        for panel in WITHOUT_KEYPOINTS:
            if not any(isinstance(there, panel) for there in made.panels):
                panel(made.page)
        yield made


def test_no_panel_stumbles_over_a_strange_value(panel_page: LonePage, caplog: pytest.LogCaptureFixture):
    page = panel_page.page
    panel_page.draw()
    for command in page._presses._known:
        for value in _NO_VALUES:
            page._guarded(lambda command=command, value=value: page.receive(Press(command, value)))()
            page.set(playing=True)
            page._advance(1e9)
            panel_page.draw()
    assert not [record.getMessage() for record in caplog.records if record.exc_info]
    assert not [notice for notice in panel_page.notices if "went wrong" in notice.title]


def test_a_drag_beyond_the_clip_is_none(panel_page: LonePage):
    for frame in (panel_page.page.length, 2**70):
        panel_page.page.receive(Drag("start", (1,), 0.0, 0.0, frame))
        assert not panel_page.page.correcting.dragging
