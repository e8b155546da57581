"""The panels in Chromium: buttons of HTML that viser knows nothing of."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest

from tcfit_app.app import ReviewApp
from tcfit_app.bodies import Bodies
from tcfit_app.page import Page
from tcfit_app.server import review_server
from tcfit_app.session import Session
from tests.app.browser import chromium
from tests.app.lone_page import sample_project

if TYPE_CHECKING:
    from playwright.sync_api import Page as BrowserPage

ATTACK = "<img src=x onerror='window.attacked=1'>"


class Opened:
    """A browser's page, and the app's."""

    def __init__(self, browser: "BrowserPage", page: Page) -> None:
        self.browser, self.page = browser, page

    def tab(self, name: str) -> None:
        self.browser.get_by_text(name, exact=True).first.click()

    def wait(self, condition: Callable[[], bool]) -> None:
        """Until something is so, for 10 seconds at most."""
        end = time.monotonic() + 10
        while not condition():
            assert time.monotonic() < end, "nothing happened"
            self.browser.wait_for_timeout(30)


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    folder = tmp_path_factory.mktemp("panels") / "walk.tcfit"
    with (
        sample_project(folder, "first", ATTACK) as project,
        review_server("A clip", port=0, open_browser=False, say=lambda text: None) as server,
        chromium() as browser,
    ):
        app = ReviewApp(Session(project, Bodies()), server.viser)
        loop = threading.Thread(target=app.run, daemon=True)
        loop.start()
        try:
            tab = browser.new_page(viewport={"width": 1440, "height": 900})
            tab.goto(server.gate.link)
            tab.wait_for_selector(".tcfit-panel button", timeout=60_000)
            yield Opened(tab, next(iter(app.pages.values())))
        finally:
            app.stop()
            loop.join(20)
            app.close()


def test_buttons_work_and_show_their_state(opened: Opened):
    button = opened.browser.locator("[data-value=space]")
    button.click()
    opened.wait(lambda: button.get_attribute("aria-pressed") == "true")
    assert opened.page.state.mode == "space"
    opened.browser.locator("[data-value=edit]").click()
    opened.wait(lambda: opened.page.state.mode == "edit")


def test_a_button_that_is_drawn_anew_under_the_pointer(opened: Opened):
    button = opened.browser.locator("[data-tcfit='view.group'][data-value=face]")
    button.hover()
    opened.browser.mouse.down()
    opened.page.do(lambda: opened.page.set(bones=False))
    opened.wait(lambda: opened.browser.locator("[data-value=bones][aria-pressed=false]").count() > 0)
    opened.browser.mouse.up()
    opened.wait(lambda: "face" not in opened.page.state.groups)


def test_a_press_that_ends_elsewhere_does_nothing(opened: Opened):
    groups = opened.page.state.groups
    opened.browser.locator("[data-tcfit='view.group'][data-value=body]").hover()
    opened.browser.mouse.down()
    opened.browser.locator("[data-tcfit='view.group'][data-value=left_hand]").hover()
    opened.browser.mouse.up()
    opened.browser.wait_for_timeout(200)
    assert opened.page.state.groups == groups


def test_buttons_by_keyboard(opened: Opened):
    opened.browser.locator("[data-tcfit='view.color'][data-value=confidence]").focus()
    opened.browser.keyboard.press("Enter")
    opened.wait(lambda: opened.page.state.color_by == "confidence")
    opened.browser.keyboard.press("Escape")


def test_names_of_runs_are_text(opened: Opened):
    opened.page.do(lambda: opened.page.set(selection=(4,)))
    for tab in ("Keypoints", "Review", "View"):
        opened.tab(tab)
        opened.browser.wait_for_timeout(100)
    assert opened.browser.evaluate("window.attacked") is None
    assert opened.browser.locator("img[src=x]").count() == 0


def test_a_row_leads_to_its_frame(opened: Opened):
    opened.page.do(lambda: opened.page.set(frame=3, selection=(4,)))
    opened.page.do(opened.page.correcting.toggle_bad)
    opened.wait(lambda: opened.page.session.project.last_edit == 1)
    opened.page.do(lambda: opened.page.seek(0))
    opened.tab("Keypoints")
    opened.browser.locator("tr[data-tcfit='keypoints.visit']").first.click()
    opened.wait(lambda: opened.page.state.frame == 3)
    opened.browser.locator("[data-value=undo]").click()
    opened.wait(lambda: opened.browser.locator("tr.tcfit-off").count() == 1)


def test_the_window_of_keys_opens_and_closes(opened: Opened):
    window = opened.browser.locator("[role=dialog]", has_text="Nudge by 1 px")
    ways = (
        lambda: opened.browser.keyboard.press("Escape"),
        lambda: window.get_by_text("Close", exact=True).click(),
        lambda: opened.browser.mouse.click(5, 450),
    )
    for close in ways:
        opened.browser.keyboard.press("h")
        window.wait_for()
        close()
        window.wait_for(state="detached")
