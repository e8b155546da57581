"""What the server tells the page: plain values, each of which replaces the one of the same name.

Frames are indices into the clip, from 0. Image pixels: x right, y down. Colours are CSS colours ("#4da3ff").
"""

from typing import Annotated, Literal

import msgspec
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from fitting_core import keypoints
from fitting_core.video.frame_names import runs

Color = Annotated[str, msgspec.Meta(pattern="^#[0-9a-fA-F]{6}$")]
Span = tuple[int, int]
"""First and last frame, both included."""


class _State(msgspec.Struct, frozen=True, kw_only=True):
    """One state."""


class Poster(_State, frozen=True, kw_only=True):
    """A picture in the flat world."""

    x: float
    """Of its centre, in viser's world."""
    label: str
    """In its corner; empty for none."""
    color: Color = "#cfd6df"


class Layout(_State, frozen=True, kw_only=True):
    """What the canvas shows.

    Posters: the pixel (u, v) of an image of W x H lies at ((u - W/2)/H + x, (v - H/2)/H, 0) in viser's world. The page
    then handles the left button, and viser's camera only pans and zooms. In space viser's camera is as usual, and of
    the posters there are only the labels.
    """

    mode: Literal["poster", "space"]
    image: tuple[int, int] = (0, 0)
    """Width and height in pixels."""
    posters: tuple[Poster, ...] = ()


class Group(_State, frozen=True, kw_only=True):
    """Keypoints start ... stop - 1."""

    name: str
    start: int
    stop: int
    color: Color
    radius: float
    """Of a point at usual size, in CSS pixels."""


GROUP_COLORS = {"body": "#4da3ff", "left_hand": "#2fd39a", "right_hand": "#ff9f43", "face": "#c58bff"}
GROUP_RADII = {"body": 5.0, "left_hand": 3.0, "right_hand": 3.0, "face": 2.5}


class Skeleton(_State, frozen=True, kw_only=True):
    """The keypoints' names, groups and bones."""

    names: tuple[str, ...] = tuple(keypoints.NAMES)
    """As users read them."""
    groups: tuple[Group, ...] = tuple(
        Group(name=name, start=s.start, stop=s.stop, color=GROUP_COLORS[name], radius=GROUP_RADII[name])
        for name, s in keypoints.GROUPS.items()
    )
    bones: tuple[tuple[int, int], ...] = tuple(keypoints.BONES)


class Keypoints(_State, frozen=True, kw_only=True):
    """One frame's keypoints; confidence 0 is a missing one."""

    frame: int
    xy: tuple[tuple[float, float], ...]
    confidence: tuple[float, ...]
    bad: tuple[int, ...] = ()
    edited: tuple[int, ...] = ()
    detections: tuple[tuple[int, float, float], ...] = ()
    """Of edited ones: keypoint, and where it was detected."""


class Style(_State, frozen=True, kw_only=True):
    """How keypoints are drawn."""

    groups: tuple[str, ...] = tuple(keypoints.GROUPS)
    """Shown ones."""
    color_by: Literal["group", "confidence"] = "group"
    points: bool = True
    bones: bool = True
    minimum: float = 0.0
    """Points of less confidence are left out, unless selected."""
    ghosts: bool = False
    """Draw where edited keypoints were detected."""


class Selection(_State, frozen=True, kw_only=True):
    """The selected keypoints."""

    joints: tuple[int, ...] = ()
    suggested: bool = False
    """Not by the user: a press takes one of them alone."""


class Curve(_State, frozen=True, kw_only=True):
    """One line in the timeline."""

    label: str
    color: Color
    values: tuple[float | None, ...]
    """For each frame."""


class Timeline(_State, frozen=True, kw_only=True):
    """The strip below the canvas. Without one there is no strip."""

    length: int
    """Frames."""
    frame_rate: float
    first_frame: int = 0
    """The number that users see for frame 0."""
    title: str = ""
    """What the curves show."""
    unit: str = ""
    curves: tuple[Curve, ...] = ()
    empty: str = "Curves appear here once there is a fit."
    """In their place while there are none."""


class Marks(_State, frozen=True, kw_only=True):
    """Frames to remark, as spans."""

    edited: tuple[Span, ...] = ()
    bad: tuple[Span, ...] = ()
    flagged: tuple[Span, ...] = ()
    checked: tuple[Span, ...] = ()
    apart: tuple[Span, ...] = ()
    """Where A and B differ most."""


