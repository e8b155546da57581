"""One browser tab as a whole: builds its parts, gives them the page's events, draws them. They share `tab/tab.py`.

In a clip with several people, a tab has a page for each person it has shown, one of which is drawn.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import cached_property
from traceback import walk_tb
from typing import Any

import msgspec

from fitting_core.keypoints import COUNT
from tcfit_app.analysis.body_regions import full_name
from tcfit_app.fitting.reports import Notice
from tcfit_app.review.browser import page_events
from tcfit_app.review.browser.page_events import PageEvent
from tcfit_app.review.browser.page_states import Beat, Cursor, Framing, Keys, Selection, Skeleton
from tcfit_app.review.drawing.bar import Bar
from tcfit_app.review.drawing.header import Header
from tcfit_app.review.drawing.menus import menus
from tcfit_app.review.drawing.picture import Picture
from tcfit_app.review.drawing.rows import MOST_ROWS, PLOTS
from tcfit_app.review.drawing.timeline import Timeline
from tcfit_app.review.gestures.actions import ACTIONS, Gestures, bindings, key_text
from tcfit_app.review.gestures.edit_words import part_name
from tcfit_app.review.gestures.keyframing import HANDS_OF
from tcfit_app.review.panels import PANELS, Panel
from tcfit_app.review.panels.first_steps import FirstSteps
from tcfit_app.review.panels.key_list import KeyWindow
from tcfit_app.review.panels.start_panel import StartPanel
from tcfit_app.review.tab.tab import Tab
from tcfit_app.server.serving import set_theme
from tcfit_app.server.uploads import too_large

AGAIN = 1.0
"""Seconds until something that failed is retried: the loop would do so at each turn."""
REST = 0.25
"""Seconds after which everything is drawn again if something may have changed unnoticed: tasks report progress, and
messages expire."""
_BEAT = 5.0
"""Seconds between two heartbeats."""
_PAUSE = 10.0
"""Menus and panels pause for this many times as long as drawing them took: they are rebuilt whole each time, and must
not take time from bodies that play or follow a drag."""
_log = logging.getLogger(__name__)
SKELETON = Skeleton(
    names=tuple(full_name(joint) for joint in range(COUNT)),
    hands=tuple((wrist, hand.start, hand.stop) for wrist, hand in HANDS_OF.items()),
)


class Faults:
    """Runs steps repeatedly, in spite of any errors.

    Args:
        tell: reports an error to users, once until it changes or is gone.
    """

    def __init__(self, tell: Callable[[Notice], None]) -> None:
        self._tell = tell
        self._known: dict[str, tuple[str, float]] = {}
        """What failed, by what was done, and when it is retried."""

    def attempt(self, what: str, do: Callable[[], object], now: float) -> None:
        """Do something, unless it has just failed.

        viser's queue may fail when two threads wake its sender at once, because it sets an asyncio event outside of the
        event's loop. Only that is tried a second time at once: another step may have been half done, and saving again
        would hide the first error.

        Args:
            what: in words, after "could not".
            do: does it.
            now: seconds of a clock.
        """
        known, again = self._known.get(what, ("", now))
        if now < again:
            return
        try:
            try:
                do()
            except RuntimeError as error:
                if not _is_of_an_event(error):
                    raise
                do()
        except Exception as error:
            text = f"{type(error).__name__}: {error}"
            self._known[what] = (text, now + AGAIN)
            if known != text:
                _log.exception("The review app could not %s", what)
                self._tell(_notice(what, text))
        else:
            self._known.pop(what, None)


def _is_of_an_event(error: RuntimeError) -> bool:
    """Whether an asyncio event raised it: its waiters changed in another thread while it woke them."""
    *_, (frame, _) = walk_tb(error.__traceback__)
    return frame.f_code is asyncio.Event.set.__code__


def _notice(what: str, text: str) -> Notice:
    message = f"Could not {what}: {text}. Nothing is lost, and tcfit keeps trying; its terminal has the details."
    return Notice(title="Something went wrong in tcfit", text=message, kind="error")


class Page:
    """The parts of a tab, which get the page's events and are drawn."""

    def __init__(self, tab: Tab) -> None:
        self.tab = tab
        self.gestures = Gestures(self.tab)
        self.picture = Picture(self.tab, self.gestures.turning.rings)
        self.timeline, self.bar, self.header = Timeline(self.gestures), Bar(self.gestures), Header(self.gestures)
        self._key_window = KeyWindow(self.gestures)
        self._attempt = Faults(lambda notice: self.tab.notify(notice)).attempt
        self._followed: int | None = None
        """The dragged body sent last."""
        self._pictured: tuple[int, int | None] | None = None
        """Frame and dragged body of the picture drawn last."""
        self._drawn: Hashable = None
        """What everything else was drawn for: the state without its frame, and the keypoints."""
        self._next_rest = 0.0
        self.behind = 0.0
        """Seconds until menus and panels that are out of date may be drawn; 0: they are up to date."""
        self._next_panels = 0.0
        """When menus and panels may be drawn again."""
        self._begin()

    def _begin(self) -> None:
        """Show this page in the browser tab."""
        self.tab.scene.rings.turned = lambda *turned: self.tab.do(lambda: self.gestures.turning.take(*turned))
        self.tab.channel.send("skeleton", SKELETON)
        self.tab.channel.send("keys", Keys(bindings=bindings()))

    def take_over_from(self, other: "Page") -> None:
        """Replace another person's page in the same tab."""
        self.tab.take_over_from(other.tab)
        self._begin()
        self._show_panels(True)

    def leave(self) -> None:
        """Make room for another person's page. Running work continues."""
        self.gestures.correcting.abandon()
        self.gestures.turning.abandon()
        self.gestures.again.give_up_framing()
        self.tab.pause()
        self.tab.set(keys=False)
        self._key_window.draw()
        self._show_panels(False)

    def _show_panels(self, on: bool) -> None:
        if "panels" in self.__dict__:  # they are created when first drawn
            begun = self.tab.session.project.has_detections
            self._tabs.visible = on and begun
            if self._start is not None:
                self._start.visible = on and not begun
            self._steps.show(on)

    @cached_property
    def panels(self) -> list[Panel]:
        """The panels, created after the picture: they take half a second in the browser."""
        self._add_commands()
        gui, made = self.tab.client.gui, []
        self._steps = FirstSteps(self.gestures)
        begun = self.tab.session.project.has_detections
        self._start = None if begun else gui.add_tab_group()
        self._tabs = gui.add_tab_group(visible=begun)
        for group, kind in [(self._start, StartPanel), *((self._tabs, kind) for kind in PANELS)]:
            if group is not None:
                with group.add_tab(kind.title, kind.icon):
                    made.append(kind(self.gestures))
        if begun and not self.tab.session.fits.runs:
            self.tab.show_panel("Fit")
        return made

    def _add_commands(self) -> None:
        """Add the actions to the command palette, which all people's pages of a browser share."""
        tab = self.tab
        for name, action in ACTIONS.items():
            if name not in tab.commands:
                command = tab.client.gui.add_command(action.title, description=key_text(name) or None)
                chosen = page_events.Key(action=name, repeat=False)
                command.on_trigger(lambda _, chosen=chosen: tab.receive(chosen))
                tab.commands.add(name)

    # --- events of the page ---

    def receive(self, event: PageEvent) -> None:
        """Handle a user's action."""
        RECEIVERS[type(event)](self, event)

    def _hello(self, event: page_events.Hello) -> None:
        rows = None if event.plots is None else tuple(dict.fromkeys(name for name in event.plots if name in PLOTS))
        self.tab.greet(event, plots=rows and rows[:MOST_ROWS])
        self._theme(event)
        self.tab.set(steps=not event.hinted)

    def _theme(self, event: page_events.Hello | page_events.Theme) -> None:
        set_theme(self.tab.client.gui, dark=event.dark)
        self.tab.set(dark=event.dark)

    def _resized(self, event: page_events.Resized) -> None:
        self.tab.size = (event.width, event.height)

    def _go_to(self, event: page_events.GoToPerson) -> None:
        all_people, session = self.tab.someone.all_people, self.tab.session
        if session.can_choose_person:
            session.source.choose(self.tab.state.frame, event.person)
        elif event.person < len(all_people):
            self.tab.go_to(all_people[event.person])

    def _key(self, event: page_events.Key) -> None:
        action = ACTIONS.get(event.action)
        if action is not None and (action.repeats or not event.repeat):
            self.gestures.run(event.action)

    def _seek(self, event: page_events.Seek) -> None:
        self.tab.pause()
        self.tab.seek(event.frame)

    def _range(self, event: page_events.Range) -> None:
        if event.first is None or event.last is None:
            self.tab.set(frames=None)
            return
        end = self.tab.length - 1
        first, last = sorted((min(event.first, end), min(event.last, end)))
        self.tab.set(frames=range(first, last + 1))

    def _move_key(self, event: page_events.MoveKey) -> None:
        if max(event.frame, event.to) < self.tab.length:
            self.gestures.correcting.move_key(event.frame, event.to)

    def _look_at(self, event: page_events.LookAt) -> None:
        queue = self.gestures.reviewing.queue
        for suspect in () if queue is None else queue.left:
            if suspect.key == event.entry:
                return self.gestures.reviewing.show(suspect)

    def _tell_too_large(self, event: page_events.TooLarge) -> None:
        self.tab.notify(Notice(title=f"{event.name} cannot be uploaded", text=too_large(event.size), kind="error"))

    def _open_link(self, event: page_events.OpenLink) -> None:
        self.tab.doing = "Open the link"
        if event.person is not None:
            self.tab.go_to(self.tab.someone.person_with_number(event.person))
            return self.tab.receive(msgspec.structs.replace(event, person=None))
        self.gestures.noting.open_link(event.frame, event.run, event.phase)

    def _select(self, event: page_events.Select) -> None:
        now = self.tab.state.selection
        if event.how == "replace":
            chosen = event.joints
        elif event.how == "add":
            chosen = (*(j for j in now if j not in event.joints), *event.joints)
        else:
            chosen = (*(j for j in now if j not in event.joints), *(j for j in event.joints if j not in now))
        self.tab.set(selection=tuple(dict.fromkeys(chosen)), in_view=event.view and self.tab.view is not None)

    # --- drawing ---

    def draw(self, now: float) -> None:
        """Send what has changed since the last time, once the page is ready for it.

        While the clip plays or the fit follows a drag, the picture alone is drawn, once for each state and body; all
        else is drawn when something else has changed, and every REST seconds. An error in one part is shown in the tab
        once, and the other parts are drawn all the same.
        """
        if not self.tab.ready or (self.tab.drawn_early and self.tab.data.warming):
            return
        self.tab.channel.send("beat", Beat(milliseconds=round(1e3 * _BEAT), number=int(now // _BEAT)))
        if self.tab.state.playing and not self.tab.advance(now):
            return
        state = self.tab.state
        asked = replace(state, frame=0), self.tab.session.project.keypoints_version
        whole = asked != self._drawn or now >= self._next_rest
        self._attempt("resolve what is on show", self.tab.look if whole or state.playing else self.tab.follow, now)
        state, revision = self.tab.state, self.tab.shown.revision
        if revision not in (None, self._followed) and self.tab.playback.waits(now):
            return  # bodies queued for a busy browser would lag more and more
        due = whole or not (state.playing or revision is not None)
        if due or (state.frame, revision) != self._pictured:
            self._attempt("draw the picture", lambda: self._draw_picture(now, whole=due), now)
        if self.tab.data.warming or not due:
            return  # the first body appears half a second sooner if nothing else is drawn
        self._drawn, self._next_rest = asked, now + REST
        self._attempt("draw the selection", self._draw_selection, now)
        self._attempt("draw the timeline", self.timeline.draw, now)
        problem = self.picture.problem or self.tab.shown.problem
        self._attempt("draw the bar", self.bar.draw, now)
        self._attempt("draw the header", lambda: self.header.draw(now, problem), now)
        self._attempt("show the keys", self._key_window.draw, now)
        self.behind = max(0.0, self._next_panels - time.monotonic())
        if not self.behind:
            self._draw_panels(now)

    def _draw_panels(self, now: float) -> None:
        begun, panels = time.thread_time(), self.panels
        if self._start is not None and self.tab.session.project.has_detections:
            self._show_panels(True)
            self._start = None
            self.tab.show_panel("Review" if self.tab.session.jobs else "Fit")
        self._attempt("draw the menus", lambda: self.tab.channel.send("menus", menus(self.gestures)), now)
        self._attempt("draw the first steps", lambda: self._steps.show(True), now)
        for panel in panels:
            self._attempt(f"draw the panel {panel.title}", panel.draw, now)
        self._next_panels = time.monotonic() + _PAUSE * (time.thread_time() - begun)

    def _draw_picture(self, now: float, *, whole: bool) -> None:
        if whole:
            self.gestures.turning.settle()
        tab, revision = self.tab, self.tab.shown.revision
        following = revision not in (None, self._followed)
        if self.picture.draw(whole=whole):
            if tab.state.playing or following:
                tab.playback.sent(now, tab.state.frame)
            self._followed = revision if following else self._followed
            self._pictured = tab.state.frame, revision
        tab.channel.send("cursor", Cursor(frame=tab.state.frame, live=self._followed))

    def _draw_selection(self) -> None:
        tab, framing = self.tab, self.gestures.again.framing
        tab.channel.send("framing", None if framing is None else Framing(around=part_name(framing)))
        state, view = tab.state, tab.corrected_view is not None
        tab.channel.send("selection", Selection(joints=state.selection, suggested=state.suggested, view=view))

    def close(self) -> None:
        """The tab was closed."""
        self.gestures.correcting.abandon()
        self.gestures.turning.abandon()
        self.tab.data.leave(self.tab)
        self.tab.session.tasks.leave(self.tab)


RECEIVERS: dict[type, Callable[[Page, Any], None]] = {
    page_events.Hello: Page._hello,
    page_events.Resized: Page._resized,
    page_events.Theme: Page._theme,
    page_events.Key: Page._key,
    page_events.Seek: Page._seek,
    page_events.Range: Page._range,
    page_events.Plot: lambda page, event: page.timeline.plot(event.name, shown=event.shown),
    page_events.MoveKey: Page._move_key,
    page_events.LookAt: Page._look_at,
    page_events.OpenLink: Page._open_link,
    page_events.Select: Page._select,
    page_events.Drag: lambda page, event: page.gestures.correcting.take(event),
    page_events.DragDepth: lambda page, event: page.gestures.correcting.take(event),
    page_events.Framed: lambda page, event: page.gestures.again.take(event),
    page_events.Press: lambda page, event: page.tab.buttons.take(event),
    page_events.TooLarge: Page._tell_too_large,
    page_events.Gesture: lambda page, event: page.tab.scene.cameras.touched(),
    page_events.GoToPerson: Page._go_to,
    page_events.Drawn: lambda page, event: page.tab.playback.drawn(event.frame),
}
