"""Buttons of panels: what is not on show does nothing, nor do values that no button has: a strange page sends both."""

import itertools
import logging
from pathlib import Path

import pytest
import viser

from tcfit_app.review.browser.page_events import Drag, Press
from tcfit_app.review.panels import WITHOUT_KEYPOINTS
from tcfit_app.review.panels.elements import html
from tcfit_app.review.tab.buttons import LATE, Buttons, one_of
from tests.drivers.lone_page import LonePage, lone_page, sample_project
from tests.samples.media import write_images

NO_VALUES = ("x", "-1", "999999", "1.5", "nan", "inf", "1e308", "<b>", "é", "a b c", "")
"""Of buttons that have values, these have none; but a run or frame may have a strange number."""


def offering(*buttons: tuple[str, str]) -> str:
    return "".join(html.button("label", command, value) for command, value in buttons)


def test_presses_that_no_button_sends_are_one_line_in_the_log(caplog: pytest.LogCaptureFixture):
    caplog.set_level(logging.INFO)
    buttons, taken = Buttons(), []
    buttons.on("frame", taken.append, int)
    buttons.on("side", taken.append, one_of(("a", "b")))
    pressed = (("frame", "7"), ("frame", "x"), ("side", "c"), ("none", "7"), ("side", "b"))
    buttons.show("a board", offering(*pressed))
    for command, value in pressed:
        buttons.take(Press(command, value))
    assert taken == [7, "b"]
    assert [record.levelno for record in caplog.records] == [logging.INFO]
    assert not any(record.exc_info for record in caplog.records)


def test_what_a_button_does_is_not_hidden():
    buttons = Buttons()
    buttons.on("broken", lambda _: {}["missing"])
    buttons.show("a board", offering(("broken", "")))
    with pytest.raises(KeyError):
        buttons.take(Press("broken", ""))


def test_only_what_is_on_show_and_on_can_be_pressed(caplog: pytest.LogCaptureFixture):
    caplog.set_level(logging.INFO)
    buttons, taken = Buttons(), []
    for command in ("go", "stop", "row"):
        buttons.on(command, taken.append)
    buttons.take(Press("go", "1"))
    assert not taken and "not on show" in caplog.messages[-1]
    off = html.button("label", "stop", "1", disabled=True, hint="of the list")
    buttons.show("a board", html.joined(html.button("x", "go", '"1" disabled>', hint="disabled"), off))
    buttons.show("another", html.table([html.line("x", command="row", value="2"), html.line("no button")]))
    for command, value in (("go", '"1" disabled>'), ("stop", "1"), ("row", "2"), ("row", "3"), ("", "")):
        buttons.take(Press(command, value))
    assert taken == ['"1" disabled>', "2"]
    buttons.show("a board", "")
    buttons.take(Press("go", '"1" disabled>'))
    assert taken == ['"1" disabled>', "2"], "what is gone is gone at once"


def test_a_press_that_was_on_its_way_while_its_value_was_replaced_counts(monkeypatch: pytest.MonkeyPatch):
    buttons, taken, now = Buttons(), [], [100.0]
    monkeypatch.setattr("tcfit_app.review.tab.buttons.time.monotonic", lambda: now[0])
    buttons.on("delete", taken.append, int)
    for number in (1, 2):
        buttons.show("a board", offering(("delete", str(number))))
    buttons.take(Press("delete", "1"))
    now[0] += LATE
    buttons.take(Press("delete", "1"))
    buttons.take(Press("delete", "2"))
    assert taken == [1, 2]


@pytest.fixture
def panel_page(panel_server: viser.ViserServer, tmp_path: Path):
    with sample_project(tmp_path / "walk.tcfit", "first") as project, lone_page(panel_server, project) as made:
        for panel in WITHOUT_KEYPOINTS:
            if not any(isinstance(there, panel) for there in made.panels):
                panel(made.page.gestures)
        yield made


@pytest.mark.thorough
def test_no_panel_stumbles_over_a_strange_value(panel_page: LonePage, caplog: pytest.LogCaptureFixture):
    page = panel_page.page
    panel_page.draw()
    commands = list(page.tab.buttons._known)
    page.tab.buttons.show("a strange page", offering(*itertools.product(commands, NO_VALUES)))
    for command in commands:
        for value in NO_VALUES:
            page.tab.guarded(lambda command=command, value=value: page.receive(Press(command, value)))()
            page.tab.set(playing=True)
            page.tab.advance(1e9)
            panel_page.draw()
    assert not [record.getMessage() for record in caplog.records if record.exc_info]
    assert not [notice for notice in panel_page.notices if "went wrong" in notice.title]


def test_a_drag_beyond_the_clip_is_none(panel_page: LonePage):
    for frame in (panel_page.page.tab.length, 2**70):
        panel_page.page.receive(Drag("start", (1,), 0.0, 0.0, frame))
        assert not panel_page.page.gestures.correcting.dragging


def test_the_video_is_looked_for_elsewhere_only_while_it_is_missing(panel_page: LonePage, tmp_path: Path):
    tab = panel_page.page.tab
    folder = write_images(tmp_path / "images", *(f"{frame:03}.png" for frame in range(tab.length)))
    panel_page.enter("New location", str(folder))
    panel_page.press("review.relink")
    panel_page.settle()
    tab.data.video.problem_of = lambda frame: ""  # pyright: ignore[reportAttributeAccessIssue]
    panel_page.draw()
    linked = tab.session.project.media.path
    assert linked is not None and not tab.session.project.media.problem
    panel_page.enter("New location", str(Path(__file__)))
    panel_page.page.receive(Press("review.relink", ""))
    assert tab.session.project.media.path == linked
