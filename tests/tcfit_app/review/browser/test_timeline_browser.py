"""The timeline in viser's page, in a real browser: its rows, lanes, ruler and overview, and its menus."""

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec import structs

from tcfit_app.review.browser import page_states as states
from tcfit_app.review.browser.channel import web_files
from tcfit_app.review.browser.page_events import Key, LookAt, MoveKey, Plot, Range, Seek
from tcfit_app.review.drawing.rows import CHOICES
from tcfit_app.server.serving import ReviewServer, review_server
from tests.drivers.page_tab import BAR, KEYS, LENGTH, POSTER, RECORD, ROWS, TABS, TIMELINE, Tab, open_tab, strip_place
from tests.drivers.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough

RULER = 9.0
"""Its middle, in pixels below the strip's upper border."""
LANES = {name: 13 + 15 * (i + 0.5) for i, name in enumerate(("notes", "flags", "suspicion", "keys", "edits"))}
"""Their middles, in pixels above the strip's lower border."""
COUNT_MADE = """() => {
  window.made = 0;
  const count = (changes) => (window.made += changes.length);
  new MutationObserver(count).observe(document.body, { childList: true, subtree: true });
}"""
"""Count the changes of elements from now on."""


@pytest.fixture(scope="module")
def server() -> Iterator[ReviewServer]:
    scripts = web_files()
    with review_server("A clip", port=0, open_browser=False, scripts=scripts, say=lambda text: None) as running:
        running.viser.gui.add_text("a field", "")
        running.viser.on_client_connect(lambda client: TABS[-1].connect(client))
        yield running


@pytest.fixture(scope="module")
def opened(server: ReviewServer, browser: "Browser") -> Tab:
    return open_tab(server, browser)


@pytest.fixture
def tab(opened: Tab) -> Iterator[Tab]:
    """The page with its states as at the start, also after a test that failed in the middle."""
    opened.page.mouse.up()
    opened.page.keyboard.press("Escape")
    opened.page.mouse.move(2, 300)
    opened.post(**dict.fromkeys("timeline marks keyframes suspicions fit provenance range menus".split()))
    opened.send(
        skeleton=states.Skeleton(),
        style=states.Style(),
        layout=POSTER,
        timeline=TIMELINE,
        rows=ROWS,
        keys=KEYS,
        bar=BAR,
    )
    opened.page.mouse.dblclick(*overview_place(opened, 10))  # the whole clip
    opened.hover(2, 300)
    opened.events.clear()
    yield opened
    assert opened.complaints == []


def height(tab: Tab) -> float:
    box = tab.page.locator(".tcfit-strip").bounding_box()
    assert box is not None
    return box["height"]


def lane_place(tab: Tab, frame: float, lane: str) -> tuple[float, float]:
    return strip_place(tab, frame, height(tab) - LANES[lane])


def overview_place(tab: Tab, frame: float) -> tuple[float, float]:
    return strip_place(tab, frame, height(tab) - 6)


def click_leads_to(tab: Tab, place: tuple[float, float], frames: Collection[int]) -> None:
    """A click reports its frame once or twice. No `settle`: the axis would follow its cursor."""
    tab.page.mouse.click(*place)
    tab.until(lambda: [seek for seek in tab.received(Seek)[-1:] if seek.frame in frames], f"seek to {frames}")


def tooltip(tab: Tab) -> list[str]:
    return (tab.text(".tcfit-strip .tcfit-tooltip") or "").split("\n")


def test_pressing_in_the_timeline_seeks(tab: Tab) -> None:
    tab.page.mouse.move(*strip_place(tab, 100))
    tab.page.mouse.down()
    assert tab.await_event(Seek) == Seek(frame=100)
    tab.page.mouse.move(*strip_place(tab, 150), steps=3)
    tab.page.mouse.up()
    tab.settle()
    assert tab.received()[-1] == Seek(frame=150)


def test_shift_in_the_timeline_chooses_a_range_and_a_double_click_none(tab: Tab) -> None:
    place, end = strip_place(tab, 120), strip_place(tab, 60)
    tab.drag(place, (end[0] - place[0], 0), key="Shift")
    assert tab.received()[-1] == Range(first=60, last=120)
    tab.page.mouse.dblclick(*place)
    tab.settle()
    assert tab.received(Range)[-1] == Range(first=None, last=None)


