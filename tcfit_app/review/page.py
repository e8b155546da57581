"""One browser tab: its state, and what its gestures do. Everything here runs on the thread that draws."""

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal

import viser

from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT
from tcfit_app.analysis.body_regions import full_name
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.fitting.notices import Notice
from tcfit_app.project.edits.kinds import Edit
from tcfit_app.review.browser import page_events
from tcfit_app.review.browser.channel import Channel
from tcfit_app.review.browser.page_events import PageEvent
from tcfit_app.review.browser.page_states import Beat, Cursor, Keys, Selection, Skeleton
from tcfit_app.review.changes import Changes
from tcfit_app.review.gestures.actions import ACTIONS, bindings
from tcfit_app.review.gestures.correcting import Correcting, describe
from tcfit_app.review.gestures.key_list import keys_html
from tcfit_app.review.gestures.playback import Playback
from tcfit_app.review.gestures.reviewing import Reviewing
from tcfit_app.review.gestures.submitting import Submitting
from tcfit_app.review.panels import PANELS, WITHOUT_KEYPOINTS
from tcfit_app.review.panels.elements.panel import Panel
from tcfit_app.review.picture import Picture
from tcfit_app.review.presses import Presses
from tcfit_app.review.shared.desk import Desk
from tcfit_app.review.status import Status
from tcfit_app.review.tasks import Task, Value, Work
from tcfit_app.review.timeline import Strip
from tcfit_app.review.view_state import Mode, ViewState
from tcfit_app.server.page_files import PageFiles

Do = Callable[[Callable[[], None]], None]
"""Runs something on the drawing thread, soon."""
_COLORS: dict[str, Literal["blue", "green", "red"]] = {"info": "blue", "done": "green", "error": "red"}
_BEAT = 5.0
"""Seconds between two signs of life."""
_SHORT, _LONG = 4.0, 12.0
"""Seconds for which a message stays."""
SKELETON = Skeleton(names=tuple(full_name(joint) for joint in range(COUNT)))
_log = logging.getLogger(__name__)


