"""One browser tab: what its gestures, its panels and its picture share. All of it is for the thread that draws."""

import logging
import time
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Literal

import viser

from fitting_core.errors import InputError
from tcfit_app.fitting.outbox import Notice
from tcfit_app.review.browser.channel import Channel
from tcfit_app.review.browser.page_events import PageEvent
from tcfit_app.review.scene.scene import SceneView
from tcfit_app.review.session.tasks import Task, Value, Work
from tcfit_app.review.shared.desk import Desk
from tcfit_app.review.tab.buttons import Buttons
from tcfit_app.review.tab.on_show import OnShow, on_show
from tcfit_app.review.tab.playback import Playback
from tcfit_app.review.tab.state import TabState
from tcfit_app.server.page_files import PageFiles

Do = Callable[[Callable[[], None]], None]
"""Runs something on the drawing thread, soon."""
_COLORS: dict[str, Literal["blue", "green", "red"]] = {"info": "blue", "done": "green", "error": "red"}
_SHORT, _LONG = 4.0, 12.0
"""Seconds for which a message stays."""
_log = logging.getLogger(__name__)


class Sent:
    """Remembers what was sent to a tab, a key for each thing, so that only what changed is sent again."""

    def __init__(self) -> None:
        self._keys: dict[str, Hashable] = {}

    def differs(self, name: str, *key: Hashable) -> bool:
        """Whether a thing's key is another one than the last time; from now on it is this one."""
        if name in self._keys and self._keys[name] == key:
            return False
        self._keys[name] = key
        return True

    @contextmanager
    def all_or_nothing(self) -> Iterator[None]:
        """Keys that `differs` remembers inside are forgotten again if an exception ends it: nothing was sent then."""
        before = dict(self._keys)
        try:
            yield
        except BaseException:
            self._keys = before
            raise


