"""An app with two browser tabs on one of two clips, below the browser, and what it has acknowledged.

The thread that plays a flow is the app's drawing thread. The tabs are real pages on viser clients without a
connection; the worker and the tasks have their usual threads.
"""

import gc
import logging
import shutil
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import platformdirs
import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.io.motion.smplifyx import write_smplifyx
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting import edit_follower, worker
from tcfit_app.project.edits.edit_log import LogEntry, encode
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review import app as app_module
from tcfit_app.review.app import ReviewApp
from tcfit_app.review.browser import page_events
from tcfit_app.review.page import Page
from tcfit_app.review.session import session as session_module
from tcfit_app.review.session.session import Session
from tcfit_app.review.tab.state import FitSettings
from tests.flows.disk import Disk, disk
from tests.samples.project_samples import CAMERA, sample_params
from tests.samples.sessions import QUICK, OneBody, idle, session_of, small_clip
from tests.samples.tiny_body import make_tiny_body

PATIENCE = 60.0
"""Seconds after which something counts as hanging."""
CLIPS = ("fitted.tcfit", "new.tcfit")
"""With one whole fit, and with none."""
TABS = ("first tab", "second tab")


class Broken(AssertionError):
    """Something that must hold after each flow does not."""


@cache
def body() -> BodyModel:
    """The body of all flows."""
    return make_tiny_body()


@cache
def clips() -> Path:
    """A folder with the clips, and another program's result; to be copied."""
    folder = Path(tempfile.mkdtemp(prefix="flows-"))
    for name in CLIPS:
        Project.create(folder / name, small_clip(body())).close()
    with session_of(folder / CLIPS[0], body()) as session:
        session.fit_everything(QUICK, kind="smplx", gender="neutral")
        idle(session)
    frames = len(small_clip(body()))
    stems = [f"walk_{frame:06d}" for frame in range(frames)]
    params = sample_params(3, frames)
    write_smplifyx(folder / "smplifyx", params, stems=stems, camera=CAMERA, body=body(), frame_rate=25.0)
    gc.collect()
    gc.freeze()  # what is there by now is not looked through after each flow
    return folder


@cache
def server() -> viser.ViserServer:
    """A server that nobody connects to."""
    return viser.ViserServer(host="127.0.0.1", port=0, verbose=False)


