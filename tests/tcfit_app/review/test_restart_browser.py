"""A tab that shows one tcfit after another: started again at the same port, or beside it at another one."""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tcfit_app.fitting.bodies import Bodies
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tcfit_app.review.app import ReviewApp
from tcfit_app.review.session.session import Session
from tcfit_app.server.serving import ReviewServer
from tests.drivers.review_page import serving
from tests.drivers.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.thorough


@contextmanager
def served(folder: Path, port: int) -> Iterator[tuple[ReviewApp, ReviewServer]]:
    with (
        Project.open(folder) as project,
        serving("again", lambda server: ReviewApp(Session(project, Bodies()), server.viser), port=port) as running,
    ):
        yield running


def test_a_page_goes_on_with_the_next_tcfit(demo_project: Path, browser: "Browser", tmp_path: Path):
    folder = Path(shutil.copytree(demo_project, tmp_path / "demo.tcfit"))
    context = browser.new_context(viewport={"width": 1200, "height": 700})
    tab = context.new_page()
    card = tab.locator(".tcfit-card h2")
    with served(folder, 0) as (app, server):
        port = server.address.port
        tab.goto(server.gate.link)
        page = until(lambda: next((p for p in app.pages.values() if p.tab.ready), None), "the page")
        app.post(lambda: page.tab.session.edit(MarkBad(frames=(1,), joints=(4,)), author=page.tab.author))
        until(lambda: app.session.project.log, "the edit")
    until(lambda: card.is_visible() and "cannot be reached" in card.inner_text(), "the loss")
    with served(folder, port) as (app, server):
        assert server.address.port == port
        until(lambda: "started again" in card.inner_text(), "what to do")
        other = context.new_page()
        other.goto(server.gate.link)
        until(lambda: sum(p.tab.ready for p in app.pages.values()) == 2, "both pages")
        tab.bring_to_front()
        until(lambda: not card.is_visible(), "the end of the loss")
        for one in (tab, other):
            until(lambda one=one: _lists_an_edit_of_its_own(one), "the edit")
    context.close()


def test_a_tab_opens_a_second_tcfit_on_another_port(demo_project: Path, browser: "Browser", tmp_path: Path):
    folders = [Path(shutil.copytree(demo_project, tmp_path / name)) for name in ("one.tcfit", "other.tcfit")]
    context = browser.new_context(viewport={"width": 1200, "height": 700})
    tab = context.new_page()
    with served(folders[0], 0) as one, served(folders[1], 0) as other:
        for app, server in (one, other, one):
            tab.goto(server.gate.link)
            until(lambda app=app: any(p.tab.ready for p in app.pages.values()), "the page")
            tab.wait_for_selector("html.tcfit-ready", state="attached")
    context.close()


@pytest.mark.slow
def test_a_page_goes_on_after_a_long_pause(demo_project: Path, browser: "Browser", tmp_path: Path):
    """Chromium holds connections back after some 16 that failed, for longer than viser waits for one."""
    folder = Path(shutil.copytree(demo_project, tmp_path / "demo.tcfit"))
    context = browser.new_context(viewport={"width": 1200, "height": 700})
    tab = context.new_page()
    with served(folder, 0) as (app, server):
        port = server.address.port
        tab.goto(server.gate.link)
        until(lambda: any(p.tab.ready for p in app.pages.values()), "the page")
    tab.wait_for_timeout(40_000)
    with served(folder, port) as (app, server):
        other = context.new_page()
        other.goto(server.gate.link)
        until(lambda: sum(p.tab.ready for p in app.pages.values()) == 2, "both pages")
        until(lambda: tab.locator(".tcfit-card").is_hidden(), "the end of the loss")
    context.close()


def _lists_an_edit_of_its_own(tab: "Page") -> bool:
    # A page that comes back gets its panels anew, maybe only now, and the first of them is open then.
    tab.get_by_role("tab", name="Correct", exact=True).click()
    if (fold := tab.get_by_role("button", name="▸ Corrections")).is_visible():
        fold.click()
    return tab.locator("tr", has_text="marked bad").get_by_text(re.compile("^you$")).is_visible()