class Origins(_State, frozen=True, kw_only=True):
    """Of one fit, where each frame's came from."""

    label: str
    """Which fit."""
    texts: tuple[str, ...]
    """"started from ..., stopped because ...", each once."""
    which: tuple[int, ...]
    """Index of each frame's text."""


class Provenance(_State, frozen=True, kw_only=True):
    """Where the frames of the fits on show came from, for the timeline's tooltip."""

    fits: tuple[Origins, ...] = ()


class FitSpan(_State, frozen=True, kw_only=True):
    """Frames of the running fit."""

    first: int
    last: int
    state: Literal["fitting", "phase1", "phase2", "done"]
    """Being fitted; has the result of phase 1; of phase 2; is finished."""


class Fit(_State, frozen=True, kw_only=True):
    """The running fit in the timeline."""

    spans: tuple[FitSpan, ...] = ()


class ChosenRange(_State, frozen=True, kw_only=True):
    """The frames that are chosen in the timeline, both ends included."""

    first: int
    last: int


class Cursor(_State, frozen=True, kw_only=True):
    """The frame on show."""

    frame: int
    playing: bool = False


class KeyBinding(_State, frozen=True, kw_only=True):
    """A key and what it does."""

    key: str
    """`KeyboardEvent.code` ("KeyB", "ArrowLeft", "Space") or `.key` ("?", "+"; Shift is then ignored)."""
    action: str
    """Comes back in `Key`."""
    shift: bool = False
    ctrl: bool = False
    """Control, or Command on a Mac."""


class Keys(_State, frozen=True, kw_only=True):
    """All keys of the app. In poster mode viser's camera keys (W A S D Q E, arrows) are kept from it, bound or not; in
    space mode it keeps the letters, bound or not."""

    bindings: tuple[KeyBinding, ...] = ()


class Notice(_State, frozen=True, kw_only=True):
    """A card in the middle of the canvas."""

    title: str
    text: str = ""
    kind: Literal["info", "error"] = "info"
    progress: float | None = None
    """0 to 1."""


class Chip(_State, frozen=True, kw_only=True):
    """A line at the canvas's lower edge."""

    text: str
    kind: Literal["info", "busy", "good", "warning", "error"] = "info"
    progress: float | None = None


class Chips(_State, frozen=True, kw_only=True):
    """All of them, left to right."""

    chips: tuple[Chip, ...] = ()


class Beat(_State, frozen=True, kw_only=True):
    """The server is there; the next one follows after `milliseconds`. A page that misses some says so, and takes
    nothing more."""

    milliseconds: int


class Legend(_State, frozen=True, kw_only=True):
    """A colour bar."""

    title: str
    unit: str
    low: float
    high: float
    colors: tuple[Color, ...]
    """Evenly from low to high."""


STATES: dict[str, type[_State]] = {
    "layout": Layout,
    "skeleton": Skeleton,
    "keypoints": Keypoints,
    "style": Style,
    "selection": Selection,
    "timeline": Timeline,
    "marks": Marks,
    "fit": Fit,
    "provenance": Provenance,
    "range": ChosenRange,
    "cursor": Cursor,
    "keys": Keys,
    "notice": Notice,
    "chips": Chips,
    "legend": Legend,
    "beat": Beat,
}
"""By the name under which each is sent; None in place of one takes it away."""

PageState = (
    Layout | Skeleton | Keypoints | Style | Selection | Timeline | Marks | Fit | ChosenRange | Cursor | Keys
) | (Notice | Chips | Legend | Beat | Provenance)


def pixel_pairs(xy: Float[np.ndarray, "n 2"]) -> tuple[tuple[float, float], ...]:
    """Positions in pixels, to a hundredth."""
    return tuple((x, y) for x, y in np.round(np.asarray(xy, float), 2).tolist())


def shares(confidence: ArrayLike) -> tuple[float, ...]:
    """Confidences, to a thousandth."""
    return tuple(np.round(np.asarray(confidence, float), 3).tolist())


def curve_values(values: Float[np.ndarray, " T"]) -> tuple[float | None, ...]:
    """Values for a curve, to four digits; None where they are not finite."""
    return tuple(float(f"{v:.4g}") if np.isfinite(v) else None for v in np.asarray(values, float).tolist())


def spans(frames: ArrayLike) -> tuple[Span, ...]:
    """Runs of frames that follow each other, of frame numbers in any order."""
    return tuple((run[0], run[-1]) for run in runs(np.unique(np.asarray(frames, int)).tolist()))