def test_a_drag_in_the_ruler_selects_frames_and_a_click_seeks(tab: Tab) -> None:
    place, end = strip_place(tab, 90, RULER), strip_place(tab, 150, RULER)
    tab.drag(place, (end[0] - place[0], 0))
    assert tab.received()[-1] == Range(first=90, last=150)
    assert not tab.received(Seek)
    tab.page.mouse.click(*strip_place(tab, 200, RULER))
    assert tab.await_event(Seek) == Seek(frame=200)


def test_the_ends_of_the_selected_frames_are_dragged(tab: Tab) -> None:
    tab.send(range=states.ChosenRange(first=90, last=150))
    start_x, y = strip_place(tab, 89.5, RULER)
    tab.drag((start_x, y), (strip_place(tab, 40, RULER)[0] - start_x, 0))
    assert tab.received()[-1] == Range(first=40, last=150)
    tab.send(range=states.ChosenRange(first=40, last=150))
    end_x, y = strip_place(tab, 150.5, RULER)
    tab.drag((end_x, y), (strip_place(tab, 180, RULER)[0] - end_x, 0))
    assert tab.received()[-1] == Range(first=40, last=180)


def test_the_selected_frames_are_named_and_cleared(tab: Tab) -> None:
    tab.send(timeline=states.Timeline(length=LENGTH, frame_rate=30.0, first_frame=7))
    frames, clear = tab.page.locator(".tcfit-frames"), tab.page.get_by_role("button", name="Clear frame selection")
    assert clear.is_hidden()
    tab.send(range=states.ChosenRange(first=100, last=120))
    assert "107–127" in frames.inner_text()
    clear.click()
    assert tab.await_event(Range) == Range(first=None, last=None)
    assert clear.is_hidden()


def test_the_frame_on_show_is_named_and_another_one_can_be_typed(tab: Tab) -> None:
    tab.post(timeline=states.Timeline(length=LENGTH, frame_rate=30.0, first_frame=7), cursor=states.Cursor(frame=60))
    tab.await_drawn(60)
    field = tab.page.get_by_role("textbox", name="Frame")
    until(lambda: field.input_value() == "67")
    assert tab.page.locator(".tcfit-now").text_content() == "/ 306· 0:02.00"
    tab.page.evaluate(COUNT_MADE)
    tab.post(cursor=states.Cursor(frame=63))
    until(lambda: tab.page.locator(".tcfit-now").text_content() == "/ 306· 0:02.10")
    assert tab.page.evaluate("() => window.made") == 0, "while a clip plays, no element is made for each frame"
    tab.post(cursor=states.Cursor(frame=60))
    tab.await_drawn(60)
    for typed, frame in (("99", 92), ("9999", LENGTH - 1), ("-3", 0)):
        known = len(tab.received(Seek))
        field.fill(typed)
        field.press("Enter")
        assert tab.await_event(Seek, known + 1) == Seek(frame=frame)
    for typed, key in (("12", "Escape"), ("", "Enter"), ("x", "Enter")):
        field.fill(typed)
        field.press(key)
        assert field.input_value() == "67", "what the server shows"
    assert len(tab.received(Seek)) == known + 1


def test_the_wheel_zooms_the_timeline_around_the_pointer(tab: Tab) -> None:
    place = strip_place(tab, 200)
    tab.page.mouse.move(*place)
    for _ in range(4):
        tab.page.mouse.wheel(0, -200)
    click_leads_to(tab, place, [200])
    click_leads_to(tab, (place[0] + 40, place[1]), range(201, 207))  # 20 further when all is shown
    tab.hover(place[0] + 80, place[1])
    assert tab.text(".tcfit-strip .tcfit-tooltip") is not None
    for _ in range(6):
        tab.page.mouse.wheel(0, 600)
    click_leads_to(tab, strip_place(tab, 0), [0])


