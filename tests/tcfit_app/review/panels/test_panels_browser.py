"""The panels in Chromium: buttons of HTML that viser knows nothing of."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from fitting_core.camera import World
from fitting_core.config.schema import PRESETS
from fitting_core.keypoints import INDEX
from tcfit_app.review.panels.elements.fold import Fold
from tcfit_app.review.panels.elements.html import Board, Item, button, menu_button, row
from tcfit_app.review.tab.state import FitSettings
from tests.drivers.lone_page import sample_project
from tests.drivers.review_page import Reviewing, reviewing
from tests.drivers.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough

ATTACK = "<img src=x onerror='window.attacked=1'>"


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory, browser: "Browser") -> Iterator[Reviewing]:
    folder = tmp_path_factory.mktemp("panels") / "walk.tcfit"
    sample_project(folder, "first", ATTACK).close()
    with reviewing(folder, browser) as found:
        found.tab.wait_for_selector(".tcfit-panel button", timeout=60_000)
        yield found
        assert found.tab.evaluate("window.attacked") is None and found.tab.locator("img[src=x]").count() == 0


def test_buttons_work_and_show_their_state(opened: Reviewing):
    button = opened.tab.locator("[data-tcfit='bar.mode'][data-value=space]")
    button.click()
    until(lambda: button.get_attribute("aria-pressed") == "true")
    assert opened.page.tab.state.mode == "space"
    button.click()
    until(lambda: button.get_attribute("aria-pressed") == "false")
    assert opened.page.tab.state.mode == "edit"


def test_a_button_that_is_drawn_anew_under_the_pointer(opened: Reviewing):
    button = opened.tab.locator("[data-tcfit='action'][data-value=keypoints]")
    button.hover()
    opened.tab.mouse.down()
    opened.page.tab.do(lambda: opened.page.tab.set(keypoints=False))
    until(lambda: button.get_attribute("aria-pressed") == "false")
    opened.tab.mouse.up()
    until(lambda: opened.page.tab.state.keypoints)


def test_a_press_that_ends_elsewhere_does_nothing(opened: Reviewing):
    keypoints, loop, side = (opened.tab.locator(f"[data-value={name}]") for name in ("keypoints", "loop", "side"))
    keypoints.hover()
    opened.tab.mouse.down()
    loop.hover()
    opened.tab.mouse.up()
    was = opened.page.tab.state.side
    side.click()  # what comes after it is here
    until(lambda: opened.page.tab.state.side != was)
    assert opened.page.tab.state.keypoints and opened.page.tab.state.loop


def test_buttons_by_keyboard_keep_the_focus(opened: Reviewing):
    side = opened.tab.locator("[data-tcfit='action'][data-value=side]")
    side.focus()
    for _ in range(2):
        was = side.get_attribute("aria-pressed")
        opened.tab.keyboard.press("Enter")
        until(lambda was=was: side.get_attribute("aria-pressed") != was)
        assert side.evaluate("(button) => document.activeElement === button"), "drawn again, it has the focus"
    opened.tab.evaluate("document.activeElement.blur()")


def test_a_button_of_a_panel_that_is_drawn_again_keeps_the_focus(opened: Reviewing):
    tab, page, boards = opened.page.tab, opened.tab, []

    def draw(progress: str) -> None:
        boards.extend([] if boards else [Board(tab)])
        boards[0].show(row(button(f"Cancel {progress}", "tested.cancel", do=list)))

    page.get_by_role("tab", name="Correct").click()
    tab.do(lambda: draw("1 %"))
    cancel = page.locator("[data-tcfit='tested.cancel']")
    cancel.wait_for()
    page.keyboard.press("Tab")
    cancel.focus()
    for progress in ("2 %", "3 %"):
        tab.do(lambda progress=progress: draw(progress))
        page.get_by_role("button", name=f"Cancel {progress}").wait_for()
        until(lambda: cancel.evaluate("(one) => one === document.activeElement"), "the focus")
    cancel.evaluate("(one) => one.blur()")
    tab.do(lambda: draw("4 %"))
    page.get_by_role("button", name="Cancel 4 %").wait_for()
    assert page.evaluate("document.activeElement === document.body"), "left by the user, it stays so"


def test_a_menu_opens_below_its_button_and_a_fold_opens(opened: Reviewing):
    tab, page, chosen, boards = opened.page.tab, opened.tab, [], []
    hand = Item(label="Hand shape", more=(Item(label="Fist", do=lambda: chosen.append("fist")),))
    present = Item(label="Present", chosen=True, do=lambda: chosen.append("present"))
    lines = (Item(label="Grey", obstacle="There is no fit yet."), None, hand, present)

    def draw() -> None:
        if not boards:
            fold = Fold(tab, "tested")
            with fold:
                boards.extend((fold, Board(tab)))
        if boards[0].draw("Hands"):
            boards[1].show(row(menu_button("⋯", "tested", lines, name="More shapes")))

    tab.do(draw)
    head = page.locator("[data-value=tested]")
    head.click()
    until(lambda: "tested" in tab.state.folds)
    tab.do(draw)
    page.get_by_role("button", name="More shapes").click()
    assert page.get_by_role("menuitem", name="Grey").get_attribute("aria-disabled") == "true"
    page.get_by_role("menuitem", name="Hand shape").click()
    page.get_by_role("menuitem", name="Fist").click()
    until(lambda: chosen == ["fist"])
    page.get_by_role("button", name="More shapes").click()
    page.get_by_role("menuitemradio", name="Present", checked=True).click()
    until(lambda: chosen == ["fist", "present"])
    assert page.get_by_role("menu").count() == 0
    head.press("Enter")
    until(lambda: "tested" not in tab.state.folds)
    tab.do(draw)
    until(lambda: page.get_by_role("button", name="More shapes").count() == 0)


def test_a_row_leads_to_its_frame(opened: Reviewing):
    opened.page.tab.do(lambda: opened.page.tab.set(frame=3, selection=(4,)))
    opened.page.tab.do(opened.page.gestures.correcting.toggle_bad)
    until(lambda: opened.page.tab.session.project.last_edit == 1)
    opened.page.tab.do(lambda: opened.page.tab.seek(0))
    opened.tab.get_by_text("Correct", exact=True).first.click()
    opened.tab.get_by_role("button", name="▸ Corrections").click()
    opened.tab.locator("tr[data-tcfit='correct.visit']").first.click()
    until(lambda: opened.page.tab.state.frame == 3)
    opened.page.tab.do(lambda: opened.page.tab.seek(0))
    until(lambda: opened.page.tab.state.frame == 0)
    opened.tab.locator("tr button[data-tcfit='correct.visit']").first.focus()
    opened.tab.keyboard.press("Enter")
    until(lambda: opened.page.tab.state.frame == 3)
    opened.tab.keyboard.press("Control+z")
    until(lambda: opened.tab.locator("tr.tcfit-off").count() == 1)


def test_a_number_of_the_fit_panel_is_taken_as_it_is_typed(opened: Reviewing):
    opened.tab.get_by_role("tab", name="Fit").click()
    field = opened.tab.get_by_label("Smoothness (w_T)", exact=True)
    field.press("Control+a")
    opened.tab.keyboard.type("1e3")
    until(lambda: opened.page.tab.state.settings.config.temporal.weight == 1000)
    assert field.input_value() == "1e3"
    field.press("Control+a")
    opened.tab.keyboard.type("1e9")
    opened.tab.get_by_text("Smoothness (w_T) is 1e9; expected a number, 0 to 100,000.").wait_for()
    field.fill("100")
    until(lambda: not opened.page.tab.state.settings.problems)
    opened.tab.evaluate("document.activeElement.blur()")


def test_what_is_changed_moves_no_field(opened: Reviewing):
    opened.tab.get_by_role("tab", name="Fit", exact=True).click()
    weight, window = (
        opened.tab.locator(f"input[aria-label='{name}']") for name in ("Smoothness (w_T)", "Frames for body shape")
    )
    before = window.bounding_box()

    def settings() -> FitSettings:
        return opened.page.tab.state.settings

    for value, problems in (("77", 0), ("-1", 1), ("5", 0)):
        weight.fill(value)
        weight.press("Enter")
        until(
            lambda n=problems, v=value: (
                len(settings().problems) == n and (n or settings().config.temporal.weight == float(v))
            )
        )
        opened.rest()
        assert window.bounding_box() == before
    opened.tab.get_by_role("button", name="Back to the preset").click()
    until(lambda: settings().config == PRESETS["tcfit"])
    assert window.bounding_box() == before


def test_a_dropdown_that_is_reached_by_tab_stays_closed_until_it_is_wanted(opened: Reviewing):
    opened.tab.get_by_role("tab", name="Fit", exact=True).click()
    options, focused = opened.tab.get_by_role("option"), opened.tab.locator("input[aria-haspopup=listbox]:focus")
    opened.tab.locator("input[aria-label='Smoothness (w_T)']").focus()
    opened.tab.keyboard.press("Shift+Tab")  # to Preset
    until(lambda: focused.count() == 1, "the focus")
    opened.rest()
    assert options.count() == 0
    opened.tab.keyboard.press("ArrowDown")
    until(lambda: options.count() > 1, "the list")
    opened.tab.keyboard.press("Escape")
    until(lambda: options.count() == 0, "no list")
    focused.click()
    until(lambda: options.first.is_visible(), "the list, by a click")
    opened.tab.keyboard.press("Escape")


_CUT = "(spans) => spans.filter((span) => span.scrollWidth > span.clientWidth).map((span) => span.textContent)"
"""Texts of buttons that are not shown in full."""


def test_axes_with_a_calibrated_camera_are_shown_in_full(opened: Reviewing):
    project = opened.session.project
    world = World(rotation=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), translation=(0.3, 1.2, 4.0), up="z")
    opened.app.post(lambda: project.set_camera(replace(project.clip.camera, world=world)))
    opened.tab.get_by_role("tab", name="Export", exact=True).click()
    opened.tab.get_by_role("button", name="Axes and view").click()
    opened.tab.get_by_role("button", name="calibration's").wait_for()
    assert opened.tab.locator(".tcfit-joined button > span").evaluate_all(_CUT) == []


def test_selected_frames_leave_the_buttons_in_place(opened: Reviewing):
    tab, (first, second) = opened.page.tab, (INDEX["right_wrist"], INDEX["left_ankle"])
    opened.app.post(lambda: tab.set(selection=(first, second), frame=0, frames=range(0, 2)))
    opened.tab.get_by_role("tab", name="Correct", exact=True).click()
    opened.tab.get_by_text("frames 7–8").first.wait_for()
    bad, reset = (opened.tab.locator(f"[data-tcfit=action][data-value={name}]") for name in ("bad", "reset"))
    before = bad.bounding_box(), reset.bounding_box()
    opened.app.post(lambda: tab.set(frames=range(0, 3)))
    opened.tab.get_by_text("frames 7–9").first.wait_for()
    assert (bad.bounding_box(), reset.bounding_box()) == before
    opened.app.post(lambda: tab.set(frames=None, selection=()))


def test_the_next_tab_has_the_curves_that_were_chosen_last(opened: Reviewing):
    first, page = opened.page, opened.tab
    opened.app.post(lambda: first.timeline.plot("depth", shown=True))
    until(lambda: "depth" in page.evaluate("() => tcfit.state('rows').rows.map(({ name }) => name)"), "the curve")
    other = page.context.new_page()
    other.goto(page.url)
    until(lambda: opened.page is not first and opened.page.tab.ready, "the other tab")
    until(lambda: opened.page.tab.state.plots == first.tab.state.plots, "its curves")  # it is greeted after
    assert "depth" in opened.page.tab.state.plots
    other.close()
    until(lambda: opened.page is first, "the end of the other tab")


def test_enter_in_the_field_name_renames(opened: Reviewing):
    opened.tab.get_by_role("tab", name="Fit").click()
    run = opened.session.fits.runs[-1]
    opened.tab.get_by_role("button", name=f"More about {run.name}").click()
    opened.tab.get_by_role("menuitem", name="Rename …").click()
    field = opened.field("Name")
    until(lambda: field.input_value() == run.name)
    until(lambda: field.evaluate("(field) => document.activeElement === field"), "the focus")
    opened.tab.keyboard.press("Control+a")
    opened.tab.keyboard.type("mine")
    opened.tab.keyboard.press("Enter")
    until(lambda: opened.session.fits.runs[-1].name == "mine")


def test_the_window_of_keys_opens_and_closes(opened: Reviewing):
    window = opened.tab.locator("[role=dialog]", has_text="Nudge by 1 px")
    ways = (
        lambda: opened.tab.keyboard.press("Escape"),
        lambda: window.get_by_text("Close", exact=True).click(),
        lambda: opened.tab.mouse.click(5, 450),
    )
    for close in ways:
        opened.tab.keyboard.press("h")
        window.wait_for()
        close()
        window.wait_for(state="detached")


def test_keys_lead_to_panels(opened: Reviewing):
    selected = opened.tab.locator("[role=tab][aria-selected=true]")
    for number, title in ((3, "Fit"), (4, "Export"), (1, "Correct")):
        opened.tab.keyboard.press(f"Shift+Digit{number}")
        until(lambda title=title: selected.inner_text() == title, f"the panel {title}")


def test_the_panel_on_show_stays_over_a_reload_and_a_lost_connection(opened: Reviewing):
    def shown() -> str:
        return opened.tab.locator("[role=tab][aria-selected=true]").inner_text()

    opened.tab.get_by_role("tab", name="Fit").click()
    until(lambda: shown() == "Fit")
    for part in (opened.tab.reload, opened.server.viser._websock_server.disconnect_all_clients):
        client = opened.page.tab.client.client_id
        part()
        until(
            lambda client=client: (
                opened.app.pages and opened.page.tab.client.client_id != client and opened.page.tab.ready
            )
        )
        until(lambda: opened.tab.locator("[role=tab]").count() and shown() == "Fit", "the panel")
    opened.tab.get_by_role("tab").first.click()
