"""The app's script in viser's page, in a real browser: pointer, keyboard, and the way to the server."""

import logging
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec.structs import replace
from websockets.datastructures import Headers
from websockets.http11 import Response

from fitting_core.keypoints import COUNT
from tcfit_app.review.browser import channel
from tcfit_app.review.browser import page_states as states
from tcfit_app.review.browser.channel import loading, web_files
from tcfit_app.review.browser.page_events import Drag, Gesture, Hello, Key, Resized, Select, Theme
from tcfit_app.review.gestures.actions import bindings
from tcfit_app.server.serving import ReviewServer, review_server
from tests.drivers.page_tab import (
    ELBOW,
    HALVES,
    HEIGHT,
    HTML,
    KEYS,
    KNEE,
    MISSING,
    PAIR,
    PLACES,
    POSTER,
    RECORD,
    ROWS,
    SPACE,
    TABS,
    TIMELINE,
    WIDTH,
    WRIST,
    Tab,
    open_tab,
    strip_place,
)

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def server() -> Iterator[ReviewServer]:
    scripts = web_files()
    with review_server("A clip", port=0, open_browser=False, scripts=scripts, say=lambda text: None) as running:
        running.viser.scene.set_up_direction("-y")
        running.viser.gui.add_text("a field", "")
        running.viser.gui.add_button("a button")
        grey = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
        running.viser.on_client_connect(lambda client: TABS[-1].connect(client))
        running.viser.scene.add_image("/poster", grey, render_width=WIDTH / HEIGHT, render_height=1.0)
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
    opened.post(**dict.fromkeys(CLEARED), **START)
    opened.frame += 1
    opened.show()
    opened.look(300.0)
    opened.events.clear()
    yield opened
    assert opened.complaints == []


CLEARED = "notice marks suspicions fit provenance range selection menus framing focus beat".split()
START = {
    "skeleton": states.Skeleton(),
    "style": states.Style(),
    "layout": POSTER,
    "timeline": TIMELINE,
    "rows": ROWS,
    "keys": KEYS,
}


def test_what_is_sent_is_acknowledged_when_drawn(tab: Tab) -> None:
    tab.post(keypoints=states.Keypoints(frame=77, xy=((0.0, 0.0),) * COUNT, confidence=(0.0,) * COUNT))
    tab.await_drawn(77)


def test_header_bar_and_strip_take_their_room_from_the_canvas_and_tell(tab: Tab) -> None:
    with_strip = tab.page.evaluate("() => __viserMutable.canvas.clientHeight")
    parts = (".tcfit-header", ".tcfit > canvas", ".tcfit-transport", ".tcfit-strip")
    boxes = [tab.page.locator(part).first.bounding_box() for part in parts]
    edges = [edge for box in boxes if box for edge in (box["y"], box["y"] + box["height"])]
    assert edges[0] == 0 and edges[-1] == 640 and edges[1:-1:2] == edges[2::2], "one below the other"
    assert edges[3] - edges[2] == with_strip
    for timeline, height in ((None, 640), (TIMELINE, with_strip)):
        tab.post(timeline=timeline)
        tab.until(lambda height=height: [e.height for e in tab.received(Resized)[-1:]] == [height], f"height {height}")


@pytest.mark.parametrize("distance", [300.0, 120.0])
def test_a_drag_moves_by_what_the_pointer_moved(tab: Tab, distance: float) -> None:
    tab.look(distance)
    x, y = tab.screen(*PLACES[WRIST])
    tab.drag((x + 2, y - 1), (33, 21))
    assert tab.received()[0] == Select(joints=(WRIST,), how="replace")
    drags = tab.received(Drag)
    assert [drags[0].phase, drags[1].phase, drags[-1].phase] == ["start", "move", "end"]
    assert {drag.joints for drag in drags} == {(WRIST,)} and drags[-1].frame == tab.frame
    assert drags[-1].dx == pytest.approx(33 / tab.scale(), abs=0.01)
    assert drags[-1].dy == pytest.approx(21 / tab.scale(), abs=0.01)