def test_the_overview_moves_what_is_shown(tab: Tab) -> None:
    def drag(start: float, end: float) -> None:
        x, y = overview_place(tab, start)
        with tab.pressed((x, y), (overview_place(tab, end)[0] - x, 0)):
            pass

    left = strip_place(tab, 0)
    tab.page.mouse.move(*left)
    for _ in range(3):
        tab.page.mouse.wheel(0, -600)
    drag(5, 105)
    click_leads_to(tab, left, range(98, 103))
    tab.page.mouse.dblclick(*overview_place(tab, 150))
    click_leads_to(tab, left, [0])


def test_after_a_click_the_picture_is_not_covered_until_the_pointer_goes_on(tab: Tab) -> None:
    tip, (x, y) = tab.page.locator(".tcfit-strip .tcfit-tooltip"), strip_place(tab, 100)
    tab.hover(x, y)
    assert tip.is_visible()
    tab.page.mouse.click(x, y)
    tab.hover(x + 2, y)
    assert tip.is_hidden(), "a hand is never quite still"
    tab.hover(x + 30, y)
    assert tip.is_visible()


def test_the_timeline_tells_the_values_at_the_pointer(tab: Tab) -> None:
    came_from = states.Origins(label="run A", texts=("started from a seat", "elsewhere"), which=(0,) * LENGTH)
    found = states.Suspicion(first=50, last=50, frame=50, key="50", score=4.0, reason="left wrist jumps")
    tab.post(
        marks=states.Marks(bad=((40, 60),), flagged=((50, 50),)),
        provenance=states.Provenance(fits=(came_from,)),
        suspicions=states.Suspicions(found=(found,)),
    )
    tab.hover(*strip_place(tab, 50))
    expected = [
        "Frame 50  0:01.67",
        "Error  A 51 px",
        "run A  started from a seat",
        "marked bad, left wrist jumps, flagged",
    ]
    assert tooltip(tab) == expected


def test_a_lane_says_what_its_marks_are_and_leads_to_them(tab: Tab) -> None:
    found = states.Suspicion(
        first=100, last=120, frame=110, key="110 reprojection left arm", score=4.0, reason="left wrist is 42 px off"
    )
    tab.send(
        suspicions=states.Suspicions(found=(found,)),
        marks=states.Marks(edited=((20, 20),), flagged=((110, 110),)),
    )
    x, y = lane_place(tab, 102, "suspicion")
    tab.hover(x, y)
    assert tooltip(tab) == ["Frame 110  0:03.67", "left wrist is 42 px off", "Click: go there and select it"]
    tab.page.mouse.click(x, y)
    assert tab.await_event(Seek) == Seek(frame=110)
    assert tab.await_event(LookAt) == LookAt(entry="110 reprojection left arm")
    x, y = lane_place(tab, 20, "edits")
    click_leads_to(tab, (x + 4, y), [20])  # beside it
    click_leads_to(tab, lane_place(tab, 60, "edits"), [60])


def test_keyframes_are_gone_to_and_dragged(tab: Tab) -> None:
    tab.send(keyframes=states.Keyframes(frames=(50, 200), subject="right wrist"))
    x, y = lane_place(tab, 200, "keys")
    tab.hover(x, y)
    assert tooltip(tab)[1] == "keyframe of right wrist"
    tab.page.mouse.click(x, y)
    assert tab.await_event(Seek) == Seek(frame=200)
    tab.drag((x, y), (lane_place(tab, 170, "keys")[0] - x, 0))
    assert tab.await_event(MoveKey) == MoveKey(frame=200, to=170)


def test_the_axis_starts_at_zero_and_names_its_top(tab: Tab) -> None:
    curve = states.Curve(label="A", color="fit", values=states.curve_values(np.linspace(31, 38, LENGTH)))
    angle = states.Curve(label="", color="fit", values=states.curve_values(np.linspace(-3, 12, LENGTH)))
    rows = (
        states.Row(name="error", title="Error", curves=(curve,)),
        states.Row(name="angle", title="Flexion", curves=(angle,)),
        states.Row(name="jitter", title="Jitter", empty="Nothing here."),
    )
    tab.page.evaluate(RECORD)
    tab.send(rows=states.Rows(rows=rows))
    written = tab.page.evaluate("window.written")
    after_ruler = written[written.index("Frame") :]
    assert {"0", "40", "−5", "15", "Nothing here."} <= set(after_ruler)


