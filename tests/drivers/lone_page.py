"""A page of the review app without a browser: its panels are real, what it sends is kept in a list."""

import asyncio
import re
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from typing import Any, cast
from unittest.mock import MagicMock

import viser

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.fits import Shown
from tcfit_app.fitting.reports import Notice
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.browser.page_events import Key, PageEvent, Press
from tcfit_app.review.page import Page
from tcfit_app.review.session.session import Session
from tcfit_app.review.shared.drawing_data import DrawingData
from tcfit_app.review.tab.people import ReviewedPerson
from tcfit_app.review.tab.state import FitSettings
from tcfit_app.review.tab.tab import Tab
from tcfit_app.server.page_files import PageFiles
from tests.samples.project_samples import BODY, CONFIG, FRAMES, sample_clip, sample_fit
from tests.samples.sessions import PATIENCE, QUICK, OneBody, small_clip

_BUTTON = re.compile(r'<button type="button" data-tcfit="([^"]*)" data-value="([^"]*)"([^>]*)><span>(.*?)</span>')

_BETWEEN_DRAWINGS = 0.05
"""Seconds: who waits leaves the processor to what is waited for."""


def sample_project(folder: Path, *names: str, frames: int = FRAMES) -> Project:
    """A project of so many frames with a finished run for each name."""
    project = Project.create(folder, sample_clip(frames))
    for seed, name in enumerate(names):
        run = project.runs.start(CONFIG, body=BODY, edits_seen=0, name=name)
        project.runs.finish(run.id, sample_fit(seed, frames=frames))
    return project


@dataclass(frozen=True)
class Button:
    """One of a panel's HTML."""

    label: str
    command: str
    value: str
    disabled: bool


def call_back(handle: Any, client: Any) -> None:
    """Run an input's callbacks, for an event of a client or, with None, of the server."""
    with ThreadPoolExecutor(1) as pool:  # as viser's: the browser of other tests has its loop in this thread
        for callback in handle._impl.update_cb:
            event = viser.GuiEvent(client=client, client_id=None, target=handle)
            pool.submit(asyncio.run, callback(event)).result()


class LonePage:
    """A page, what its panels send, and what a user does to them."""

    def __init__(self, page: Page, sent: list[Any]) -> None:
        self.page, self.sent = page, sent
        self.panels: list[Any] = list(page.panels)
        """Those that are drawn."""
        self.notices: list[Notice] = []
        self.downloads: dict[str, bytes] = {}
        page.tab.notify = page.tab.session.tell = self.notices.append  # pyright: ignore[reportAttributeAccessIssue]
        page.tab.client.send_file_download = self._download  # pyright: ignore[reportAttributeAccessIssue]

    def _download(self, name: str, content: bytes, save_immediately: bool) -> None:
        self.downloads[name] = content

    def only(self, *kinds: type) -> None:
        """Leave the other panels alone from now on: what they show may come at any time."""
        self.panels = [panel for panel in self.page.panels if isinstance(panel, kinds)]

    # --- what is seen ---

    def draw(self) -> list[Any]:
        """Let the panels draw; the messages that this took."""
        self.sent.clear()
        self.page.tab.look()
        self.page.bar.draw()
        self.page.header.draw(time.monotonic(), "")
        for panel in self.panels:
            panel.draw()
        return list(self.sent)

    def html(self) -> str:
        """All HTML that header, bar and panels show."""
        self.draw()
        handles = [h for h in self._children() if isinstance(h, viser.GuiHtmlHandle)]
        around = [self.page.tab.channel._sent[name].html for name in ("header", "bar")]  # pyright: ignore[reportAttributeAccessIssue, reportOptionalMemberAccess]
        return "\n".join([*around, *(handle.content for handle in handles)])

    def _children(self) -> list[Any]:
        containers = self.page.tab.client.gui._container_handle_from_uuid.values()
        return [child for container in containers for child in container._children.values()]

    def field(self, label: str) -> Any:
        """viser's input with this label."""
        return next(h for h in self._children() if getattr(h, "label", None) == label)

    def button(self, label: str) -> Button:
        """The button whose label begins so."""
        found = _BUTTON.finditer(self.html())
        made = (Button(_plain(m[4]), unescape(m[1]), unescape(m[2]), " disabled" in m[3]) for m in found)
        return next(button for button in made if button.label.startswith(label))

    # --- what the user does ---

    def press(self, command: str, value: str = "") -> None:
        """As if a button on show was pressed, or the key of an action; what cannot be done is raised."""
        self.draw()
        if command == "action":
            return self.page.receive(Key(action=value, repeat=False))
        assert self.page.tab.buttons.find(command, value), f"{command} {value} is not on show"
        self.page.receive(Press(command, value))

    def click(self, label: str) -> None:
        """As if the button whose label begins so was pressed; what cannot be done is told."""
        button = self.button(label)
        assert not button.disabled, f"{button.label} is off"
        self.page.tab.do(lambda: self.page.receive(Press(button.command, button.value)))

    def enter(self, label: str, value: Any) -> None:
        """As if the user had set an input."""
        handle = self.field(label)
        handle._impl.value = value  # so viser does before it calls
        call_back(handle, MagicMock())

    call_back = staticmethod(call_back)

    # --- fits ---

    @property
    def shown(self) -> Shown:
        """The fit on show, B."""
        found = self.page.tab.look().b
        assert found is not None
        return found

    @property
    def last_edit(self) -> Any:
        """What was written into the log last."""
        return self.page.tab.session.project.log[-1].action

    def idle(self) -> None:
        """Until no fit is running, and none follows an edit."""
        session = self.page.tab.session
        self.until(lambda: not session.jobs and not session.edit_follower.busy)

    def until(self, there: Callable[[], object]) -> None:
        """Take the worker's news, and draw, until something is there."""
        end, drawn = time.monotonic() + PATIENCE, 0.0
        while not there():
            assert time.monotonic() < end, "waited too long"
            self.page.tab.session.take_news()
            if time.monotonic() > drawn + _BETWEEN_DRAWINGS:
                self.draw()
                drawn = time.monotonic()
            time.sleep(0.005)

    def settle(self) -> None:
        """Until everything slow that was begun has ended."""
        self.until(lambda: not self.page.tab.session.tasks._running)

    def fit(self) -> Run:
        """A whole fit to its end."""
        session = self.page.tab.session
        run = session.fit_everything(QUICK, kind="smplx", gender="neutral")
        self.until(lambda: not session.jobs)
        return session.project.runs.get(run.id)