def test_a_drag_works_in_the_second_poster(tab: Tab) -> None:
    tab.send(layout=PAIR)
    tab.look(420.0)
    tab.drag(tab.screen(*PLACES[WRIST], window=HALVES[1]), (20, 10))
    assert tab.await_drag("end").dx == pytest.approx(20 / tab.scale(), abs=0.01)


@pytest.mark.parametrize(
    ("suggested", "dragged"), [(False, (ELBOW, WRIST)), (True, (ELBOW,))], ids=["by the user", "by the app"]
)
def test_keypoints_that_the_user_has_selected_are_dragged_together(
    tab: Tab, suggested: bool, dragged: tuple[int, ...]
) -> None:
    tab.send(selection=states.Selection(joints=(WRIST, ELBOW), suggested=suggested))
    tab.drag(tab.screen(*PLACES[ELBOW]), (10, 0))
    assert tab.received(Select) == [Select(joints=(ELBOW,), how="replace")] * suggested
    assert tab.await_event(Drag).joints == dragged


def test_a_dragged_keypoint_follows_the_pointer_and_not_late_states(tab: Tab) -> None:
    start = tab.screen(*PLACES[WRIST])
    with tab.pressed(start, (60, 40)) as target:
        tab.await_event(Drag, 2)
        tab.show(selection=(WRIST,))  # as it was before the drag
        assert tab.painted(*target) and not tab.painted(*start)
    tab.show(selection=(WRIST,))
    assert tab.painted(*target)  # the server's answer to the end is not here yet
    moved = tab.await_event(Drag)
    tab.show(joints=PLACES | {WRIST: (PLACES[WRIST][0] + moved.dx, PLACES[WRIST][1] + moved.dy)})
    assert tab.painted(*target) and not tab.painted(*start)
    tab.show()  # undone, say: from the answer on the server decides
    assert tab.painted(*start) and not tab.painted(*target)


def test_escape_cancels_a_drag(tab: Tab) -> None:
    start = tab.screen(*PLACES[WRIST])
    with tab.pressed(start, (60, 0)) as target:
        tab.await_event(Drag, 2)
        tab.page.keyboard.press("Escape")
        assert tab.painted(*start) and not tab.painted(*target)
        tab.page.mouse.move(target[0] + 20, target[1])
    tab.settle()
    assert [drag.phase for drag in tab.received(Drag)][-2:] == ["move", "cancel"]


def test_another_frame_cancels_a_drag(tab: Tab) -> None:
    with tab.pressed(tab.screen(*PLACES[WRIST]), (60, 0)):
        tab.await_event(Drag, 2)
        tab.frame += 1
        tab.show()
    tab.settle()
    last = tab.await_event(Drag)
    assert (last.phase, last.frame) == ("cancel", tab.frame - 1)


def test_a_drag_goes_on_under_another_title_of_the_picture(tab: Tab) -> None:
    """As when a fit in the background is ready with a phase."""
    with tab.pressed(tab.screen(*PLACES[WRIST]), (30, 0)) as (x, y):
        tab.await_event(Drag, 2)
        tab.send(layout=replace(POSTER, posters=(replace(POSTER.posters[0], label="Run 2"),)))
        tab.page.mouse.move(x + 30, y, steps=3)
    assert tab.await_drag("end").dx == pytest.approx(60 / tab.scale(), abs=0.01)


TOOLTIP = ".tcfit > .tcfit-tooltip"


def test_hovering_shows_name_confidence_and_marks(tab: Tab) -> None:
    for joint, text in ((WRIST, "right_wrist  0.83  edited"), (KNEE, "left_knee  0.83  bad")):
        x, y = tab.screen(*PLACES[joint])
        tab.hover(x + 4, y + 4)
        assert tab.text(TOOLTIP) == text
    tab.hover(x + 30, y + 30)
    assert tab.text(TOOLTIP) is None


