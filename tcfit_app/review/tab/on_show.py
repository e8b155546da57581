"""What a tab shows: the frame that is due while a clip plays, and the fits and bodies of each drawing."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from fitting_core.camera import Camera
from fitting_core.errors import InputError
from tcfit_app.fitting.edit_follower import LiveWindow
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.review.browser.page_states import Color
from tcfit_app.review.session.session import Session, StoredFits
from tcfit_app.review.shared.drawing_data import FrameBody
from tcfit_app.review.tab.state import TabState

Slot = Literal["a", "b"]
SLOTS: tuple[Slot, ...] = ("a", "b")
SLOT_COLORS: dict[Slot, Color] = {"a": "beside", "b": "fit"}


@dataclass(frozen=True, kw_only=True)
class OnShow:
    """The fit on show and the one that it is compared with, and where each of their bodies is drawn."""

    frame: int
    a: Shown | None
    """The other fit while two are compared; None: missing or unreadable."""
    b: Shown | None
    """The fit on show, to which corrections apply; None as for A."""
    live_a: LiveWindow | None
    """The live result of a drag in the frames around this one for A, drawn instead of the stored one."""
    live_b: LiveWindow | None
    """The same for B."""
    places: tuple[tuple[Slot, ...], ...]
    """The bodies on each poster, or in the room. A close-up in Edit has the video alone beside them."""
    camera: Camera
    """The camera of the video: the clip's; in 3D the fit's, whose focal length may differ."""
    problem: str = ""
    """Why A or B cannot be read; empty if both can."""

    def fit(self, side: Slot) -> Shown | None:
        """A or B."""
        return self.a if side == "a" else self.b

    def title(self, side: Slot) -> str:
        """The name of a fit that is there, for users."""
        fit, other = (self.b, self.a) if side == "b" else (self.a, self.b)
        assert fit is not None
        return fit.title_with_pass if other is not None and other.run.id == fit.run.id else fit.title

    @property
    def same(self) -> bool:
        """Whether A and B are one fit, between which there is no difference."""
        a, b = self.a, self.b
        return a is not None and b is not None and (a.run.id, a.phase) == (b.run.id, b.phase)

    @property
    def held(self) -> Shown | None:
        """The fit that determines the camera's tilt and the floor; stays the same when A is shown in B's place."""
        return self.b or self.a

    def body(self, side: Slot) -> FrameBody | None:
        """The body of A or B in the frame on show; None without one."""
        fit = self.fit(side)
        if fit is None or not fit.has(self.frame):
            return None
        return FrameBody(shown=fit, frame=self.frame, live=self.live_a if side == "a" else self.live_b)

    @property
    def live(self) -> LiveWindow | None:
        """The newer of the two live windows."""
        windows = (window for window in (self.live_a, self.live_b) if window is not None)
        return max(windows, key=lambda window: window.revision, default=None)

    @property
    def revision(self) -> int | None:
        """Changes whenever a drag has changed a body on show; None without a drag."""
        return None if self.live is None else self.live.revision

    @property
    def version(self) -> Hashable:
        """Identifies the frame and the bodies of both fits."""
        return self.stored, *(None if live is None else live.revision for live in (self.live_a, self.live_b))

    @property
    def stored(self) -> Hashable:
        """Identifies the frame and both fits, without drags."""
        return self.frame, *(None if fit is None else fit.version for fit in (self.a, self.b))

    def followed(self, session: Session) -> "OnShow | None":
        """The same with the newest bodies of drags; None if one has begun or ended, because the fits may have changed
        too."""
        live = [live_window(session, fit, self.frame) for fit in (self.a, self.b)]
        if any((one is None) != (was is None) for one, was in zip(live, (self.live_a, self.live_b), strict=True)):
            return None
        return replace(self, live_a=live[0], live_b=live[1])


def on_show(state: TabState, session: Session) -> OnShow:
    """Resolve a tab's state."""
    problems: list[str] = []
    b = _read(session.stored, state.b, problems)
    other = (state.a or session.fits.before(b and b.run)) if state.comparing else None
    a = other and _read(session.stored, other, problems)
    clip = session.project.footage.camera
    there = [fit for fit in (b, a) if fit is not None]
    return OnShow(
        frame=state.frame,
        a=a,
        b=b,
        live_a=live_window(session, a, state.frame),
        live_b=live_window(session, b, state.frame),
        places=_places(state, bool(there)),
        camera=there[0].camera if state.mode == "space" and there else clip,
        problem=" ".join(dict.fromkeys(problems)),
    )


def _read(fits: StoredFits, choice: FitChoice, problems: list[str]) -> Shown | None:
    try:
        return fits.show(choice)
    except InputError as error:
        problems.append(str(error))
        return None


def live_window(session: Session, fit: Shown | None, frame: int) -> LiveWindow | None:
    """The live result of a drag for a fit in a frame: a drag in this run, or in the one whose corrections it is."""
    if fit is None or fit.phase != 3:
        return None
    return session.edit_follower.window(fit.run.id, frame)


def _places(state: TabState, there: bool) -> tuple[tuple[Slot, ...], ...]:
    edited: tuple[Slot, ...] = ("a",) if state.blinked else ("b",)
    if state.mode == "space":
        return (SLOTS if state.ghost else edited,)
    if state.mode == "edit":
        return ((), edited) if state.close_up and state.bodies and there else (edited,)
    return (("b",), ("a",)) if state.blinked else (("a",), ("b",))


# --- playing: in real time, but no faster than the page draws ---

PATIENCE = 0.5
"""Seconds after which a frame counts as drawn although the page did not report it: a hidden tab reports nothing."""


class Playback:
    """Says which frame is due. Times are in seconds of one clock.

    Args:
        frame_rate: of the clip.
    """

    def __init__(self, frame_rate: float) -> None:
        self.frame_rate = frame_rate
        self._start: tuple[float, int] = (0.0, 0)
        self._sent: tuple[float, int] | None = None

    def begin(self, now: float, frame: int) -> None:
        """Play from this frame."""
        self._start, self._sent = (now, frame), None

    def sent(self, now: float, frame: int) -> None:
        """A frame was sent to the page."""
        self._sent = (now, frame)

    def drawn(self, frame: int) -> None:
        """The page has drawn a frame."""
        if self._sent is not None and self._sent[1] == frame:
            self._sent = None

    def waits(self, now: float) -> bool:
        """Whether the page is still busy with the last frame; later ones are dropped meanwhile."""
        return self._sent is not None and now - self._sent[0] < PATIENCE

    def due(self, now: float, speed: float, frames: range, *, loop: bool) -> tuple[int, bool]:
        """The frame to show, and whether playing continues.

        Args:
            now: the time.
            speed: 1 for real time.
            frames: the frames to play.
            loop: start again at the end; otherwise stop there.
        """
        began, first = self._start
        frame = first + int((now - began) * self.frame_rate * speed)
        if frame in frames:
            return frame, True
        if not loop or len(frames) < 2:
            return frames[-1], False
        start = frames.start + (frame - frames.start) % len(frames) if frame >= frames.stop else frames.start
        self.begin(now, start)
        return start, True


def coming(frame: int, frames: range, count: int, *, loop: bool) -> Sequence[int]:
    """The frames after this one, in playing order."""
    rest = list(range(frame + 1, min(frame + 1 + count, frames.stop)))
    if loop and len(rest) < count:
        rest += list(frames[: count - len(rest)])
    return rest
