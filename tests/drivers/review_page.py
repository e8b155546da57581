"""The whole review app in a real browser, for tests: served from a thread of this process."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting_core.config.schema import PRESETS
from fitting_core.keypoints import INDEX
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.project.people import OpenPeople
from tcfit_app.project.project import Project
from tcfit_app.review.app import ReviewApp
from tcfit_app.review.browser.channel import web_files
from tcfit_app.review.page import Page
from tcfit_app.review.session.session import Session
from tcfit_app.server.serving import ReviewServer, review_server
from tests.drivers.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator
    from playwright.sync_api import Page as Tab

QUICK = replace(
    PRESETS["tcfit"],
    relay_rounds=0,
    limb_flips=False,
    yaws="side_view",
    settings=replace(PRESETS["tcfit"].settings, iterations=8),
)
"""The default but for what takes long."""
PATIENCE = 60.0
"""Seconds after which a test gives up."""
_HARMLESS = ("WebGL", "GPU", "THREE.Clock", "GL Driver")
"""Console messages of the browser and of viser's libraries that say nothing about the app."""


@dataclass
class Reviewing:
    """A review with one tab."""

    app: ReviewApp
    server: ReviewServer
    tab: "Tab"
    complaints: list[str] = field(default_factory=list)
    """Errors in the tab's console."""

    @property
    def session(self) -> Session:
        """Of whom the tab shows."""
        return self.page.tab.session

    @property
    def page(self) -> Page:
        """The tab's side in the server: the last that connected."""
        return list(self.app.pages.values())[-1]

    @property
    def frame(self) -> int:
        """The tab's."""
        return self.page.tab.state.frame

    def press(self, key: str, condition: Callable[[], Any]) -> None:
        """Press a key and wait for what it does."""
        self.tab.keyboard.press(key)
        until(condition, f"the effect of {key}")

    def panel(self, title: str) -> None:
        """Show a panel. While panels arrive, a press on a tab would drag it out of their row."""
        self.tab.wait_for_selector("html.tcfit-ready", state="attached")
        tab = self.tab.get_by_role("tab", name=title, exact=True)
        if tab.get_attribute("aria-selected") != "true":
            tab.click()

    def field(self, label: str) -> "Locator":
        """viser's input with a label, which is no label to the browser."""
        return self.tab.locator(f"xpath=//*[normalize-space(text())='{label}']/following::input[1]")

    def place(self, joint: str, poster: int = 0) -> tuple[float, float]:
        """Where a keypoint of the frame on show is in the window."""
        x, y = self.session.project.corrected.xy[self.frame, INDEX[joint]].tolist()
        return tuple(self.tab.evaluate("([x, y, p]) => tcfit.place(x, y, p)", [x, y, poster]))

    def scale(self) -> float:
        """Window pixels for each pixel of the image."""
        a, b = self.tab.evaluate("() => [tcfit.place(0, 0), tcfit.place(100, 0)]")
        return float(np.hypot(b[0] - a[0], b[1] - a[1]) / 100)

    def rest(self) -> None:
        """Until nothing is being fitted, the tab shows its frame and layout, and the camera stands still."""
        until(lambda: not self.session.jobs and not self.session.edit_follower.busy, "the fits")
        for _ in range(2):  # all that is on show now has been drawn once
            turned = threading.Event()
            self.app.post(turned.set)
            assert turned.wait(PATIENCE), "waited too long for the app to draw"
        until(self._shows_its_state, "the tab's frame and layout")
        before = None
        while (now := self.tab.evaluate("() => tcfit.place(0, 0).concat(tcfit.place(100, 100))")) != before:
            before = now
            self.tab.wait_for_timeout(150)

    def _shows_its_state(self) -> bool:
        frame, layout = self.tab.evaluate("() => [tcfit.state('keypoints')?.frame, tcfit.state('layout')]")
        tab = self.page.tab
        if layout is None or tab.state.mode == "space":
            return layout is not None and layout["mode"] == "space"
        kinds = {poster.get("kind") for poster in layout["posters"]}
        side = tab.state.side and tab.shown.held is not None
        return frame == tab.state.frame and layout["mode"] == "poster" and ("side" in kinds) == side


@contextmanager
def reviewing(folder: Path, browser: "Browser", *, read_only: bool = False, title: str = "test") -> Iterator[Reviewing]:
    """Serve a project and open it in a tab."""
    with (
        Project.open(folder, read_only=read_only) as project,
        serving(title, lambda server: ReviewApp(Session(project, Bodies()), server.viser)) as (app, running),
    ):
        try:
            yield opened(app, running, browser)
        finally:
            for context in browser.contexts:
                context.close()


@contextmanager
def serving(
    title: str, made: Callable[[ReviewServer], ReviewApp], *, port: int = 0
) -> Iterator[tuple[ReviewApp, ReviewServer]]:
    """Let an app draw, behind a server."""
    server = review_server(title, port=port, open_browser=False, scripts=web_files(), say=lambda text: None)
    with server as running:
        app = made(running)
        thread = threading.Thread(target=app.run)
        thread.start()
        try:
            yield app, running
        finally:
            app.stop()
            thread.join(PATIENCE)
            app.close()


def reviewed_people(people: OpenPeople, server: ReviewServer, *, first: int = 0) -> ReviewApp:
    """The app of a clip's people."""
    bodies = Bodies()
    sessions = [Session(project, bodies) for _, project in people.projects]
    return ReviewApp(sessions[first], server.viser, people=people, sessions=sessions)


def opened(app: ReviewApp, server: ReviewServer, browser: "Browser", *, script: str = "") -> Reviewing:
    """One more tab, in a context of its own, as another person's browser has it; a script runs in it from the start."""
    known = len(app.pages)
    tab = browser.new_context(viewport={"width": 960, "height": 640}).new_page()
    tab.add_init_script(script)
    tab.context.add_cookies([{"name": "tcfit-hints", "value": "read", "url": server.address.url}])
    made = Reviewing(app=app, server=server, tab=tab)

    def note(text: str) -> None:
        if not any(word in text for word in _HARMLESS):
            made.complaints.append(text)

    tab.on("console", lambda message: note(message.text) if message.type == "error" else None)
    tab.on("pageerror", lambda error: note(str(error)))
    tab.goto(server.gate.link)
    until(lambda: len(app.pages) > known and made.page.tab.ready, "the page")
    tab.evaluate("() => document.querySelectorAll('.mantine-Notification-closeButton').forEach((b) => b.click())")
    return made