AROUND = """([x, y]) => {
  const canvas = document.querySelector(".tcfit > canvas");
  const { left, top } = canvas.getBoundingClientRect();
  return canvas.getContext("2d").getImageData(x - left, y - top, 29, 29).data;
}"""


def test_attributes_of_a_keypoint_are_drawn_and_named(tab: Tab) -> None:
    x, y = tab.screen(*PLACES[WRIST])

    def drawn() -> int:
        pixels = tab.page.evaluate(AROUND, [round(x) - 14, round(y) - 14])
        return sum(alpha > 100 for alpha in np.reshape(pixels, (-1, 4))[:, 3])

    tab.hover(2, 300)
    edited = drawn()
    for name, more, said in (
        ("pinned", 1.1, "pinned"),
        ("locked", 1.05, "edited  rotation locked"),
        ("deep", 1.05, "edited  depth set"),
    ):
        tab.page.mouse.move(2, 300)
        marks: dict[str, Any] = {name: (WRIST,)}
        tab.show(**marks)
        assert drawn() > more * edited, name
        tab.hover(x + 4, y + 4)
        assert tab.text(TOOLTIP) == f"right_wrist  0.83  {said}"


def test_a_missing_keypoint_is_drawn_only_while_it_alone_is_selected(tab: Tab) -> None:
    x, y = tab.screen(0, 0)
    tab.page.mouse.move(x + 3, y + 3)
    for selection, text in (((), None), ((MISSING, KNEE), None), ((MISSING,), "left_ear  missing")):
        tab.show(selection=selection)
        assert tab.text(TOOLTIP) == text, selection
    tab.drag((x, y), (40, 30))  # from there it is put in its place
    assert tab.await_event(Drag).joints == (MISSING,)


def test_the_body_comes_before_a_hand_at_the_same_place(tab: Tab) -> None:
    hand = COUNT - 71  # the last point of a hand
    tab.show(joints={hand: (100.0, 100.0), WRIST: (100.0, 100.0)})
    tab.page.mouse.click(*tab.screen(100, 100))
    assert tab.await_event(Select).joints == (WRIST,)


def test_a_hidden_group_cannot_be_picked(tab: Tab) -> None:
    tab.send(style=states.Style(groups=("face",)))
    place = tab.screen(*PLACES[WRIST])
    assert not tab.painted(*place)
    tab.drag(place, (20, 20))
    assert tab.received() == []


def test_clicks_select_toggle_and_clear(tab: Tab) -> None:
    tab.page.mouse.click(*tab.screen(*PLACES[WRIST]))
    tab.page.keyboard.down("Shift")
    tab.page.mouse.click(*tab.screen(*PLACES[ELBOW]))
    tab.page.keyboard.up("Shift")
    tab.page.mouse.click(*tab.screen(*PLACES[ELBOW]))
    tab.page.mouse.click(*tab.screen(20, 20))
    tab.settle()
    assert tab.received() == [
        Select(joints=(WRIST,), how="replace"),
        Select(joints=(ELBOW,), how="toggle"),
        Select(joints=(ELBOW,), how="replace"),
        Select(joints=(), how="replace"),
    ]


def test_a_rectangle_selects_what_is_in_it(tab: Tab) -> None:
    (left, top), (right, bottom) = tab.screen(60, 60), tab.screen(150, 150)
    tab.drag((left, top), (right - left, bottom - top), key="Shift")
    assert tab.received() == [Select(joints=(ELBOW, WRIST), how="add")]