class Page:
    """A tab that shows the project.

    Args:
        client: viser's tab.
        desk: what it draws from.
        do: how callbacks get to the drawing thread.
        remembered: states of tabs that were closed or reloaded, by the tab's own name.
        files: which files of this computer it may name.
    """

    def __init__(
        self, client: viser.ClientHandle, desk: Desk, do: Do, remembered: dict[str, ViewState], files: PageFiles
    ) -> None:
        self.client, self.desk, self.session, self.files = client, desk, desk.session, files
        self.length = desk.length
        self.first_frame = desk.session.project.clip.first_frame
        """The number that users see for frame 0."""
        self.state = ViewState()
        self.author = f"browser {client.client_id}"
        self.changes = Changes()
        self.correcting, self.reviewing, self.submitting = Correcting(self), Reviewing(self), Submitting(self)
        self.playback = Playback(self.session.project.clip.frame_rate)
        self._do, self._remembered = do, remembered
        self._followed: int | None = None
        """The live correction that was sent last."""
        self._tab: str | None = None
        self._keys: Any = None
        """The window of keys, while it is open: viser's handle."""
        self.message: tuple[str, float] = ("", 0.0)
        """What was done last, and until when it is shown."""
        self._presses = Presses()
        self.on_press("action", lambda action: action.run(self), ACTIONS.__getitem__)
        self.channel = Channel(client, lambda event: do(self._guarded(lambda: self.receive(event))))
        self.channel.send("skeleton", SKELETON)
        self.channel.send("keys", Keys(bindings=bindings()))
        self.picture, self.strip, self.status = Picture(self), Strip(self), Status(self)

    @cached_property
    def panels(self) -> list[Panel]:
        """Beside the picture, and made after it: they take half a second in the browser."""
        self._add_commands()
        return [panel(self) for panel in self._tabs()]

    def _tabs(self) -> list[Callable[["Page"], Any]]:
        tabs = self.client.gui.add_tab_group()
        made = []
        for kind in PANELS if self.session.project.has_detections else WITHOUT_KEYPOINTS:
            tab = tabs.add_tab(kind.title, kind.icon)

            def build(page: "Page", kind: Any = kind, tab: viser.GuiTabHandle = tab) -> Any:
                with tab:
                    return kind(page)

            made.append(build)
        return made

    def _add_commands(self) -> None:
        for action in ACTIONS.values():
            command = self.client.gui.add_command(action.title, description=action.key_text)
            command.on_trigger(lambda _, action=action: self.do(lambda: action.run(self)))

    # --- doing things ---

    def do(self, command: Callable[[], None]) -> None:
        """Run something on the drawing thread; for callbacks of panels. What goes wrong is told in the tab."""
        self._do(self._guarded(command))

    def begin(self, title: str, work: Work[Value], then: Callable[[Value], None]) -> Task[Value]:
        """Do something slow beside the drawing thread. What goes wrong is told in the tab; it ends when that is closed.

        Args:
            title: What it is.
            work: See `Tasks.submit`.
            then: Gets what it has made, on the drawing thread.
        """

        def ended(task: Task[Value]) -> None:
            if task.state != "cancelled":
                self._guarded(lambda: then(task.result()))()

        return self.session.tasks.submit(title, work, owner=self, then=ended)

    def on_press(self, command: str, run: Callable[[Any], None], read: Callable[[str], Any] = str) -> None:
        """What a button in a panel's HTML does (`panels/html.py`), as `Presses.on`. The command "action" is taken: it
        runs one of ACTIONS."""
        self._presses.on(command, run, read)

    def _guarded(self, command: Callable[[], None]) -> Callable[[], None]:
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

    def show_keys(self) -> None:
        """Show all keys in a window; close it if it is open."""
        if self._keys is not None:
            self._keys.close()
            self._keys = None
            return
        self._keys = self.client.gui.add_modal("Keys")
        with self._keys:
            self.client.gui.add_html(str(keys_html()))  # viser sends plain strings only

    def saved(self, edit: Edit) -> None:
        """An edit is on the disk."""
        self.say(f"Saved: {describe(edit, self.first_frame)}")

    def refuse_read_only(self) -> None:
        """Raises InputError where nothing can be changed."""
        self.session.project.refuse_read_only()

    # --- what is on show ---

    def set(self, **changes: Any) -> None:
        """Another state; names and values as in ViewState."""
        suggested = {"suggested": False} if "selection" in changes else {}
        self.state = replace(self.state, **(suggested | changes))
        if self._tab is not None:
            self._remembered[self._tab] = self.state

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

    @property
    def played(self) -> range:
        """The frames that are played: those selected, or all."""
        return self.state.frames if self.state.frames is not None else range(self.length)

    def set_speed(self, speed: float) -> None:
        """Play at this many times the real speed."""
        self.set(speed=speed)
        self.playback.begin(time.monotonic(), self.state.frame)

    def set_mode(self, mode: Mode) -> None:
        """Edit, A | B or 3D."""
        self.set(mode=mode)

    def fit(self, choice: FitChoice) -> Shown | None:
        """What a choice means now; None if there is nothing, or nothing yet, or if it cannot be read, which the status
        line then says."""
        try:
            return self.session.stored.show(choice)
        except InputError as error:
            self.status.problem = str(error)
            return None

    def corrected_fit(self) -> Shown | None:
        """The fit that follows corrections: B."""
        return self.fit(self.state.b)

    # --- events of the page ---

    def receive(self, event: PageEvent) -> None:
        """Take up what the user did."""
        RECEIVERS[type(event)](self, event)

    def _hello(self, event: page_events.Hello) -> None:
        self._tab = event.tab
        self.author = f"tab {event.tab[:8]}"
        known = self._remembered.get(event.tab)
        if known is not None:
            self.state = replace(known, playing=False, frame=min(known.frame, self.length - 1))
        self.set()
        self.picture.resized(event.width, event.height)

    def _resized(self, event: page_events.Resized) -> None:
        self.picture.resized(event.width, event.height)

    def _key(self, event: page_events.Key) -> None:
        action = ACTIONS.get(event.action)
        if action is not None and (action.repeats or not event.repeat):
            action.run(self)

    def _seek(self, event: page_events.Seek) -> None:
        self.pause()
        self.seek(event.frame)

    def _range(self, event: page_events.Range) -> None:
        if event.first is None or event.last is None:
            self.set(frames=None)
            return
        first, last = sorted((min(event.first, self.length - 1), min(event.last, self.length - 1)))
        self.set(frames=range(first, last + 1))

    def _select(self, event: page_events.Select) -> None:
        now = self.state.selection
        if event.how == "replace":
            chosen = event.joints
        elif event.how == "add":
            chosen = (*(j for j in now if j not in event.joints), *event.joints)
        else:
            chosen = (*(j for j in now if j not in event.joints), *(j for j in event.joints if j not in now))
        self.set(selection=tuple(dict.fromkeys(chosen)))

    def _drag(self, event: page_events.Drag) -> None:
        self.correcting.take(event)

    def _press(self, event: page_events.Press) -> None:
        self._presses.take(event)

    def _gesture(self, event: page_events.Gesture) -> None:
        self.picture.touched()

    def _drawn(self, event: page_events.Drawn) -> None:
        self.playback.drawn(event.frame)

    # --- drawing ---

    @property
    def ready(self) -> bool:
        """Whether the page's script has said hello."""
        return self._tab is not None

    def draw(self, now: float) -> None:
        """Send what has changed since the last time, once the page is ready for it."""
        if not self.ready:
            return
        if self.changes.of("beat", now // _BEAT):
            self.channel.send("beat", Beat(milliseconds=round(1e3 * _BEAT)))
        if self.state.playing and not self._advance(now):
            return
        window = self.session.following.live
        live = None if window is None else window.revision
        following = live is not None and live != self._followed
        if following and self.playback.waits(now):
            return  # bodies that pile up in a busy browser would come later and later
        drawn = self.picture.draw()
        if drawn and (self.state.playing or following):
            self.playback.sent(now, self.state.frame)
        if drawn and following:
            self._followed = live
            self.channel.send("cursor", Cursor(frame=self.state.frame, playing=self.state.playing))
        if self.changes.of("selection", self.state.selection, self.state.suggested):
            selection = Selection(joints=self.state.selection, suggested=self.state.suggested)
            self.channel.send("selection", selection)
        if self.desk.warming:
            return  # the first body comes half a second sooner if the browser has nothing else to draw
        self.strip.draw()
        self.correcting.show_corrections()
        self.status.draw(now)
        for panel in self.panels:
            panel.draw()

    def _advance(self, now: float) -> bool:
        """The frame that is due, if the page is ready for it."""
        if self.playback.waits(now):
            return False
        state = self.state
        frame, goes_on = self.playback.due(now, state.speed, self.played, loop=state.loop)
        self.set(frame=frame)
        if not goes_on:
            self.pause()
        return True

    def close(self) -> None:
        """The tab is gone."""
        self.correcting.abandon()
        self.desk.video.leave(self)
        self.session.tasks.leave(self)


RECEIVERS: dict[type, Callable[[Page, Any], None]] = {
    page_events.Hello: Page._hello,
    page_events.Resized: Page._resized,
    page_events.Key: Page._key,
    page_events.Seek: Page._seek,
    page_events.Range: Page._range,
    page_events.Select: Page._select,
    page_events.Drag: Page._drag,
    page_events.Press: Page._press,
    page_events.Gesture: Page._gesture,
    page_events.Drawn: Page._drawn,
}
