"""What is on show in a tab: resolved once for each drawing, from what the tab has set and what the project has now."""

from dataclasses import dataclass
from typing import Literal

from fitting_core.camera import Camera
from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice, Fits, Shown
from tcfit_app.fitting.following import LiveWindow
from tcfit_app.review.session import Session
from tcfit_app.review.tab.state import TabState

Side = Literal["a", "b"]
SIDES: tuple[Side, ...] = ("a", "b")


@dataclass(frozen=True, kw_only=True)
class OnShow:
    """The fits A and B, and where each of their bodies is drawn."""

    frame: int
    a: Shown | None
    """None: there is none yet, or it cannot be read."""
    b: Shown | None
    """The one that corrections are made to."""
    live: LiveWindow | None
    """What a drag makes of the frames around this one in A or B, drawn in place of what is stored."""
    places: tuple[tuple[Side, ...], ...]
    """The bodies of each poster, or of the room."""
    camera: Camera
    """Where the video's picture is seen from: the clip's; in 3D that of the fit, whose focal length may be its own."""
    problem: str = ""
    """Why A or B cannot be read; empty if nothing is wrong."""

    def fit(self, side: Side) -> Shown | None:
        """A or B."""
        return self.a if side == "a" else self.b

    def live_of(self, side: Side) -> LiveWindow | None:
        """The live window, if this side's body is drawn from it."""
        return self.live if _covers(self.live, self.fit(side), self.frame) else None

    @property
    def revision(self) -> int | None:
        """Another number whenever a drag has led to another body on show; None without one."""
        return None if self.live is None else self.live.revision


def on_show(state: TabState, session: Session) -> OnShow:
    """What a tab's state means now."""
    problems: list[str] = []
    a, b = (_read(session.fits, choice, problems) for choice in (state.a, state.b))
    live, clip = session.following.live, session.project.clip.camera
    there = [fit for fit in (b, a) if fit is not None]
    return OnShow(
        frame=state.frame,
        a=a,
        b=b,
        live=live if any(_covers(live, fit, state.frame) for fit in there) else None,
        places=_places(state),
        camera=there[0].camera if state.mode == "space" and there else clip,
        problem=" ".join(dict.fromkeys(problems)),
    )


def _read(fits: Fits, choice: FitChoice, problems: list[str]) -> Shown | None:
    try:
        return fits.show(choice)
    except InputError as error:
        problems.append(str(error))
        return None


def _covers(live: LiveWindow | None, fit: Shown | None, frame: int) -> bool:
    """Whether a drag moves a fit's body in this frame: it is of this run, or of the one whose corrections this is."""
    if live is None or fit is None or fit.phase != 3 or frame not in live.frames:
        return False
    return live.run == fit.run.id or (fit.run.kind == "corrections" and live.run == fit.run.parent)


def _places(state: TabState) -> tuple[tuple[Side, ...], ...]:
    if state.mode == "space":
        return (SIDES,)
    if state.mode == "edit":
        return (("a",),) if state.blinked else (("b",),)
    return (("b",), ("a",)) if state.blinked else (("a",), ("b",))