def test_on_a_poster_the_camera_pans_and_zooms_and_never_turns(tab: Tab) -> None:
    camera, mouse = tab.clients[-1].camera, tab.page.mouse
    tab.drag(tab.screen(30, 30), (80, 60))
    assert tuple(camera.position) == pytest.approx((0, 0, -300), abs=1e-6)
    x, y = tab.screen(200, 60)
    mouse.move(x, y)
    mouse.wheel(0, -300)
    tab.until(lambda: camera.position[2] > -290, "zoom")
    tab.await_still_camera()
    assert tab.screen(200, 60) == pytest.approx((x, y), abs=1.0)  # what is under the pointer stays there
    before = tuple(camera.position)
    mouse.down(button="right")
    mouse.move(x + 50, y + 20, steps=4)
    mouse.up(button="right")
    tab.until(lambda: tuple(camera.position) != before, "pan")
    tab.await_still_camera()
    assert tab.screen(200, 60) == pytest.approx((x + 50, y + 20), abs=1.5)
    assert tuple(np.abs(camera.wxyz)) == pytest.approx((1, 0, 0, 0), abs=1e-6)


def test_the_menu_comes_when_the_right_button_is_released_where_it_was_pressed(tab: Tab) -> None:
    menu, mouse = tab.page.get_by_role("menu"), tab.page.mouse
    tab.send(menus=states.Menus(picture=((states.MenuItem(label="Undo", action="undo"),),)))
    for x, y in (tab.screen(200, 60), strip_place(tab, 100)):
        for way in (0, 40):
            mouse.move(x, y)
            mouse.down(button="right")
            tab.settle()
            assert menu.count() == 0, "browsers on Linux ask for a menu at the press"
            mouse.move(x + way, y)
            mouse.move(x, y)
            mouse.up(button="right")
            assert menu.count() == (way == 0), "a drag moves the picture, also there and back"
            tab.page.keyboard.press("Escape")


def test_a_click_where_nobody_was_detected_offers_to_search_there(tab: Tab) -> None:
    place = tab.screen(20, 20)
    tab.page.mouse.click(*place)
    assert tab.page.get_by_role("menu").count() == 0, "with the person in the frame it only clears the selection"
    offer = states.MenuItem(label="Nobody was detected here. Search here?", action="frame_person")
    tab.send(menus=states.Menus(nobody=offer))
    tab.page.mouse.click(*place)
    tab.page.get_by_role("menuitem", name="Search here?").click()
    assert tab.await_event(Key) == Key(action="frame_person", repeat=False)


@pytest.mark.parametrize("over", HALVES)
def test_two_pictures_are_zoomed_about_the_same_pixel(tab: Tab, over: states.Place) -> None:
    tab.send(layout=PAIR)
    tab.look(420.0)
    before = tab.screen(200, 60, window=over)
    tab.page.mouse.move(*before)
    tab.page.mouse.wheel(0, -300)
    tab.until(lambda: tab.clients[-1].camera.position[2] > -410, "zoom")
    tab.await_still_camera()
    assert tab.screen(200, 60, window=over) == pytest.approx(before, abs=1.0)
    drawn = tab.page.evaluate("() => [0, 1].map((poster) => tcfit.place(200, 60, poster))")
    for place, window in zip(drawn, HALVES, strict=True):
        assert place == pytest.approx(tab.screen(200, 60, window=window), abs=0.01)


def test_the_divider_is_dragged_and_moved_by_keys(tab: Tab) -> None:
    whole = (0.0, 0.0, 1.0, 1.0)
    tab.send(layout=replace(PAIR, posters=tuple(replace(poster, window=whole) for poster in PAIR.posters), wipe=True))
    divider = tab.page.get_by_role("slider", name="Divider between A and B")
    assert divider.get_attribute("aria-valuenow") == "50"
    canvas = tab.page.evaluate("() => window.__viserMutable.canvas.clientWidth")
    tab.drag((canvas / 2, 100), (-canvas / 4, 20))
    assert divider.get_attribute("aria-valuetext") == "A 25 %, B 75 %"
    box = divider.bounding_box()
    assert box and box["x"] + box["width"] / 2 == pytest.approx(canvas / 4, abs=2)
    assert not tab.received(Drag, Select)
    tab.page.keyboard.press("Tab")
    divider.focus()
    tab.page.keyboard.press("ArrowRight")
    tab.settle()
    assert divider.get_attribute("aria-valuenow") == "27"
    divider.dblclick()
    tab.settle()
    assert divider.get_attribute("aria-valuenow") == "50"
    tab.send(layout=POSTER)
    assert divider.is_hidden()