class Tab:
    """A tab that shows the project.

    Args:
        client: viser's tab.
        desk: what it draws from.
        do: how callbacks get to the drawing thread.
        receive: takes up what the page's script tells.
        remembered: states of tabs that were closed or reloaded, by the tab's own name.
        files: which files of this computer the page may name.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        desk: Desk,
        do: Do,
        receive: Callable[[PageEvent], None],
        remembered: dict[str, TabState],
        files: PageFiles,
    ) -> None:
        self.client, self.desk, self.session, self.files = client, desk, desk.session, files
        self.length = desk.length
        self.first_frame = desk.session.project.clip.first_frame
        """The number that users see for frame 0."""
        self.state = TabState()
        self.author = f"browser {client.client_id}"
        self.message: tuple[str, float] = ("", 0.0)
        """What was done last, and until when it is shown."""
        self.corrected: int | None = None
        """The run that this tab has corrected, until its corrections are on show."""
        self.playback = Playback(self.session.project.clip.frame_rate)
        self.buttons, self.sent = Buttons(), Sent()
        self._do, self._remembered = do, remembered
        self._name: str | None = None
        self._shown: OnShow | None = None
        self.channel = Channel(client, lambda event: self.do(lambda: receive(event)))
        self.scene = SceneView(client)

    # --- doing things ---

    def do(self, command: Callable[[], None]) -> None:
        """Run something on the drawing thread; for callbacks. What goes wrong is told in the tab."""
        self._do(self.guarded(command))

    def begin(self, title: str, work: Work[Value], then: Callable[[Value], None]) -> Task[Value]:
        """Do something slow beside the drawing thread. What goes wrong is told in the tab; it ends when that is closed.

        Args:
            title: What it is.
            work: See `Tasks.submit`.
            then: Gets what it has made, on the drawing thread.
        """

        def ended(task: Task[Value]) -> None:
            if task.state != "cancelled":
                self.guarded(lambda: then(task.result()))()

        return self.session.tasks.submit(title, work, owner=self, then=ended)

    def guarded(self, command: Callable[[], None]) -> Callable[[], None]:
        """A command that tells in the tab what goes wrong in it."""

        def run() -> None:
            try:
                command()
            except InputError as error:
                self.notify(Notice(title="That cannot be done", text=str(error), kind="error"))
            except Exception as error:
                _log.exception("A command failed")
                text = f"{type(error).__name__}: {error}. Nothing is lost; tcfit's terminal has the details."
                self.notify(Notice(title="Something went wrong in tcfit", text=text, kind="error"))

        return run

    def notify(self, notice: Notice) -> None:
        """Tell the user."""
        stay = _LONG if notice.kind == "error" else _SHORT
        self.client.add_notification(
            notice.title,
            notice.text,
            color=_COLORS[notice.kind],
            auto_close_seconds=stay,
        )

    def say(self, text: str) -> None:
        """Say in passing what was done."""
        self.message = (text, time.monotonic() + _SHORT)

    def refuse_read_only(self) -> None:
        """Raises InputError where nothing can be changed."""
        self.session.project.refuse_read_only()

    # --- its state ---

    @property
    def ready(self) -> bool:
        """Whether the page's script has said hello."""
        return self._name is not None

    def greet(self, name: str) -> None:
        """The page's script is there, and calls itself so; a name that is known brings its state back."""
        self._name, self.author = name, f"tab {name[:8]}"
        known = self._remembered.get(name)
        if known is not None:
            self.state = replace(known, playing=False, keys=False, frame=min(known.frame, self.length - 1))
        self.set()

    def set(self, **changes: Any) -> None:
        """Another state; names and values as in TabState."""
        suggested = {"suggested": False} if "selection" in changes else {}
        self.state = replace(self.state, **(suggested | changes))
        if self._name is not None:
            self._remembered[self._name] = self.state

    def seek(self, frame: int) -> None:
        """Go to a frame, or as near as the clip has one."""
        frame = min(max(frame, 0), self.length - 1)
        self.set(frame=frame)
        if self.state.playing:
            self.playback.begin(time.monotonic(), frame)

    def step(self, frames: int) -> None:
        """Go some frames on or back, and stop playing."""
        self.pause()
        self.seek(self.state.frame + frames)

    @property
    def played(self) -> range:
        """The frames that are played: those selected, or all."""
        return self.state.frames if self.state.frames is not None else range(self.length)

    @property
    def chosen_frames(self) -> tuple[int, ...]:
        """The frames that corrections and marks are for: those selected, or else the one on show."""
        return tuple(self.state.frames) if self.state.frames is not None else (self.state.frame,)

    def toggle_playing(self) -> None:
        """Play, or pause; at the end of what is played, from its start."""
        if self.state.playing:
            return self.pause()
        frames = self.played
        frame = self.state.frame
        if frame not in frames or frame == frames[-1]:
            frame = frames[0]
        self.set(playing=True, frame=frame)
        self.playback.begin(time.monotonic(), frame)

    def pause(self) -> None:
        """Stop playing."""
        if self.state.playing:
            self.set(playing=False)
            self.desk.video.leave(self)

    def set_speed(self, speed: float) -> None:
        """Play at this many times the real speed."""
        self.set(speed=speed)
        self.playback.begin(time.monotonic(), self.state.frame)

    def advance(self, now: float) -> bool:
        """Go to the frame that is due while the clip plays; False while the page is busy with the last one."""
        if self.playback.waits(now):
            return False
        state = self.state
        frame, goes_on = self.playback.due(now, state.speed, self.played, loop=state.loop)
        self.set(frame=frame)
        if not goes_on:
            self.pause()
        return True

    # --- what is on show ---

    @property
    def shown(self) -> OnShow:
        """What is on show, as it was resolved last: the same for all that is drawn in one go."""
        return self.look() if self._shown is None else self._shown

    def look(self) -> OnShow:
        """Resolve anew what is on show; for each drawing, and for gestures, which may follow each other at once."""
        self._go_over_to_corrections()
        self._shown = on_show(self.state, self.session)
        return self._shown

    def _go_over_to_corrections(self) -> None:
        """Where B is a run that was chosen, and that this tab has corrected, it becomes the run of its corrections.

        In the same drawing in which a drag's live body ends: the run itself still has the body from before.
        """
        run, session = self.corrected, self.session
        if run is None:
            return
        under_way = session.following.busy or any(job.run is None for job in session.jobs.values())
        corrections = run if session.fits.run(run) is None else session.fits.corrections_of(run).id
        if corrections == run and under_way:
            return
        self.corrected = None
        if self.state.b.run == run != corrections:
            self.set(b=replace(self.state.b, run=corrections))
            self.say(f"B shows {session.project.runs.get(corrections).name}")
