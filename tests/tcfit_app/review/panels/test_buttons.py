"""Buttons of panels: what is not on show does nothing: a strange page sends anything."""

import logging
from functools import partial
from pathlib import Path

import pytest
import viser

from tcfit_app.review.browser.page_events import Drag, Press
from tcfit_app.review.panels.elements import html
from tcfit_app.review.tab.buttons import LATE, Buttons
from tests.drivers.lone_page import LonePage, lone_page, sample_project
from tests.samples.media import write_images


def test_only_what_is_on_show_and_on_can_be_pressed(caplog: pytest.LogCaptureFixture):
    caplog.set_level(logging.INFO)
    buttons, taken = Buttons(), []

    def made(command: str, value: str = "", *, disabled: bool = False) -> html.Html:
        return html.button("label", command, value, do=lambda: taken.append((command, value)), disabled=disabled)

    row = html.opener("label", "row", "2", lambda: taken.append(("row", "2")))
    shown = html.joined(made("go", '"1" disabled>'), made("stop", "1", disabled=True))
    buttons.show("a board", html.tag("div", html.row(shown)).presses)
    buttons.show("another", html.table([html.line(row, press=row), html.line("no button")]).presses)
    for command, value in (("go", '"1" disabled>'), ("stop", "1"), ("row", "2"), ("row", "3"), ("none", "7"), ("", "")):
        buttons.take(Press(command, value))
    assert taken == [("go", '"1" disabled>'), ("row", "2")]
    buttons.show("a board", {})
    buttons.take(Press("go", '"1" disabled>'))
    assert len(taken) == 2, "what is gone is gone at once"
    assert [record.levelno for record in caplog.records] == [logging.INFO], "one line for all that was dropped"


def test_only_lines_of_a_menu_that_are_on_can_be_chosen():
    buttons, taken = Buttons(), []

    def item(label: str, *, obstacle: str = "", more: tuple[html.Item, ...] = ()) -> html.Item:
        return html.Item(label=label, do=lambda: taken.append(label), obstacle=obstacle, more=more)

    lines = (item('"Left" & right'), None, item("Off", obstacle="no fit"), item("Hand", more=(item("Fist"),)))
    buttons.show("a board", html.menu_button("More ▾", "more", lines).presses)
    for value in ('"Left" & right', "Off", "Hand", "Hand/Fist", ""):
        buttons.take(Press("more", value))
    assert taken == ['"Left" & right', "Fist"]


def test_what_a_button_does_is_not_hidden():
    buttons = Buttons()
    buttons.show("a board", html.button("label", "broken", do=lambda: {}["missing"]).presses)
    with pytest.raises(KeyError):
        buttons.take(Press("broken", ""))


def test_a_press_that_was_on_its_way_while_its_value_was_replaced_counts(monkeypatch: pytest.MonkeyPatch):
    buttons, taken, now = Buttons(), [], [100.0]
    monkeypatch.setattr("tcfit_app.review.tab.buttons.time.monotonic", lambda: now[0])
    for number in ("1", "2"):
        buttons.show("a board", html.button("x", "delete", number, do=partial(taken.append, number)).presses)
    buttons.take(Press("delete", "1"))
    now[0] += LATE
    buttons.take(Press("delete", "1"))
    buttons.take(Press("delete", "2"))
    assert taken == ["1", "2"]


@pytest.fixture
def tested(panel_server: viser.ViserServer, tmp_path: Path):
    with sample_project(tmp_path / "walk.tcfit", "first") as project, lone_page(panel_server, project) as made:
        yield made


def test_a_drag_beyond_the_clip_is_none(tested: LonePage):
    for frame in (tested.page.tab.length, 2**70):
        tested.page.receive(Drag("start", (1,), 0.0, 0.0, frame))
        assert not tested.page.gestures.correcting.dragging


def test_the_video_is_looked_for_elsewhere_only_while_it_is_missing(tested: LonePage, tmp_path: Path):
    tab = tested.page.tab
    folder = write_images(tmp_path / "images", *(f"{frame:03}.png" for frame in range(tab.length)))
    tested.enter("New location", str(folder))
    tested.press("review.relink")
    tested.settle()
    tab.data.video.problem_of = lambda frame: ""  # pyright: ignore[reportAttributeAccessIssue]
    tested.draw()
    linked = tab.session.project.media.path
    assert linked is not None and not tab.session.project.media.problem
    tested.enter("New location", str(Path(__file__)))
    tested.page.receive(Press("review.relink", ""))
    assert tab.session.project.media.path == linked