def test_a_close_up_has_its_pixel_in_the_middle_of_the_picture(tab: Tab) -> None:
    middle = tab.screen(WIDTH / 2, HEIGHT / 2)
    tab.send(focus=states.Focus(x=PLACES[KNEE][0], y=PLACES[KNEE][1]))
    assert tab.page.evaluate("([x, y]) => tcfit.place(x, y)", list(PLACES[KNEE])) == pytest.approx(middle, abs=0.01)


def test_a_picture_is_not_met_in_the_other_one_s_window(tab: Tab) -> None:
    tab.send(layout=PAIR)
    tab.look(60.0)
    place = tab.screen(*PLACES[KNEE], window=HALVES[0])
    assert place[0] > 450, "it is across the border"
    tab.drag(place, (10, 10))
    assert not tab.received(Drag)


def test_in_space_the_left_button_is_the_camera_s(tab: Tab) -> None:
    tab.send(layout=SPACE)
    before = np.array(tab.clients[-1].camera.wxyz)
    tab.drag((200, 200), (80, 40))
    tab.until(lambda: np.abs(np.array(tab.clients[-1].camera.wxyz) - before).max() > 0.01, "turn of the camera")
    assert set(map(type, tab.received())) == {Gesture}


def camera_place(tab: Tab) -> list[float]:
    return tab.page.evaluate("() => __viserMutable.camera.position.toArray()")


def test_in_space_keys_do_what_they_do_elsewhere(tab: Tab) -> None:
    keys = tuple(states.KeyBinding(key=key, action=key) for key in "sd")
    tab.send(keys=states.Keys(bindings=keys), layout=SPACE)
    before = camera_place(tab)
    for key in ("s", "d", "w", "a", "ArrowUp"):
        tab.page.keyboard.press(key, delay=30)
    tab.settle()
    assert tab.received() == [Key(action="s", repeat=False), Key(action="d", repeat=False)]
    assert camera_place(tab) == before


def test_of_a_long_name_the_pass_stays_or_both_ends(tab: Tab) -> None:
    tab.page.evaluate(RECORD)
    for end in (" · one shape", ""):
        label = f"B   a very long name {'of a fit ' * 30}corrected{end}"
        tab.send(layout=replace(POSTER, posters=(replace(POSTER.posters[0], label=label),)))
    *_, passed, short = (text for text in tab.page.evaluate("window.written") if text.startswith("B "))
    assert passed == "B   one shape"
    assert short.startswith("B   a very") and short.endswith("corrected") and "…" in short and len(short) < 140


def test_outside_the_picture_bodies_are_faded(tab: Tab) -> None:
    corner = "document.querySelector('.tcfit > canvas').getContext('2d').getImageData(3, 3, 1, 1).data[3]"
    for clipped in (True, False):
        tab.send(layout=replace(POSTER, posters=(replace(POSTER.posters[0], clipped=clipped),)))
        assert bool(tab.page.evaluate(corner)) is not clipped


