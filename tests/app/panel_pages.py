"""A page whose panels are made without a browser: what they send is recorded, and a user's acts are called."""

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import viser
from viser._gui_handles import GuiEvent

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.config import FitConfig, ShapeSample, SolverSettings, Temporal, Weights
from fitting_core.errors import InputError
from tcfit_app.bodies import Bodies
from tcfit_app.changes import Changes
from tcfit_app.desk import Desk
from tcfit_app.page import Page
from tcfit_app.project import Project
from tcfit_app.session import Notice, Session
from tcfit_app.storage.runs import BodyRecord
from tcfit_app.submitting import Submitting
from tcfit_app.view_state import FitSettings, ViewState
from tests.scenes import arms_in_motion, clip_of, hidden, keypoints_of

FRAMES = 6
PATIENCE = 60.0
"""Seconds after which a test gives up."""
QUICK = FitConfig(
    weights=replace(Weights(), collision=(0.0,) * 5),
    pose_prior="relaxed",
    hip_weight=1.0,
    shape_sample=ShapeSample(size=2, stages=(5,)),
    temporal=Temporal(mode="global", weight=7.0, stages=(5,)),
    settings=SolverSettings(iterations=2),
)


class TinyBodies(Bodies):
    """Only the tiny body, as neutral SMPL-X."""

    def __init__(self, body: BodyModel) -> None:
        super().__init__()
        self.body = body

    def check(self, *, kind: str, gender: str) -> None:
        if (kind, gender) != ("smplx", "neutral"):
            raise InputError(f"No {gender} {kind} body. Put <{kind.upper()}>.npz there.")

    def find(self, *, kind: str = "smplx", gender: str = "neutral") -> BodyModel:
        self.check(kind=kind, gender=gender)
        return self.body

    def of(self, record: BodyRecord) -> BodyModel:
        return self.body


class Client:
    """Stands for viser's tab."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.gui, self.atomic = server.gui, server.atomic
        self.downloads: dict[str, bytes] = {}

    def send_file_download(self, name: str, content: bytes, save_immediately: bool = False) -> None:
        self.downloads[name] = content


class PanelPage(Page):
    """A page without a picture."""

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        self.client, self.session = Client(server), session  # pyright: ignore
        self.desk = Desk(session, lambda: None)
        self.length, self.first_frame = self.desk.length, session.project.clip.first_frame
        self.state = ViewState(settings=FitSettings(config=QUICK, preset="paper"))
        self.author, self.changes, self.submitting = "test", Changes(), Submitting(self)
        self.status = SimpleNamespace(problem="")  # pyright: ignore
        self.message = ("", 0.0)
        self.notices: list[Notice] = []
        self._do: Callable[[Callable[[], None]], None] = lambda command: command()
        self._remembered, self._tab = {}, None
        self.sent: list[Any] = []
        session.tell = self.notify

    def notify(self, notice: Notice) -> None:
        self.notices.append(notice)

    def until(self, there: Callable[[], object], panel: Any = None) -> None:
        """Take the worker's news, and draw, until something is there."""
        end = time.monotonic() + PATIENCE
        while not there():
            assert time.monotonic() < end
            self.session.take_news()
            if panel is not None:
                panel.draw()
            time.sleep(0.005)

    def fit(self, choice: Any = None) -> Any:
        """As a page does, or with no choice a whole fit to its end; its run."""
        if choice is not None:
            return super().fit(choice)
        run = self.session.fit_everything(QUICK, kind="smplx", gender="neutral")
        self.until(lambda: not self.session.jobs)
        return self.session.project.runs.get(run.id)

    def find(self, label: str) -> Any:
        """The element with this label, or whose label begins so."""
        handles = [h for h in self.client.gui._gui_input_handle_from_uuid.values() if hasattr(h, "label")]
        return next(h for h in handles if h.label == label or str(h.label).startswith(label))

    def enter(self, label: str, value: Any) -> None:
        """What viser does when the user enters something."""
        handle = self.find(label)
        handle._impl.value = value
        self._call(handle, client=self.client)

    def press(self, label: str) -> None:
        """What viser does when the user presses a button."""
        self._call(self.find(label), client=self.client)

    def echo(self, label: str) -> None:
        """What viser does when the server has set a value."""
        self._call(self.find(label), client=None)

    @staticmethod
    def _call(handle: Any, client: Any) -> None:
        for callback in handle._impl.update_cb:
            asyncio.run(callback(GuiEvent(client=client, client_id=None, target=handle)))

    def html(self) -> str:
        """All HTML, of hidden elements too."""
        containers = self.client.gui._container_handle_from_uuid.values()
        return "".join(getattr(element, "content", "") for one in containers for element in one._children.values())


_CLIPS: dict[str, Clip] = {}


def _clip_of(body: BodyModel) -> Clip:
    """Six frames of a body's keypoints; made once, as that takes a second."""
    if body.hash not in _CLIPS:
        _CLIPS[body.hash] = clip_of(hidden(keypoints_of(body, arms_in_motion(FRAMES)), slice(25, 137)))
    return _CLIPS[body.hash]


@contextmanager
def panel_page(server: viser.ViserServer, folder: Path, body: BodyModel) -> Iterator[PanelPage]:
    """A page on a new project of six frames."""
    clip = _clip_of(body)
    server.gui.reset()
    queue = server.gui._websock_interface.queue_message
    with Project.create(folder, clip) as project:
        session = Session(project, TinyBodies(body))
        page = PanelPage(server, session)

        def record(message: Any) -> Any:
            page.sent.append(message)
            return queue(message)

        server.gui._websock_interface.queue_message = record  # pyright: ignore
        try:
            yield page
        finally:
            server.gui._websock_interface.queue_message = queue  # pyright: ignore
            session.close()
            page.desk.close()
