"""The review app: the drawing loop, and the tabs it draws."""

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import viser

from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.fitting.reports import Notice
from tcfit_app.project.people import OpenPeople
from tcfit_app.project.project import Project
from tcfit_app.project.storage.clip_review import Worst
from tcfit_app.review.browser.page_events import Hello, PageEvent
from tcfit_app.review.early_tabs import EarlyTabs
from tcfit_app.review.page import REST, Faults, Page
from tcfit_app.review.session.session import Session
from tcfit_app.review.shared.drawing_data import DrawingData
from tcfit_app.review.shared.video_frames import Videos
from tcfit_app.review.tab.people import Group, ReviewedPerson
from tcfit_app.review.tab.tab import Tab, remember
from tcfit_app.server.gated_viser import visitor
from tcfit_app.server.page_files import PageFiles

TICK = 1 / 60
"""Seconds between two drawings while a clip plays; a drag's bodies wake the loop."""
IDLE = 1.0
"""As REST, once nothing was requested for LATELY and nothing is running."""
LATELY = 5.0
"""Seconds."""
MOST_COMMANDS = 5000
"""Commands that may wait for the drawing thread; further ones from pages are dropped."""
_END = 30.0
"""Seconds that the end of the drawing thread may take."""
EVERY = 20.0
"""Seconds between two times that the worst places are looked for."""
_PATIENCE = 5.0
"""Seconds for which the end waits for the worst place of a run of which none is kept."""
_log = logging.getLogger(__name__)