CTRL, SHIFT = 2, 8
"""Modifiers as Chromium's protocol counts them."""
KEYBOARDS = {
    "US": {
        "undo": ("z", "KeyZ", CTRL),
        "redo": ("y", "KeyY", CTRL),
        "all": ("a", "KeyA", CTRL),
        "bodies": ("m", "KeyM", 0),
        "range_start": ("[", "BracketLeft", 0),
        "denser": (".", "Period", 0),
        "edit": ("1", "Digit1", 0),
        "previous": ("ArrowLeft", "ArrowLeft", 0),
    },
    "German": {
        "undo": ("z", "KeyY", CTRL),
        "redo": ("y", "KeyZ", CTRL),
        "all": ("a", "KeyA", CTRL),
        "mirror_depth": ("M", "KeyM", SHIFT),
        "range_start": ("[", "Digit8", 0),  # with AltGr, which is none of the protocol's modifiers
        "range_end": ("]", "Digit9", 0),
        "fainter": (",", "Comma", 0),
        "edit": ("1", "Digit1", 0),
        "next10": ("ArrowRight", "ArrowRight", SHIFT),
    },
    "French": {
        "undo": ("z", "KeyW", CTRL),
        "redo": ("Z", "KeyW", CTRL | SHIFT),
        "all": ("a", "KeyQ", CTRL),
        "bodies": ("m", "Semicolon", 0),
        "range_start": ("[", "Digit5", 0),
        "fainter": (",", "KeyM", 0),
        "denser": (".", "Comma", SHIFT),
        "edit": ("&", "Digit1", 0),
        "ab": ("é", "Digit2", 0),
        "nudge_up": ("ArrowUp", "ArrowUp", CTRL),
    },
    "Russian": {"undo": ("я", "KeyZ", CTRL), "all": ("ф", "KeyA", CTRL), "next_person": ("й", "KeyQ", 0)},
    "German, of a Mac": {"undo": ("z", "KeyY", 4), "range_start": ("[", "Digit5", 1)},
}
"""What a key gives, where it is and what is held with it, by what it does."""


def test_letters_and_signs_go_by_what_is_written_on_the_keys(tab: Tab) -> None:
    tab.send(keys=states.Keys(bindings=bindings()))
    protocol = tab.page.context.new_cdp_session(tab.page)
    for keyboard, keys in KEYBOARDS.items():
        tab.events.clear()
        for key, code, modifiers in keys.values():
            event = {"key": key, "code": code, "modifiers": modifiers}
            protocol.send("Input.dispatchKeyEvent", {"type": "rawKeyDown", **event})
            protocol.send("Input.dispatchKeyEvent", {"type": "keyUp", **event})
        tab.settle()
        assert [event.action for event in tab.received(Key)] == list(keys), keyboard


def test_what_a_key_gives_with_altgr_is_none_of_its_other_meanings(tab: Tab) -> None:
    tab.send(keys=states.Keys(bindings=bindings()))
    tab.page.evaluate("""() => {
      for (const [key, code] of [["¹", "Digit1"], ["@", "KeyQ"], ["[", "Digit8"]])
        window.dispatchEvent(new KeyboardEvent("keydown", { key, code, modifierAltGraph: true }));
    }""")
    tab.settle()
    assert [event.action for event in tab.received(Key)] == ["range_start"]


def test_keys_are_told_and_kept_from_the_camera(tab: Tab) -> None:
    before, keyboard = camera_place(tab), tab.page.keyboard
    keyboard.down("ArrowRight")
    keyboard.down("ArrowRight")
    keyboard.up("ArrowRight")
    for key in ("b", "Shift+B", "Control+z", "?", "Alt+b", "Control+b", "w", "ArrowUp", "e"):
        keyboard.press(key, delay=30)
    tab.settle()
    assert tab.received() == [
        Key(action="next", repeat=False),
        Key(action="next", repeat=True),
        Key(action="bad", repeat=False),
        Key(action="bad range", repeat=False),
        Key(action="undo", repeat=False),
        Key(action="help", repeat=False),
    ]
    assert camera_place(tab) == before


def test_keys_in_a_field_are_the_field_s(tab: Tab) -> None:
    field = tab.page.get_by_text("a field").locator("xpath=following::input[1]")
    field.fill("")
    field.click()
    tab.page.keyboard.press("b")
    tab.page.keyboard.press("Space")
    tab.settle()
    assert tab.received() == [] and field.input_value() == "b "
    tab.page.mouse.click(*tab.screen(20, 20))  # on the picture: the field is left
    tab.page.keyboard.press("b")
    assert tab.await_event(Key).action == "bad"