def test_levels_are_drawn_ever_stronger_and_named_in_the_tooltip(tab: Tab) -> None:
    spans = ((((0, 99),), ((100, 199),), ((200, LENGTH - 1),)), ((), (), ((0, 9),)))
    levels = states.Levels(parts=("left hand", "right hand"), words=("rest", "hold", "movement"), spans=spans)
    tab.send(rows=states.Rows(rows=(states.Row(name="hands", title="Hand phases", levels=levels),)))
    left = tab.page.locator(".tcfit-strip").bounding_box()["x"]  # pyright: ignore[reportOptionalSubscript]
    bottom = height(tab) - 13 - 5 * 15

    def brightness(frame: int, y: float) -> int:
        x = round(strip_place(tab, frame)[0] - left)
        pixel = "document.querySelector('.tcfit-strip > canvas').getContext('2d').getImageData(x, y, 1, 1).data[1]"
        return tab.page.evaluate(f"([x, y]) => {pixel}", [x, round(y)])

    upper = [brightness(frame, 43) for frame in (50, 150, 250)]
    steps = np.diff([brightness(50, bottom - 12), *upper])  # nothing is known of the right hand in frame 50
    assert abs(steps).min() > 15 and abs(np.sign(steps).sum()) == 3, "of the same sign, in either theme"
    tab.hover(*strip_place(tab, 150, bottom - 12))
    assert tooltip(tab) == ["Frame 150  0:05.00", "Hand phases  left hand hold"]


def test_only_the_cursor_is_drawn_while_the_clip_plays(tab: Tab) -> None:
    """A curve has as many points as the clip has frames."""
    count = """() => {
      const usual = CanvasRenderingContext2D.prototype.stroke;
      window.strokes = 0;
      CanvasRenderingContext2D.prototype.stroke = function (...path) {
        if (this.canvas.parentElement.matches(".tcfit-strip")) window.strokes += 1;
        usual.apply(this, path);
      };
    }"""
    tab.page.evaluate(count)
    for _ in range(5):
        tab.settle()
    assert tab.page.evaluate("window.strokes") == 0
    tab.send(rows=structs.replace(ROWS, rows=ROWS.rows * 2))  # those that the page has are not sent again
    assert tab.page.evaluate("window.strokes") >= 2


def test_rows_are_chosen_in_the_timeline(tab: Tab) -> None:
    button = tab.page.get_by_title("Choose the curves")
    button.click()
    menu = tab.page.get_by_role("menu", name="Curves")
    items = menu.get_by_role("menuitemcheckbox")
    assert items.all_text_contents() == ["Error (px)", "Jitter (mm)", "Distance (mm)"]
    assert [item.get_attribute("aria-checked") for item in items.all()] == ["true", "false", "false"]
    items.nth(1).click()
    assert tab.await_event(Plot) == Plot(name="jitter", shown=True)
    assert menu.is_visible(), "another one can be chosen"
    tab.page.keyboard.press("ArrowDown")
    tab.page.keyboard.press("Enter")
    assert tab.await_event(Plot, 2) == Plot(name="distance", shown=True)
    tab.page.keyboard.press("Escape")
    assert not menu.is_visible() and button.evaluate("(b) => b === document.activeElement")
    tab.page.get_by_role("button", name="Close Error").click()
    assert tab.await_event(Plot, 3) == Plot(name="error", shown=False)


def test_a_long_menu_is_searched(tab: Tab) -> None:
    tab.send(timeline=structs.replace(TIMELINE, choices=CHOICES))
    tab.page.get_by_title("Choose the curves").click()
    tab.page.keyboard.type("knee ri")
    lines = tab.page.get_by_role("menuitemcheckbox")
    assert lines.all_text_contents() == ["Flexion of the right knee (°)"]
    tab.page.keyboard.press("ArrowDown")
    tab.page.keyboard.press("Enter")
    assert tab.await_event(Plot) == Plot(name="right_knee_flexion", shown=True)
    for _ in "knee ri":
        tab.page.keyboard.press("Backspace")  # a key of the field, which takes the focus again
    assert lines.count() == len(CHOICES)
    tab.page.keyboard.press("Escape")
    assert tab.page.get_by_role("menu").count() == 0