class ReviewApp:
    """An open clip: draws one person's project, or those of the clip's people, in every connected tab.

    Args:
        session: the open project; with several people that of the one shown first.
        server: behind its gate.
        files: the only folder whose files pages may name; None: see `PageFiles`.
        people: all people of the clip, if there are several.
        sessions: theirs, in the same order.
        listen: to all of the server's tabs; otherwise the server of several apps calls `connected` and `disconnected`.
        plays: new tabs open with the clip playing.
        early: has served tabs until now.
    """

    def __init__(
        self,
        session: Session,
        server: viser.ViserServer,
        *,
        files: Path | None = None,
        people: OpenPeople | None = None,
        sessions: Sequence[Session] = (),
        listen: bool = True,
        plays: bool = False,
        early: EarlyTabs | None = None,
    ) -> None:
        self.session, self._server, self._files, self._plays = session, server, files, plays
        self._commands: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._obeyed = 0.0
        """When something was last requested."""
        self._stop = threading.Event()
        self.people = self._people(people, sessions)
        self._first = next(someone for someone in self.people if someone.session is session)
        self.data = self._first.data
        self.pages: dict[int, Page] = {}
        """By client: the page of the person it shows."""
        self._pages: dict[int, dict[int, Page]] = {}
        """By client: the pages of everyone it has shown, by their numbers."""
        self.viewers: dict[int, str] = {}
        """By client: the names of the users who have it open, if the server of several apps reports them."""
        self.left = time.monotonic()
        """When the last of them left."""
        self._thread: threading.Thread | None = None
        self._shown: dict[str, int] = {}
        """The person each tab showed last, by the tab's own name."""
        self._faults = Faults(lambda notice: self._tell(self._first, notice))
        for someone in self.people:
            someone.session.tell = partial(self._tell, someone)
            someone.session.tasks.arrived = someone.session.worker.arrived = self._wake
        self._keeping = Keeping()
        self._early = {} if early is None else early.end()
        if listen:
            server.on_client_connect(self.connected)
            server.on_client_disconnect(self.disconnected)

    def _people(self, people: OpenPeople | None, sessions: Sequence[Session]) -> tuple[ReviewedPerson, ...]:
        if people is None:
            return (ReviewedPerson(data=DrawingData(self.session, self._wake)),)
        videos = Videos([session.project.footage for session in sessions], self._wake)
        return Group(people, [DrawingData(session, self._wake, videos) for session in sessions]).members

    async def connected(self, client: viser.ClientHandle) -> None:
        """A tab has come."""
        self.post(lambda: self._open(client))

    async def disconnected(self, client: viser.ClientHandle) -> None:
        """A tab is gone."""
        self.post(lambda: self._close(client.client_id))

    def post(self, command: Callable[[], object]) -> None:
        """Do something on the drawing thread, soon; from any thread."""
        self._commands.put(command)

    def _wake(self) -> None:
        self.post(lambda: None)

    def _take(self, command: Callable[[], None]) -> None:
        """Take a tab's command, unless too many are waiting: a foreign page may send more than can be done."""
        if self._commands.qsize() < MOST_COMMANDS:
            self.post(command)

    def _receive(self, client: int, event: PageEvent) -> None:
        """Give an event to the page that is on show by then: the first one may come before there is any."""

        def take() -> None:
            if (page := self.pages.get(client)) is None:
                return
            page.tab.guarded(lambda: page.receive(event))()
            if isinstance(event, Hello):
                self._go_back(client)

        self._take(take)

    def _open(self, client: viser.ClientHandle) -> None:
        number = client.client_id
        early = self._early.pop(number, None)
        whose = visitor(self._server, number)
        tab = Tab(
            client,
            self._first,
            do=self._take,
            receive=partial(self._receive, number),
            files=PageFiles(here=whose.here, root=self._files),
            visitor=whose,
            early=early,
        )
        tab.plays = self._plays
        tab.go_to = partial(self._go_to, number)
        tab.authors = lambda: [page.tab.author for page in self.pages.values()]
        self.pages[number] = Page(tab)
        self._pages[number] = {self._first.number: self.pages[number]}
        if early is not None:
            early.hand_over(partial(self._receive, number))

    def _go_to(self, client: int, someone: ReviewedPerson) -> None:
        """Show someone else in a tab."""
        page, known = self.pages.get(client), self._pages.get(client, {})
        if page is None or page.tab.someone is someone:
            return
        page.leave()
        if someone.number not in known:
            known[someone.number] = Page(page.tab.beside(someone))
        self.pages[client] = known[someone.number]
        self.pages[client].take_over_from(page)
        if page.tab.name is not None:
            remember(self._shown, page.tab.name, someone.number)

    def _go_back(self, client: int) -> None:
        """After a reload, show the person the tab showed before."""
        page = self.pages.get(client)
        if page is not None and (known := self._shown.get(page.tab.name or "")) is not None:
            self._go_to(client, self.people[known])

    def _close(self, client: int) -> None:
        self.pages.pop(client, None)
        for page in self._pages.pop(client, {}).values():
            page.close()

    def _tell(self, about: ReviewedPerson, notice: Notice) -> None:
        for page in self.pages.values():
            other = page.tab.someone is not about
            page.tab.notify(replace(notice, title=f"{about.name}: {notice.title}") if other else notice)

    @property
    def project(self) -> Project:
        """Of the person shown first."""
        return self.session.project

    @property
    def busy(self) -> bool:
        """Whether it has a viewer, or is working."""
        sessions = [someone.session for someone in self.people]
        return bool(self.viewers) or any(one.jobs or one.tasks.busy or one.edit_follower.busy for one in sessions)

    def start(self) -> None:
        """Call `run` on a thread of its own, which `close` ends."""
        self._thread = threading.Thread(target=self.run, name=f"tcfit reviews {self.project.folder.name}")
        self._thread.start()

    def run(self) -> None:
        """Draw until `stop` is called."""
        self.data.warm_up()  # while the browser loads the page
        while not self._stop.is_set():
            self.turn(self._patience())

    def turn(self, patience: float) -> None:
        """Do what was requested, waiting up to `patience` seconds for it; take the workers' news; draw."""
        self._obey(patience)
        now = time.monotonic()
        for someone in self.people:
            self._faults.attempt(f"take the worker's news {someone.name}", someone.session.take_news, now)
        if (group := self._first.group) is not None:
            self._faults.attempt("undo half an exchange", group.take_up, now)
        for number, page in list(self.pages.items()):
            self._faults.attempt(f"draw tab {number}", partial(page.draw, now), now)
        self._faults.attempt("keep the worst place", lambda: self._keeping.keep(one.data for one in self.people), now)

    def stop(self) -> None:
        """End `run`, from any thread."""
        self._stop.set()
        self.post(lambda: None)

    def close(self) -> None:
        """End all work. Finished work is on disk."""
        if self._thread is not None:
            self.stop()
            self._thread.join(_END)
        with suppress(InputError):  # write errors are reported to the tabs
            self._keeping.keep((one.data for one in self.people), last=True)
        for client in list(self._pages):
            self._close(client)
        for someone in self.people:
            someone.session.close()
        for someone in self.people:
            with suppress(InputError):  # the next opening takes longer
                keep_opening_body(someone.data)
            someone.data.close()

    def _patience(self) -> float:
        """Seconds until the next drawing if nothing is requested."""
        if any(page.tab.state.playing for page in self.pages.values()):
            return TICK
        busy = any(someone.session.tasks.busy for someone in self.people)
        rest = REST if busy or time.monotonic() - self._obeyed < LATELY else IDLE
        return min([rest, *(page.behind for page in self.pages.values() if page.behind)])

    def _obey(self, patience: float) -> None:
        """Do what was requested, waiting a while for the first command."""
        try:
            command = self._commands.get(timeout=patience)
            self._obeyed = time.monotonic()
            while True:
                self._do(command)
                command = self._commands.get_nowait()
        except queue.Empty:
            return

    @staticmethod
    def _do(command: Callable[[], object]) -> None:
        """Run a command; the loop survives any error. Tabs report their own."""
        try:
            command()
        except Exception:
            _log.exception("The review app could not do what was asked")