def test_a_clicked_button_does_not_keep_the_space_bar(tab: Tab) -> None:
    button = tab.page.get_by_role("button", name="a button")
    button.click()
    tab.page.keyboard.press("Space")
    assert tab.await_event(Key).action == "play"
    button.focus()
    tab.page.keyboard.press("Tab")
    tab.page.keyboard.press("Shift+Tab")  # reached by keyboard, it is pressed by keyboard
    tab.page.keyboard.press("Space")
    tab.settle()
    assert len(tab.received(Key)) == 1
    tab.page.mouse.click(*tab.screen(20, 20))


def test_text_stays_text(tab: Tab) -> None:
    tab.send(notice=states.Notice(title=HTML, text=HTML))
    assert tab.text(".tcfit-card h2") == tab.text(".tcfit-card p") == HTML
    assert tab.page.locator(".tcfit img").count() == 0
    tab.send(notice=None)
    assert not tab.page.locator(".tcfit-card").is_visible()


def test_what_is_no_event_is_dropped(tab: Tab, caplog: pytest.LogCaptureFixture) -> None:
    uuid = tab.channels[-1]._field._impl.uuid
    send = "([uuid, value]) => __viserMutable.sendMessage({type: 'GuiUpdateMessage', uuid, updates: {value}})"
    replayed = '{"number": 1, "event": {"type": "key", "action": "bad", "repeat": false}}'
    with caplog.at_level(logging.INFO, "tcfit_app"):
        for value in ("{", "x" * 100_000, replayed):
            tab.page.evaluate(send, [uuid, value])
        tab.settle()
    assert tab.received() == []
    dropped = [record for record in caplog.records if "Dropped" in record.message]
    assert [record.levelno for record in dropped] == [logging.INFO], "the first one is noted"


def test_the_script_is_put_in_once(tab: Tab) -> None:
    tab.page.evaluate(loading())
    assert tab.page.locator(".tcfit").count() == 1
    tab.settle()


def test_states_do_not_have_viser_draw_its_scene(tab: Tab) -> None:
    """viser itself goes on drawing for a quarter of a second, and then draws once a second."""
    tab.page.evaluate("""async () => {
      window.drawn = 0;
      __viserMutable.scene.onBeforeRender = () => { window.drawn += 1; };
      for (let was = -1; was !== window.drawn; await new Promise((done) => setTimeout(done, 400))) was = window.drawn;
      window.drawn = 0;
    }""")
    begin = time.monotonic()
    for _ in range(15):
        tab.settle()
    drawn = tab.page.evaluate("() => { delete __viserMutable.scene.onBeforeRender; return window.drawn }")
    assert drawn <= 2 + time.monotonic() - begin


def test_a_lost_connection_comes_back_as_the_same_tab(tab: Tab, server: ReviewServer) -> None:
    clients = len(tab.clients)
    tab.send(notice=states.Notice(title="From before", text=""))
    server.viser._websock_server.disconnect_all_clients()
    assert tab.await_event(Hello).width > 0
    tab.settle()
    assert tab.text(".tcfit-card") is None and tab.page.locator(".tcfit").count() == 1
    assert len(tab.clients) == clients + 1


def test_a_server_that_does_not_answer_is_noticed(tab: Tab) -> None:
    """The page then takes nothing, lets go of a drag, and goes on in the same connection once it hears again. What has
    become of it meanwhile, it tells then."""
    clients = len(tab.clients)
    start = tab.screen(*PLACES[WRIST])
    with tab.pressed(start, (60, 40)):
        tab.await_event(Drag, 2)
        tab.post(beat=states.Beat(milliseconds=250))
        tab.page.wait_for_selector(".tcfit-card[role=alert]", state="visible")
        assert "does not answer" in (tab.text(".tcfit-card h2") or "")
        panel = tab.page.locator(".mantine-Paper-root").first
        assert panel.evaluate("(panel) => getComputedStyle(panel).opacity") == "0.45"
        tab.await_drag("cancel")
        known = len(tab.received())
    with tab.pressed(start, (40, 0)):
        tab.page.keyboard.press("b")
    tab.page.emulate_media(color_scheme="dark")
    tab.page.evaluate("() => new Promise((told) => requestAnimationFrame(() => requestAnimationFrame(told)))")
    tab.post(beat=states.Beat(milliseconds=60_000))
    tab.page.wait_for_selector(".tcfit-card", state="hidden")
    tab.page.keyboard.press("b")
    tab.settle()
    assert tab.received()[known:] == [Theme(dark=True), Key(action="bad", repeat=False)]
    assert tab.received(Resized)[-1].width > 0
    tab.page.emulate_media(color_scheme="light")
    assert len(tab.clients) == clients


