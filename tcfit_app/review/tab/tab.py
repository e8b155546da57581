"""A browser's page: what its gestures, panels and picture share. For the drawing thread only."""

import logging
import time
from collections.abc import Callable, Hashable, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, Literal

import viser

from fitting_core.errors import InputError
from tcfit_app.fitting.reports import Notice
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.other_view import ProjectView
from tcfit_app.project.storage.clip_review import BROWSER
from tcfit_app.review.browser.channel import Channel
from tcfit_app.review.browser.page_events import Hello, PageEvent
from tcfit_app.review.browser.page_states import ShowPanel
from tcfit_app.review.early_tabs import EarlyTab
from tcfit_app.review.scene.scene import SceneView
from tcfit_app.review.scene.side_view import Direction, usual_width
from tcfit_app.review.scene.windows import Arrangement, divide
from tcfit_app.review.session.tasks import Task, Value, Work
from tcfit_app.review.tab.buttons import Buttons
from tcfit_app.review.tab.on_show import OnShow, Playback, on_show
from tcfit_app.review.tab.people import ReviewedPerson
from tcfit_app.review.tab.state import FitSettings, TabState, seen_alike
from tcfit_app.server.gate import HOME
from tcfit_app.server.gated_viser import Visitor
from tcfit_app.server.page_files import PageFiles

REMEMBERED = 256
"""Number of tabs whose states are kept after they were closed."""
NO_ONE = Visitor()
_COLORS: dict[str, Literal["blue", "green", "red"]] = {"info": "blue", "done": "green", "error": "red"}
SHORT, LONG = 4.0, 12.0
"""Seconds for which a message stays; errors stay longer."""
_log = logging.getLogger(__name__)


