"""What a browser tab passes on."""

from collections.abc import Callable
from pathlib import Path

import viser

from fitting_core.body.model import BodyModel
from tcfit_app.project.project import Project
from tcfit_app.review.browser.page_events import Hello
from tcfit_app.review.page import Page
from tcfit_app.review.tab.browser_tab import BrowserTab
from tcfit_app.server.page_files import PageFiles
from tests.drivers.lone_page import lone_page
from tests.samples.sessions import OneBody, small_clip


def test_a_page_that_says_hello_before_its_parts_are_made_is_heard(
    tiny_body: BodyModel, tmp_path: Path, panel_server: viser.ViserServer
):
    waiting: list[Callable[[], None]] = []
    with (
        Project.create(tmp_path / "walk.tcfit", small_clip(tiny_body)) as project,
        lone_page(panel_server, project, bodies=OneBody(tiny_body)) as tested,
    ):
        tab = tested.page.tab
        browser = BrowserTab(tab.client, waiting.append, PageFiles(here=True))
        browser.receive(Hello(tab="mine", width=960, height=640))
        page = Page(browser, tab.someone)
        assert browser.name is None
        for command in waiting:
            command()
        assert browser.name == "mine" and page.tab.ready
        page.close()