def test_without_a_server_nothing_is_taken_until_it_is_back(
    tab: Tab, server: ReviewServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page says that it is cut off, drops what is being done, and lets go of a drag that has begun."""
    x, y = tab.screen(*PLACES[WRIST])
    width = tab.page.evaluate("() => __viserMutable.canvas.clientWidth")
    refused: list[object] = []

    def refuse(*request: object) -> Response:
        refused.append(request)
        return Response(503, "Service Unavailable", Headers({"Connection": "close", "Content-Length": "0"}))

    with monkeypatch.context() as closed:
        closed.setattr(server.gate, "answer", refuse)
        with tab.pressed((x, y), (60, 40)):
            tab.await_event(Drag, 2)
            server.viser._websock_server.disconnect_all_clients()
            tab.page.wait_for_selector(".tcfit-card[role=alert]", state="visible")
            assert "ended or cannot be reached" in (tab.text(".tcfit-card h2") or "")
        known = len(tab.events)
        tab.page.mouse.click(x, y)
        assert not tab.painted_now(x + 60, y + 40) and tab.painted_now(x, y)
        with tab.pressed((x, y), (40, 0)):
            assert not tab.painted_now(x + 40, y)
        tab.page.mouse.click(*strip_place(tab, 100))
        tab.page.keyboard.press("b")
        tried = len(refused)
        tab.until(lambda: len(refused) > tried + 1, "another attempt of viser")
        assert tab.text(".tcfit-card h2") and len(tab.events) == known
    tab.await_event(Hello)
    assert isinstance(tab.events[known], Hello) and len(tab.received()) == len(tab.received()[:known]) + 1
    assert tab.text(".tcfit-card h2") is None
    tab.post(**START)
    tab.show()
    # The panels go with the connection, and come back.
    tab.page.wait_for_function("(width) => __viserMutable.canvas.clientWidth === width", arg=width)
    tab.look(300.0)
    tab.events.clear()
    tab.drag(tab.screen(*PLACES[WRIST]), (33, 21))
    assert tab.await_event(Drag).phase == "end"
    tab.page.keyboard.press("b")
    assert tab.await_event(Key).action == "bad"


def test_a_reload_keeps_the_tab_s_name_and_other_tabs_have_others(
    tab: Tab, server: ReviewServer, browser: "Browser"
) -> None:
    tab.page.reload()
    again = tab.await_event(Hello)
    tab.page.reload()
    assert tab.await_event(Hello, 2).tab == again.tab
    assert tab.page.locator(".tcfit").count() == 1
    other = open_tab(server, browser)
    assert other.await_event(Hello).tab != again.tab
    other.page.close()
    TABS.remove(other)


def test_a_newer_script_takes_the_place_of_an_older_one(
    tab: Tab, server: ReviewServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last test: from here on the page has a version that the server has not."""
    monkeypatch.setattr(channel, "web_version", lambda: "newer")
    server.viser._websock_server.disconnect_all_clients()
    tab.page.wait_for_function("() => window.tcfit?.version === 'newer'")
    tab.await_event(Hello)
    assert tab.page.locator(".tcfit").count() == tab.page.locator(".tcfit-strip").count() == 1
    assert tab.page.evaluate("() => __viserMutable.canvas.parentElement.getBoundingClientRect().height") == 640