def _plain(html: str) -> str:
    return unescape(re.sub("<[^>]*>", "", html))


@contextmanager
def told(tab: Tab) -> Iterator[list[tuple[str, Any]]]:
    """The states that a page gets meanwhile, by their names, in their order."""
    channel, found = tab.channel, []
    usual = channel.send

    def send(name: str, state: Any) -> None:
        if channel._sent.get(name) != state:
            found.append((name, state))
        usual(name, state)

    channel.send = send
    try:
        yield found
    finally:
        channel.send = usual


@contextmanager
def lone_page(
    server: viser.ViserServer,
    project: Project,
    do: Callable[[Callable[[], None]], None] | None = None,
    *,
    bodies: Any = None,
) -> Iterator[LonePage]:
    """A page of a project whose elements belong to a server that nobody is connected to.

    Args:
        server: gets the elements.
        project: open.
        do: how callbacks get to the drawing thread; at once by default.
        bodies: where body models come from; by default those of this computer.
    """
    client = MagicMock()
    client.gui, client.scene, client.client_id = server.gui, server.scene, 0
    client.camera.image_width, client.camera.image_height = 1000, 700
    session = Session(project, bodies or Bodies())
    data = DrawingData(session, lambda: None)
    sent: list[Any] = []
    queue = server.gui._websock_interface.queue_message
    server.gui._websock_interface.queue_message = sent.append  # pyright: ignore[reportAttributeAccessIssue]
    try:
        run = do or (lambda command: command())
        for stored in session.fits.showable():
            with suppress(InputError):
                session.fits.fit(stored)  # which the drawing thread would not wait for
        files = PageFiles(here=True)
        receive: Callable[[PageEvent], None] = lambda event: run(page.tab.guarded(lambda: page.receive(event)))  # noqa: E731
        page = Page(
            Tab(cast(viser.ClientHandle, client), ReviewedPerson(data=data), do=run, receive=receive, files=files)
        )
        yield LonePage(page, sent)
    finally:
        server.gui._websock_interface.queue_message = queue
        server.gui.reset()
        session.close()
        data.close()


@contextmanager
def tiny_page(server: viser.ViserServer, folder: Path, body: BodyModel, kind: type) -> Iterator[LonePage]:
    """One panel on a new project of the tiny body, with settings that fit quickly."""
    with (
        Project.create(folder, small_clip(body)) as project,
        lone_page(server, project, bodies=OneBody(body)) as tested,
    ):
        tested.only(kind)
        tested.page.tab.set(settings=FitSettings(config=QUICK, preset="paper"))
        tested.draw()
        yield tested