def keep_opening_body(data: DrawingData) -> None:
    """Store the body that a project opens with. Raises InputError if it cannot be posed or written."""
    project = data.session.project
    if not project.read_only and (body := data.opening_body()) is not None:
        project.keep_opening_body(body)


class Keeping:
    """Keeps the worst place of each person's last fit in the project, where the list of clips reads it."""

    def __init__(self) -> None:
        self._worst: dict[Project, Worst] = {}
        self._next = time.monotonic() + EVERY

    def keep(self, people: Iterable[DrawingData], *, last: bool = False) -> None:
        """Write it down if it is time to, or for the last time. Raises InputError if a project cannot be written."""
        if time.monotonic() < self._next and not last:
            return
        self._next = time.monotonic() + EVERY
        for data in people:
            self._keep_worst(data, _PATIENCE if last else 0.0)

    def _keep_worst(self, data: DrawingData, patience: float) -> None:
        session, project = data.session, data.session.project
        run = session.fits.meant(FitChoice())
        if project.read_only or run is None or run.state != "finished" or run.kind == "imported":
            return
        kept = project.review.now.worst
        if kept is not None and kept.run == run.id and kept.off:
            patience = 0.0
        end = time.monotonic() + patience
        try:
            while (worst := _worst(data)) is None and time.monotonic() < end:
                time.sleep(0.05)
        except InputError:  # which the panels tell
            return
        if worst is not None and self._worst.get(project) != worst:
            project.review.set_worst(worst)
            self._worst[project] = worst


def _worst(data: DrawingData) -> Worst | None:
    """That of the newest run; None while it is computed. Raises InputError if its fit or its body cannot be read."""
    shown = data.session.stored.show(FitChoice())
    if shown is not None and (problem := data.problem("suspects", shown)):
        raise InputError(problem)
    return None if shown is None or data.session.edit_follower.lags else data.worst(shown)