class Errors(logging.Handler):
    """Unforeseen errors that were logged, but for those that the flow itself has caused."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.found: list[str] = []
        self.expected: tuple[str, ...] = ("No space left on device", "Bomb: in ")

    def emit(self, record: logging.LogRecord) -> None:
        """Keep it."""
        text = self.format(record)
        if not any(expected in text for expected in self.expected):
            self.found.append(text)


class World:
    """See the module. Use `world`."""

    def __init__(self, folder: Path, disk: Disk, errors: Errors) -> None:
        self.folder, self.disk, self.errors = folder, disk, errors
        self.acknowledged: dict[str, list[tuple[int, str]]] = {name: [] for name in CLIPS}
        """By clip: the entries of its edit log whose call has returned."""
        self.mend: list[Callable[[], None]] = []
        """Ends faults that have not occurred."""
        self._clients = 0
        self._opened: dict[str, viser.ClientHandle] = {}
        self._grave: tuple[Path, dict[str, list[tuple[int, str]]]] | None = None
        """What a killed process has left, and what it had acknowledged."""
        self.open(CLIPS[0])

    # --- what the app is ---

    def open(self, clip: str) -> None:
        """Open a clip in both tabs."""
        self.clip = clip
        try:
            self.project = Project.open(self.folder / clip)
        except InputError:  # the disk is full: the user makes room, and tries again
            self.disk.room = None
            self.project = Project.open(self.folder / clip)
        append = self.project.append

        def acknowledged(*given: Any, **named: Any) -> LogEntry:
            entry = append(*given, **named)
            self.acknowledged[clip].append((entry.id, encode(entry.action)))
            return entry

        self.project.append = acknowledged
        self.session = Session(self.project, OneBody(body()))  # pyright: ignore[reportArgumentType]
        self.app = ReviewApp(self.session, server(), listen=False)
        for name in TABS:
            self.connect(name)

    def connect(self, name: str) -> None:
        """Open a browser tab, or reconnect one that has lost its connection."""
        self._clients += 1
        connection = MagicMock(client_id=self._clients)
        client = viser.ClientHandle(connection, server())
        client.camera = MagicMock(image_width=1000, image_height=700)
        self._opened[name] = client
        _finish(self.app.connected(client))
        self.turn()
        hello = page_events.Hello(tab=name, width=960, height=640, browser=name[:8])
        self.page(name).tab.receive(hello)
        if name != TABS[0]:  # half of a flow's time would go into the panels of the other tab
            self.page(name)._draw_panels = lambda now: None
        self.turn()
        settings = FitSettings(config=QUICK, preset="paper")
        if self.page(name).tab.state.settings.config != QUICK:
            self.page(name).tab.set(settings=settings)

    def disconnect(self, name: str) -> None:
        """Lose a tab's connection."""
        _finish(self.app.disconnected(self._opened.pop(name)))
        self.turn()

    def page(self, name: str) -> Page:
        """A tab's page."""
        return self.app.pages[self._opened[name].client_id]

    def send(self, name: str, *events: page_events.PageEvent) -> None:
        """Let a tab's page send events, and the app take and answer them."""
        for event in events:
            self.page(name).tab.receive(event)
        self.turn()

    def turn(self) -> None:
        """One turn of the app's loop."""
        self.app.turn(0.0)

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Let the app work until something is so. Raises Broken if it hangs: nothing advances any more."""
        self.turn()  # commands are waiting
        advanced, since = self._advanced(), time.monotonic()
        while not condition():
            if time.monotonic() > since + PATIENCE:
                raise Broken(f"waited {PATIENCE:g} s for {what}")
            time.sleep(0.002)
            self.turn()
            if (now := self._advanced()) != advanced:
                advanced, since = now, time.monotonic()

    def _advanced(self) -> object:
        """How far jobs and tasks are."""
        jobs = {number: job.progress for number, job in self.session.jobs.items()}
        return jobs, [(task.title, task.share) for task in self.session.tasks._running]

    @property
    def idle(self) -> bool:
        """Whether nothing is going on."""
        session = self.session
        return not (session.jobs or session.edit_follower.busy or session.tasks.busy)

    def close(self) -> None:
        """Close the clip, as the app does when its last tab has left."""
        begun = time.monotonic()
        self.app.close()
        self.project.close()
        if time.monotonic() - begun > PATIENCE / 2:
            raise Broken("closing took too long")
        self._opened.clear()
        del self.app, self.session, self.project  # who holds them after that, leaks them

    def switch(self) -> None:
        """Close this clip and open the other one."""
        self.close()
        self.open(CLIPS[1 - CLIPS.index(self.clip)])

    def reopen(self) -> None:
        """Close everything; the projects open again as they were."""
        log, runs = self.project.log, [(run.id, run.name, run.state) for run in self.project.runs.all()]
        self.close()
        with Project.open(self.folder / self.clip) as again:
            _expect(again.log == log, "the edit log differs after the project was opened again")
            found = [(run.id, run.name, run.state) for run in again.runs.all()]
            _expect(found == runs, f"the runs were {runs}, and are {found} after the project was opened again")

    # --- a killed process ---

    def kill_at(self, writes: int) -> None:
        """Let the process be killed after some more writes: what is on the disk then goes on, see `die`."""

        def killed() -> None:
            copy = self.folder.with_name(f"{self.folder.name} killed")
            shutil.copytree(self.folder, copy, symlinks=True, ignore=_pipes)
            self._grave = copy, {name: list(entries) for name, entries in self.acknowledged.items()}

        self.disk.killed, self.disk.fuse = killed, writes

    def die(self) -> bool:
        """Go on with what the killed process has left, if it has been killed by now."""
        grave, self._grave = self._grave, None
        if grave is None:
            return False
        self.disk.room = None
        self.close()
        shutil.rmtree(self.folder)
        grave[0].rename(self.folder)
        lost = {name: grave[1][name] for name in CLIPS}
        self.acknowledged = lost
        self.open(self.clip)
        log = [(entry.id, encode(entry.action)) for entry in self.project.log]
        _expect(log[: len(lost[self.clip])] == lost[self.clip], "the killed process lost acknowledged edits")
        self.acknowledged[self.clip] = log  # the one under way may have been written
        return True

    # --- what must hold ---

    def check(self) -> None:
        """What must hold once there is room on the disk again and nothing is going on. Raises Broken."""
        self.disk.room = self.disk.fuse = None
        while self.mend:
            self.mend.pop()()
        self.die()
        self.until(lambda: self.idle, "jobs, edits to be followed and tasks")
        session = self.session
        runs = session.project.runs.all()
        running = [run.name for run in runs if run.state == "running"]
        _expect(not running, f"{running} running without a job")
        _expect(not session._unended and not session.fits.unwritten, "ends of runs are not written")
        self._check_log()
        for run in runs:
            if run.stored:
                self._check_fit(run)
        self._check_undone_corrections()
        _expect(not self.errors.found, "unforeseen errors:\n" + "\n".join(self.errors.found))

    def _check_log(self) -> None:
        now = [(entry.id, encode(entry.action)) for entry in self.project.log]
        _expect(now == self.acknowledged[self.clip], "the edit log differs from what was acknowledged")
        with Project.open(self.project.folder, read_only=True) as stored:
            _expect(
                [(entry.id, encode(entry.action)) for entry in stored.log] == now, "the edit log on the disk differs"
            )
            _expect(stored.marks.all() == self.project.marks.all(), "the marks on the disk differ")
            _expect(not stored.damage, f"the project is damaged: {stored.damage}")
            ours, theirs = self.project.corrected, stored.corrected
            _expect(np.array_equal(ours.xy, theirs.xy), "the corrected keypoints on the disk differ")

    def _check_fit(self, run: Run) -> None:
        shown, stored = self.session.fits.fit(run), self.project.runs.load(run.id)
        sums = f"{_sums(shown)} and {_sums(stored)}"
        _expect(_same(shown, stored), f"{run.name} ({run.kind}) on show differs from the one on the disk: {sums}")

    def _check_undone_corrections(self) -> None:
        """Corrections that were all undone are the run that they correct."""
        for run in self.project.runs.corrections():
            parent = None if run.parent is None else self.session.fits.run(run.parent)
            if run.emptied and parent is not None:
                fits = [self.session.fits.fit(one) for one in (run, parent)]
                _expect(_same(*fits), f"{run.name}, all undone, differs from {parent.name}")


def _expect(condition: bool, broken: str) -> None:
    if not condition:
        raise Broken(broken)


def _same(one: FitResult, other: FitResult) -> bool:
    if len(one.phases) != len(other.phases):
        return False
    pairs = zip(vars(one.last.params).values(), vars(other.last.params).values(), strict=True)
    return all(np.array_equal(a.numpy(), b.numpy()) for a, b in pairs)


def _sums(fit: FitResult) -> dict[int, list[float]]:
    """Sums of the parameters of each phase, which tell two versions of a fit apart."""
    return {one.phase: [float(values.sum()) for values in vars(one.params).values()] for one in fit.phases}


def _pipes(folder: str, names: list[str]) -> list[str]:
    return [name for name in names if (Path(folder) / name).is_fifo()]


def _alive() -> Counter[str]:
    """Objects that must not outlive a closed clip, and threads."""
    gc.collect()
    kinds = (FitResult, Session, Page, Project)
    found = Counter(type(one).__name__ for one in gc.get_objects() if type(one) in kinds)
    found["threads"] = sum(thread.name.startswith("tcfit") for thread in threading.enumerate())
    return found


@contextmanager
def world() -> Iterator[World]:
    """A world of its own. Raises Broken at the end if closing it leaves something behind."""
    clips()
    before, errors = _alive(), Errors()
    folder = Path(tempfile.mkdtemp(prefix="flow-"))
    shutil.copytree(clips(), folder / "lab")
    with pytest.MonkeyPatch.context() as patch, disk() as made:
        patch.setattr(platformdirs, "user_data_path", lambda *given, **named: folder)
        # Others keep errors with their tracebacks, and so everything that these refer to.
        patch.setattr(logging.getLogger(), "handlers", [errors])
        patch.setattr(edit_follower, "SETTLING", 0.0)
        patch.setattr(worker, "LINGER", 0.05)
        patch.setattr(session_module, "RETRY", 0.0)
        patch.setattr(app_module, "EVERY", 0.0)
        built = World(folder / "lab", made, errors)
        try:
            yield built
            made.room = made.fuse = None
            if hasattr(built, "app"):
                built.close()
        except BaseException:
            made.room = made.fuse = None
            if hasattr(built, "app"):
                with suppress(Exception):  # the first error counts
                    built.close()
            raise
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    del built
    left = _alive() - before
    _expect(not left, f"left behind: {dict(left)}")


def _finish(coroutine: Coroutine[Any, Any, None]) -> None:
    """Run a coroutine that waits for nothing: a loop may be running in this thread after browser tests."""
    try:
        coroutine.send(None)
    except StopIteration:
        return
    raise AssertionError("it waits")
