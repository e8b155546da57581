"""A page of the review app without a browser: its panels are real, what it sends is kept in a list."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast
from unittest.mock import MagicMock

import viser

from tcfit_app.bodies import Bodies
from tcfit_app.desk import Desk
from tcfit_app.page import Page
from tcfit_app.project import Project
from tcfit_app.session import Session
from tcfit_app.view.page_events import Press
from tests.app.project_samples import BODY, CONFIG, sample_clip, sample_fit


def sample_project(folder: Path, *names: str) -> Project:
    """A project of six frames with a finished run for each name."""
    project = Project.create(folder, sample_clip())
    for seed, name in enumerate(names):
        run = project.runs.start(CONFIG, body=BODY, edits_seen=0, name=name)
        project.runs.finish(run.id, sample_fit(seed))
    return project


class LonePage:
    """A page, and what its panels send."""

    def __init__(self, page: Page, sent: list[Any]) -> None:
        self.page, self.sent = page, sent

    def draw(self) -> list[Any]:
        """Let the panels draw; the messages that this took."""
        self.sent.clear()
        for panel in self.page.panels:
            panel.draw()
        return list(self.sent)

    def html(self) -> str:
        """All HTML that the panels show."""
        self.draw()
        handles = [h for h in self._children() if isinstance(h, viser.GuiHtmlHandle)]
        return "\n".join(handle.content for handle in handles)

    def _children(self) -> list[Any]:
        containers = self.page.client.gui._container_handle_from_uuid.values()
        return [child for container in containers for child in container._children.values()]

    def field(self, label: str) -> Any:
        """viser's input with this label."""
        return next(h for h in self._children() if getattr(h, "label", None) == label)

    def press(self, command: str, value: str = "") -> None:
        """As if a button was pressed."""
        self.page.receive(Press(command, value))

    def enter(self, label: str, value: Any) -> None:
        """As if the user had set an input."""
        handle = self.field(label)
        handle._impl.value = value  # so viser does before it calls
        self.call_back(handle, MagicMock())

    def call_back(self, handle: Any, client: Any) -> None:
        """Run an input's callbacks, for an event of a client or, with None, of the server."""
        for callback in handle._impl.update_cb:
            asyncio.run(callback(viser.GuiEvent(client=client, client_id=None, target=handle)))


@contextmanager
def lone_page(
    server: viser.ViserServer, project: Project, do: Callable[[Callable[[], None]], None] | None = None
) -> Iterator[LonePage]:
    """A page of a project whose elements belong to a server that nobody is connected to.

    Args:
        server: gets the elements.
        project: open.
        do: how callbacks get to the drawing thread; at once by default.
    """
    client = MagicMock()
    client.gui, client.scene, client.client_id = server.gui, server.scene, 0
    client.camera.image_width, client.camera.image_height = 1000, 700
    session = Session(project, Bodies())
    desk = Desk(session, lambda: None)
    sent: list[Any] = []
    queue = server.gui._websock_interface.queue_message
    server.gui._websock_interface.queue_message = sent.append  # pyright: ignore[reportAttributeAccessIssue]
    try:
        run = do or (lambda command: command())
        yield LonePage(Page(cast(viser.ClientHandle, client), desk, run, {}), sent)
    finally:
        server.gui._websock_interface.queue_message = queue
        server.gui.reset()
        session.close()
        desk.close()