class Tab:
    """A browser's page that shows one person of the clip.

    Args:
        client: viser's client.
        someone: The person.
        do: Runs a command of a callback on the drawing thread, soon.
        receive: Passes an event on to the page of the person on show, on the drawing thread.
        files: The files on this computer that the page may name.
        visitor: The page's user, as the gate knows them.
        early: What was made for it while the app was being loaded.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        someone: ReviewedPerson,
        *,
        do: Callable[[Callable[[], None]], None],
        receive: Callable[[PageEvent], None],
        files: PageFiles,
        visitor: Visitor = NO_ONE,
        early: EarlyTab | None = None,
    ) -> None:
        self.client, self.files, self.receive, self._do = client, files, receive, do
        self.channel = Channel(client, receive, timeline=True) if early is None else early.channel
        self.scene = SceneView(client) if early is None else early.scene
        self.drawn_early = early is not None and early.drawn
        """Its picture was drawn before this was made."""
        self._noticed: tuple[Notice | None, float] = None, 0.0
        """The last notice, and when it was shown."""
        self.reviewer = visitor.reviewer
        """The name that approvals are kept under."""
        self.in_list = visitor.path != HOME
        """Its clip is one of a folder that was opened."""
        self._signed_in = visitor.name
        self.name: str | None = None
        """Chosen by the page; None until its script has said hello."""
        self.author = visitor.name or f"{BROWSER}{client.client_id}"
        """The author of its edits."""
        self.size = (0, 0)
        """Canvas size in CSS pixels, as last reported by the page."""
        self.commands = set[str]()
        """The actions in the command palette."""
        self.go_to: Callable[[ReviewedPerson], None] = lambda someone: None
        """Show another person."""
        self.plays = False
        """It opens with the clip playing."""
        self.authors: Callable[[], Sequence[str]] = lambda: ()
        """Return the authors of all pages that are open."""
        self._show(someone)

    def _show(self, someone: ReviewedPerson) -> None:
        self.someone, self.data, self.session = someone, someone.data, someone.session
        self.length = self.data.length
        self.first_frame = self.session.project.footage.first_frame
        """The number shown for frame 0."""
        self.state = TabState(settings=FitSettings(config=self.session.preset()))
        self.message: tuple[str, float] = ("", 0.0)
        """The latest message, and until when it is shown."""
        self.doing = ""
        """The action being done, for error messages; empty for other commands."""
        self.corrected: int | None = None
        """The run that this tab has corrected, until its corrections are on show."""
        self.playback = Playback(self.session.project.footage.frame_rate)
        self.buttons = Buttons()
        self._remembered = someone.remembered
        self._shown: OnShow | None = None
        self._made: dict[str, tuple[Hashable, Any]] = {}
        """By name: the result of `once`, and its key."""

    def beside(self, someone: ReviewedPerson) -> "Tab":
        """The same page, showing another person in a state of its own."""
        tab = copy(self)
        tab._show(someone)
        return tab

    # --- doing things ---

    def do(self, command: Callable[[], None]) -> None:
        """Run a command on the drawing thread; for callbacks. Errors are shown in the tab."""
        self._do(self.guarded(command))

    def begin(
        self, title: str, work: Work[Value], then: Callable[[Value], None], *, writes: bool = False
    ) -> Task[Value]:
        """Do slow work off the drawing thread. Errors and cancelling are shown in the tab.

        Args:
            title: What it is.
            work: See `Tasks.submit`.
            then: Receives the result, on the drawing thread.
            writes: It changes the project: it outlives the tab, and all tabs report it; anything else ends with the
                tab.
        """

        def ended(task: Task[Value]) -> None:
            if task.state == "finished":
                self.guarded(lambda: then(task.result()))()
            elif task.state == "cancelled":
                self.say(f"{title}: cancelled")
            else:
                self.notify(Notice(title=f"{title}: not possible", text=task.reason, kind="error"))

        return self.session.tasks.submit(title, work, owner=None if writes else self, then=ended)

    def guarded(self, command: Callable[[], None]) -> Callable[[], None]:
        """A command whose errors are shown in the tab."""

        def run() -> None:
            self.doing = ""
            try:
                command()
            except InputError as error:
                title = f"{self.doing}: not possible" if self.doing else "Not possible"
                self.notify(Notice(title=title, text=str(error), kind="error"))
            except Exception as error:
                _log.exception("A command failed")
                text = f"{type(error).__name__}: {error}. Nothing is lost; tcfit's terminal has the details."
                self.notify(Notice(title="Something went wrong in tcfit", text=text, kind="error"))

        return run

    def notify(self, notice: Notice) -> None:
        """Show a notice in a corner, the same one once a second: a key that is held down may be refused more often."""
        now = time.monotonic()
        if self._noticed[0] == notice and now < self._noticed[1] + 1.0:
            return
        self._noticed = notice, now
        stay = LONG if notice.kind == "error" else SHORT
        self.client.add_notification(notice.title, notice.text, color=_COLORS[notice.kind], auto_close_seconds=stay)

    def say(self, text: str, seconds: float = SHORT) -> None:
        """Show a passing message about what was done."""
        self.message = (text, time.monotonic() + seconds)

    def show_panel(self, title: str, field: str = "") -> None:
        """Show the panel of this title, and let the user type into the field of this label, if any."""
        self.channel.ask(ShowPanel(panel=title, field=field))

    def refuse_read_only(self) -> None:
        """Raises InputError if nothing can be changed."""
        self.session.project.refuse_read_only()

    # --- its state ---

    @property
    def ready(self) -> bool:
        """Whether the page's script has said hello."""
        return self.name is not None

    def greet(self, event: Hello, *, plots: tuple[str, ...] | None = None) -> None:
        """The page's script has started; a known name restores its state.

        Edits are attributed to the signed-in user, or else to the browser, so that a new page after a restart of tcfit
        still has the same author.

        Args:
            event: Its name and size.
            plots: The timeline's rows for an unknown one; None: the default ones.
        """
        self.name, self.size = event.tab, (event.width, event.height)
        self.author = self._signed_in or f"{BROWSER}{(event.browser or event.tab)[:8]}"
        known = self._remembered.get(self.name or "")
        if known is not None:
            self.state = replace(
                known, playing=False, keys=False, close_up=None, frame=min(known.frame, self.length - 1)
            )
        elif plots is not None:
            self.state = replace(self.state, plots=plots)
        self.set()
        if known is None and self.plays:
            self.toggle_playing()

    def take_over_from(self, other: "Tab") -> None:
        """Show this person instead of another: the same moment, displayed in the same way."""
        self.name, self.author, self.size = other.name, other.author, other.size
        known = self._remembered.get(self.name or "", self.state)
        self.state = seen_alike(known, other.state)
        self._shown = None
        self.seek(other.state.frame + other.first_frame - self.first_frame)

    def set(self, **changes: Any) -> None:
        """Change the state; names and values as in TabState."""
        suggested = {"suggested": False, "in_view": False} if "selection" in changes else {}
        frames = self.state.frames if self.state.frames_suggested else None
        if "frames" in changes:
            suggested["frames_suggested"] = False
        elif frames is not None and changes.get("frame", self.state.frame) not in frames:
            changes |= {"frames": None, "frames_suggested": False}
        self.state = replace(self.state, **(suggested | changes))
        if "speed" in changes:
            self.playback.begin(time.monotonic(), self.state.frame)
        if self.name is not None:
            remember(self._remembered, self.name, self.state)

    def seek(self, frame: int) -> None:
        """Go to a frame, clamped to the clip."""
        frame = min(max(frame, 0), self.length - 1)
        self.set(frame=frame)
        if self.state.playing:
            self.playback.begin(time.monotonic(), frame)

    def step(self, frames: int) -> None:
        """Go some frames forward or back, and stop playing."""
        self.pause()
        self.seek(self.state.frame + frames)

    @property
    def played(self) -> range:
        """The frames that are played: those that the user selected, or all."""
        own = self.state.frames is not None and not self.state.frames_suggested
        return self.state.frames if own and self.state.frames else range(self.length)

    @property
    def chosen_frames(self) -> range:
        """The frames that corrections and marks apply to: those selected, or the one on show."""
        return self.state.frames if self.state.frames is not None else range(self.state.frame, self.state.frame + 1)

    @property
    def frames_to_change(self) -> tuple[int, ...]:
        """`chosen_frames`, for changing them. Raises InputError as `require_visible_frames`."""
        self.require_visible_frames()
        return tuple(self.chosen_frames)

    def require_visible_frames(self) -> None:
        """Raises InputError if frames are selected but not the one on show: the change would not be visible."""
        if self.hidden_frames_chosen:
            chosen = in_words(self.chosen_frames, self.first_frame)
            raise InputError(
                f"This would change the selected {chosen}, and frame {self.state.frame + self.first_frame} is on show. "
                "Go to one of them first, or clear the frame selection (× in the timeline)."
            )

    @property
    def hidden_frames_chosen(self) -> bool:
        """Whether frames are selected, but not the one on show."""
        return self.state.frames is not None and self.state.frame not in self.state.frames

    def toggle_playing(self) -> None:
        """Play or pause; from the start if at the end."""
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
            self.data.leave(self)

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

    # --- what it draws ---

    def once(self, name: str, key: Hashable, make: Callable[[], Value]) -> Value:
        """A slow result, recomputed only when its key has changed.

        Args:
            name: Identifies it.
            key: Identifies its inputs: versions that count where something is written, and frames.
            make: Computes it.
        """
        known = self._made.get(name)
        if known is None or known[0] != key:
            known = self._made[name] = key, make()
        return known[1]

    # --- the posters ---

    @property
    def arrangement(self) -> Arrangement:
        """How two pictures are arranged: in Compare as chosen, else as suits the canvas."""
        if self.state.wipe and self.state.mode == "ab":
            return "wipe"
        size = self.session.project.footage.camera.size
        width = size[0] / size[1]
        view = self.view
        beside = usual_width(2 * width) if view is None else self.side_width
        side = beside if self.state.side else None
        return divide(self.scene.cameras.window, pictures=2, width=width, side=side).arrangement

    @property
    def side_width(self) -> float:
        """Width of what is beside the picture, in heights: of another view's picture, or of the side view's plate."""
        width, height = self.session.project.footage.camera.size
        if (view := self.view) is not None:
            return view.view.clip.camera.size[0] / view.view.clip.camera.size[1]
        if self.state.close_up and self.state.mode == "edit":  # three windows of one size
            return width / height
        beside = len(self.shown.places) if self.arrangement == "beside" else 1
        return usual_width(beside * width / height)

    @property
    def view(self) -> ProjectView | None:
        """The other view that takes the side view's place, if any."""
        return self.session.views.get(self.state.side_from) if isinstance(self.state.side_from, int) else None

    @property
    def corrected_view(self) -> ProjectView | None:
        """The other view in whose picture keypoints are selected."""
        return self.view if self.state.in_view and self.state.side else None

    def frame_in(self, view: ProjectView, frame: int) -> int | None:
        """A view's own frame for one of the clip; None if it was not filmed then."""
        return view.frame_at(frame, self.session.project.footage.frame_rate)

    def frames_in(self, view: ProjectView) -> tuple[int, ...]:
        """A view's own frames that are on show in `chosen_frames`."""
        found = {self.frame_in(view, frame) for frame in self.chosen_frames}
        return tuple(sorted(frame for frame in found if frame is not None))

    @property
    def direction(self) -> Direction:
        """Of the side view, also where another view was that is gone."""
        return "right" if isinstance(self.state.side_from, int) else self.state.side_from

    # --- what is on show ---

    @property
    def shown(self) -> OnShow:
        """What is on show, as last resolved: the same for everything in one drawing."""
        return self.look() if self._shown is None else self._shown

    def look(self) -> OnShow:
        """Resolve again what is on show: for each drawing, and for gestures, which may come fast."""
        self._go_over_to_corrections()
        self._shown = on_show(self.state, self.session)
        return self._shown

    def follow(self) -> None:
        """Resolve again the bodies of a drag alone, while nothing else can have changed; everything without a drag."""
        last = self._shown
        moved = None if last is None or last.revision is None else last.followed(self.session)
        self._shown = moved or self.look()

    def _go_over_to_corrections(self) -> None:
        """If this tab has corrected the fit on show, switch to the run of its corrections; and back to the run itself
        once all of them are undone.

        This happens in the drawing in which a drag's live body ends, because the run itself still has the old body.
        """
        session = self.session
        run = None if self.corrected is None else session.fits.run(self.corrected)
        if run is None:
            return
        under_way = session.edit_follower.busy or any(job.run is None for job in session.jobs.values())
        corrected = session.as_corrected(run)
        if corrected.id == run.id and under_way:
            return
        self.corrected = None
        shown = session.fits.meant(self.state.b)
        if shown is not None and shown.id == run.id != corrected.id:
            self.set(b=replace(self.state.b, run=corrected.id))
            self.say(f"Now shows {corrected.name}")


class OneTask:
    """Slow work that a tab begins, one task at a time."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self.last: Task[Any] | None = None
        """The task begun last."""

    @property
    def busy(self) -> bool:
        """Whether a task is running."""
        return self.last is not None and self.last.state == "running"

    def refuse(self) -> None:
        """Raise InputError while a task is running."""
        if self.last is not None and self.busy:
            raise InputError(f"{self.last.title}: wait for it, or cancel it.")

    def begin(self, title: str, work: Work[Value], then: Callable[[Value], None], *, writes: bool = False) -> None:
        """See `Tab.begin`. Raises InputError while another task is running."""
        self.refuse()
        self.last = self._tab.begin(title, work, then, writes=writes)

    def cancel(self) -> None:
        """Stop at the work's next step; nothing has changed then."""
        if self.last is not None:
            self.last.cancel()


def remember(kept: dict[str, Any], name: str, value: object) -> None:
    """Keep something of a tab by its own name, and forget the tabs for which this was done longest ago."""
    kept.pop(name, None)  # so that the newest is last
    kept[name] = value
    while len(kept) > REMEMBERED:
        del kept[next(iter(kept))]