def test_a_menu_that_escape_closes_leaves_its_button_the_keys_that_press_it(tab: Tab) -> None:
    button, menu = tab.page.get_by_title("Choose the curves"), tab.page.get_by_role("menu")
    button.click()
    tab.page.keyboard.press("Escape")
    for count, key in enumerate(("b", "ArrowRight", "Control+z", "b"), 1):
        tab.page.keyboard.press(key)
        tab.await_event(Key, count)
        assert button.evaluate("(b) => b === document.activeElement"), "whoever goes by Tab stays there"
    assert [event.action for event in tab.received(Key)] == ["bad", "next", "undo", "bad"]
    for key in ("Space", "Enter"):
        tab.page.keyboard.press(key)
        menu.wait_for()
        tab.page.keyboard.press("b")  # the menu's
        tab.page.keyboard.press("Escape")
        assert menu.count() == 0
    tab.settle()
    assert len(tab.received(Key)) == 4
    button.evaluate("(b) => b.blur()")


def test_a_menu_takes_the_keys_and_a_press_elsewhere_closes_it(tab: Tab) -> None:
    tab.page.get_by_title("Choose the curves").click()
    for key in ("b", "ArrowUp", "Home"):
        tab.page.keyboard.press(key)
    first = tab.page.get_by_role("menuitemcheckbox").first
    assert first.evaluate("(item) => item === document.activeElement")
    tab.page.mouse.click(*strip_place(tab, 50))
    assert tab.page.get_by_role("menu").count() == 0
    tab.settle()
    assert not tab.received(Key)


MENUS = states.Menus(
    frames=(
        (states.MenuItem(label="Re-run frames 90–150", action="rerun", keys="R"),),
        (states.MenuItem(label="Mark bad, frames 90–150", action="bad", keys="X", obstacle="It is read-only."),),
    ),
    timeline=((states.MenuItem(label="Select frames from here on", action="range_start", keys="["),),),
)


def menu_texts(tab: Tab) -> list[str]:
    return tab.page.get_by_role("menuitem").locator("span").all_text_contents()


def test_a_right_click_says_what_can_be_done_with_the_selected_frames(tab: Tab) -> None:
    tab.post(range=states.ChosenRange(first=90, last=150), menus=MENUS, cursor=states.Cursor(frame=10))
    tab.await_drawn(10)
    tab.page.mouse.click(*strip_place(tab, 100), button="right")
    assert tab.await_event(Seek) == Seek(frame=100), "what is changed must be on show"
    offered = ["Re-run frames 90–150", "Mark bad, frames 90–150", "Zoom to frames 90–150", "Show the whole clip"]
    assert menu_texts(tab) == [*offered, "Clear frame selection"]
    bad = tab.page.get_by_role("menuitem", name="Mark bad")
    assert bad.get_attribute("aria-disabled") == "true"
    bad.hover(force=True)
    tab.page.locator(".tcfit-menu p", has_text="It is read-only.").wait_for()
    bad.click(force=True)
    tab.page.get_by_role("menuitem", name="Re-run").click()
    assert tab.await_event(Key) == Key(action="rerun", repeat=False)
    assert tab.page.get_by_role("menu").count() == 0 and len(tab.received(Key)) == 1
    tab.page.mouse.click(*strip_place(tab, 100), button="right")
    tab.page.get_by_role("menuitem", name="Clear frame selection").click()
    assert tab.await_event(Range) == Range(first=None, last=None)


def test_a_right_click_elsewhere_is_about_the_frame_there(tab: Tab) -> None:
    tab.send(menus=MENUS)
    tab.page.mouse.click(*strip_place(tab, 60), button="right")
    assert tab.await_event(Seek) == Seek(frame=60)
    assert menu_texts(tab) == ["Select frames from here on", "Show the whole clip"]
    tab.page.keyboard.press("Enter")
    assert tab.await_event(Key) == Key(action="range_start", repeat=False)
    tab.page.get_by_title("What to do with frames").click()
    assert menu_texts(tab)[0] == "Select frames from here on"
    tab.page.keyboard.press("Escape")
