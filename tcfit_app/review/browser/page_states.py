"""What the server sends the page: plain values, each replacing the previous one of the same name.

Frames are indices into the clip, from 0. Image pixels: x right, y down.
"""

from typing import Literal

import msgspec
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from fitting_core import keypoints
from fitting_core.frame_runs import runs

Color = Literal["fit", "beside", "body", "left_hand", "right_hand", "face"]
"""A name in `COLORS`: the page has them, for dark and light ground."""
Span = tuple[int, int]
"""First and last frame, both included."""
Triple = tuple[float, float, float]
Segment = tuple[float, float, float, float]
"""From x, y to x, y in image pixels."""


class _State(msgspec.Struct, frozen=True, kw_only=True):
    """One state."""


Place = tuple[float, float, float, float]
"""Left, top, right and bottom on the canvas, as fractions of its width and height."""


class Poster(_State, frozen=True, kw_only=True):
    """A picture in the flat world, the video alone, the side view's plate, or another view's picture in its place."""

    node: str = "/posters/0"
    """viser's node for it."""
    window: Place = (0.0, 0.0, 1.0, 1.0)
    """The part of the canvas to which it is clipped."""
    width: float
    """In image heights, like all lengths in viser's world."""
    kind: Literal["picture", "video", "side", "view"] = "picture"
    clipped: bool = False
    """Bodies are clipped to the picture."""
    label: str
    """Text in its window's corner; empty for none."""
    color: Color | None = None
    """Of a fit."""


class Layout(_State, frozen=True, kw_only=True):
    """What the canvas shows.

    Posters: pixel (u, v) of a poster of W x H is at ((u - W/2)/H, (v - H/2)/H, 0) in viser's world. All have the height
        H, and a picture's pixels are the image's (another view's are those of its own). The point at the centre of
        viser's camera is at the centre of each picture's window. The page handles the left button, and the camera only
        pans and zooms. In space viser's camera is as usual, and only the labels of the posters are shown.
    """

    mode: Literal["poster", "space"]
    image: tuple[int, int] = (0, 0)
    """Width and height in pixels."""
    posters: tuple[Poster, ...] = ()
    wipe: bool = False
    """Two pictures share a window: the first is shown left of a divider, the other right of it."""


class FitBody(_State, frozen=True, kw_only=True):
    """A body's BODY_25 keypoints according to the fit."""

    color: Color
    points: tuple[Triple | None, ...]
    """In camera space, metres; None if the body has no such keypoint."""
    pelvis: float
    """z of the pelvis, the origin of depths, in camera space, metres."""
    error_bars: tuple[tuple[float, float] | None, ...] = ()
    """Error bars along the camera's ray and across it, metres; None if unknown."""
    unseen: tuple[int, ...] = ()
    """Which of them keypoints do not show in this frame."""
    camera: tuple[float, float, float, float] = (1.0, 1.0, 0.0, 0.0)
    """Its focal length and centre, pixels: x, y, x, y."""
    followed: Triple | None = None
    """The middle of the part that a close-up follows, like `points`; None if none does, or the body lacks it."""


class Bodies(_State, frozen=True, kw_only=True):
    """The fits' keypoints in space."""

    bodies: tuple[FitBody, ...]
    """Of the fits on show, the one being corrected last."""
    down: Triple
    """Gravity: a unit vector in camera space."""
    floor: float
    """The floor: metres along it from the camera."""


class SidePlate(_State, frozen=True, kw_only=True):
    """How the side view's plate maps camera space, in pixels as in `Layout`."""

    plate: tuple[Triple, Triple]
    """A point maps to plate · point + the body's shift."""
    shifts: tuple[tuple[float, float], ...]
    """Of each of `Bodies`; the last one is that of the camera."""
    metre: float
    """Pixels per metre."""
    zero: float
    """u of one of the floor's ticks."""
    floor: float | None
    """v of the floor; None when seen from above."""
    sight: tuple[Triple, Triple]
    """The viewing ray of the picture's pixel (u, v) has the direction sight · (u, v, 1) from the camera."""


class View(_State, frozen=True, kw_only=True):
    """Another view's picture, and how it maps camera space."""

    image: tuple[int, int]
    """Width and height in pixels."""
    turn: tuple[Triple, Triple, Triple]
    """A point is at turn · point + place before its camera, metres."""
    place: Triple
    camera: tuple[float, float, float, float]
    """Its focal length and centre, pixels: x, y, x, y."""


class Space(_State, frozen=True, kw_only=True):
    """How 3D maps camera space."""

    turn: tuple[Triple, Triple, Triple]
    """A point maps to turn · point + place in viser's world."""
    place: Triple


class OtherPerson(_State, frozen=True, kw_only=True):
    """One of the clip's other people."""

    number: int
    """Comes back in `GoToPerson`."""
    name: str
    hint: str
    """The effect of a press on the name or on the person."""
    at: tuple[float, float] | None
    """The image pixel below the name; None: the name is not shown."""
    bones: tuple[Segment, ...] = ()
    """Dimmed lines, if nothing else shows the person: from x, y to x, y in image pixels."""


class OtherPeople(_State, frozen=True, kw_only=True):
    """The people in the frame on show."""

    people: tuple[OtherPerson, ...] = ()


class Group(_State, frozen=True, kw_only=True):
    """Keypoints start ... stop - 1, in the colour of the same name."""

    name: str
    start: int
    stop: int
    radius: float
    """Size of a point, in CSS pixels."""


GROUP_RADII = {"body": 5.0, "left_hand": 3.0, "right_hand": 3.0, "face": 2.5}


class Skeleton(_State, frozen=True, kw_only=True):
    """The keypoints' names, groups and bones."""

    names: tuple[str, ...] = tuple(keypoints.NAMES)
    """As shown to users."""
    groups: tuple[Group, ...] = tuple(
        Group(name=name, start=s.start, stop=s.stop, radius=GROUP_RADII[name]) for name, s in keypoints.GROUPS.items()
    )
    bones: tuple[tuple[int, int], ...] = tuple(keypoints.BONES)
    hands: tuple[tuple[int, int, int], ...] = ()
    """A wrist among the body's keypoints, and its hand's keypoints, start ... stop - 1; the first is the same wrist."""


class Keypoints(_State, frozen=True, kw_only=True):
    """One frame's keypoints; confidence 0 means missing."""

    frame: int
    xy: tuple[tuple[float, float], ...]
    confidence: tuple[float, ...]
    bad: tuple[int, ...] = ()
    edited: tuple[int, ...] = ()
    pinned: tuple[int, ...] = ()
    """Edited ones that are pinned in space."""
    locked: tuple[int, ...] = ()
    """Of the body: those at joints whose rotation is locked."""
    deep: tuple[int, ...] = ()
    """Those whose depth was set, but not pinned."""
    ignored: tuple[int, ...] = ()
    """Of a hand with a given shape: those that do not count."""


class Style(_State, frozen=True, kw_only=True):
    """How keypoints are drawn."""

    groups: tuple[str, ...] = tuple(keypoints.GROUPS)
    """Groups shown."""
    points: bool = True
    """Points and bones are shown; selected points are in any case."""
    hand_along: bool = True
    """A dragged wrist takes its hand along."""


class Silhouette(_State, frozen=True, kw_only=True):
    """The person's silhouette in the frame on show."""

    lines: tuple[tuple[tuple[float, float], ...], ...]
    """Closed outlines, including holes; image pixels."""


class StraightLines(_State, frozen=True, kw_only=True):
    """The straight edges that the camera is estimated from."""

    along: tuple[Segment, ...]
    """Along the vertical, or one of two level directions at right angles."""
    other: tuple[Segment, ...]


class Focus(_State, frozen=True, kw_only=True):
    """The image pixel that is moved to the centre: what a close-up follows."""

    x: float
    y: float


class Framing(_State, frozen=True, kw_only=True):
    """The next drag in a picture draws a rectangle, returned in `Framed`."""

    around: str
    """What it should contain, shown beside it."""


class Selection(_State, frozen=True, kw_only=True):
    """The selected keypoints."""

    joints: tuple[int, ...] = ()
    suggested: bool = False
    """Not selected by the user: a press selects one of them alone."""
    view: bool = False
    """They were selected in another view's picture."""


class Curve(_State, frozen=True, kw_only=True):
    """One line in a row of the timeline."""

    label: str
    """Its fit among two: "A" or "B"; empty if the row's title says everything."""
    color: Color
    values: tuple[float | None, ...]
    """One per frame."""
    error_bars: tuple[float | None, ...] = ()
    """Error bars to either side; empty if unknown."""
    unseen: tuple[Span, ...] = ()
    """Frames in which keypoints do not show what it measures."""


class Levels(_State, frozen=True, kw_only=True):
    """What parts of the body do in each frame."""

    parts: tuple[str, ...]
    """From top to bottom."""
    words: tuple[str, ...]
    """The meaning of each level, from the weakest to the strongest."""
    spans: tuple[tuple[tuple[Span, ...], ...], ...]
    """For each part and each level, the frames that have it."""


class Row(_State, frozen=True, kw_only=True):
    """Curves of the timeline that share an axis."""

    name: str
    """One of the choices."""
    title: str
    unit: str = ""
    curves: tuple[Curve, ...] = ()
    levels: Levels | None = None
    """Replaces curves."""
    empty: str = "Curves appear here once there is a fit."
    """Text shown while there are no curves."""


class Rows(_State, frozen=True, kw_only=True):
    """The rows of the timeline, from top to bottom."""

    rows: tuple[Row, ...] = ()


class Choice(_State, frozen=True, kw_only=True):
    """A row that the timeline can show."""

    name: str
    title: str
    """With its unit."""
    group: str
    """Heading of the choices with the same one."""


class Timeline(_State, frozen=True, kw_only=True):
    """The strip below the canvas; without it there is no strip."""

    length: int
    """Frames."""
    frame_rate: float
    first_frame: int = 0
    """The number shown for frame 0."""
    choices: tuple[Choice, ...] = ()


class WrittenNote(_State, frozen=True, kw_only=True):
    """A note on frames."""

    first: int
    last: int
    text: str


class Marks(_State, frozen=True, kw_only=True):
    """Marked frames, as spans."""

    edited: tuple[Span, ...] = ()
    bad: tuple[Span, ...] = ()
    flagged: tuple[Span, ...] = ()
    checked: tuple[Span, ...] = ()
    notes: tuple[WrittenNote, ...] = ()


class MenuItem(_State, frozen=True, kw_only=True):
    """A menu item that does one of the app's actions, or opens a submenu."""

    label: str
    action: str = ""
    """Sent back in `Key`."""
    more: tuple["MenuItem", ...] = ()
    """Instead of an action: the submenu's items."""
    keys: str = ""
    """Keys that do the same, for users."""
    obstacle: str = ""
    """Why it cannot be done now; empty if it can."""


Groups = tuple[tuple[MenuItem, ...], ...]
"""The items of a menu, with lines between the groups."""


class Menus(_State, frozen=True, kw_only=True):
    """The menus by right click."""

    keypoints: Groups = ()
    """For the selected keypoints."""
    picture: Groups = ()
    frames: Groups = ()
    """For the selected frames."""
    timeline: Groups = ()
    nobody: MenuItem | None = None
    """Offered by a click where no person was detected; None: such a click only clears the selection."""


class Keyframes(_State, frozen=True, kw_only=True):
    """The frames with keyframes of the selected keypoints, or of any if none are selected."""

    frames: tuple[int, ...] = ()
    subject: str = "a keypoint"
    """The keypoints' description."""


class Suspicion(_State, frozen=True, kw_only=True):
    """An entry of the review queue."""

    first: int
    last: int
    frame: int
    """The worst of them."""
    key: str
    """Identifies it; empty if a click on it leads to its frame alone."""
    score: float
    """From 1."""
    reason: str


class Suspicions(_State, frozen=True, kw_only=True):
    """The review queue of the fit being corrected, in order of frames."""

    found: tuple[Suspicion, ...] = ()
    looking: bool = False
    """A newer one is being computed."""


class Origins(_State, frozen=True, kw_only=True):
    """The origin of each frame of one fit."""

    label: str
    """The fit."""
    texts: tuple[str, ...]
    """Distinct texts: "started from ..., stopped because ..."."""
    which: tuple[int, ...]
    """Index of each frame's text."""


class Provenance(_State, frozen=True, kw_only=True):
    """The origins of the frames of the fits on show, for the timeline's tooltip."""

    fits: tuple[Origins, ...] = ()


class FitSpan(_State, frozen=True, kw_only=True):
    """Frames of the running fit."""

    first: int
    last: int
    state: Literal["found", "fitting", "phase1", "phase2", "done"]
    """Has keypoints; is being fitted; first pass done; one shape done; finished."""


class Fit(_State, frozen=True, kw_only=True):
    """The running fit in the timeline."""

    spans: tuple[FitSpan, ...] = ()


class ChosenRange(_State, frozen=True, kw_only=True):
    """The frames selected in the timeline, both ends included."""

    first: int
    last: int


class Cursor(_State, frozen=True, kw_only=True):
    """The frame on show."""

    frame: int
    live: int | None = None
    """The version of the body that a drag changes: the page reports when it has drawn it, even for the same frame."""


class KeyBinding(_State, frozen=True, kw_only=True):
    """A key and what it does."""

    key: str
    """`KeyboardEvent.key` for letters, in lower case ("b"), and symbols ("[", "?"), with any modifiers a keyboard needs
    for them; `.code` for all others, which have a fixed position ("ArrowLeft", "Digit1", "Space")."""
    action: str
    """Sent back in `Key`."""
    shift: bool = False
    ctrl: bool = False
    """Control, or Command on a Mac."""


class Keys(_State, frozen=True, kw_only=True):
    """All keys of the app. In poster mode viser does not get its camera keys (W A S D Q E, arrows), bound or not; in
    space mode it gets the letters, bound or not."""

    bindings: tuple[KeyBinding, ...] = ()


class Notice(_State, frozen=True, kw_only=True):
    """A card at the centre of the canvas."""

    title: str
    text: str


class Markup(_State, frozen=True, kw_only=True):
    """HTML of the header above the picture, or of the bar under it."""

    html: str
    """Its parts, as many each time: those that have not changed are left as they are."""


class Beat(_State, frozen=True, kw_only=True):
    """The server is alive; the next beat follows after `milliseconds`. If the page misses some, it says so and accepts
    no more input."""

    milliseconds: int
    number: int = 0
    """Number of the beat."""


class _Request(msgspec.Struct, frozen=True, kw_only=True, tag_field="type"):
    """An action of the page, executed once."""


class ShowPanel(_Request, frozen=True, kw_only=True, tag="show_panel"):
    """Show a panel, and focus a text field of it."""

    panel: str
    field: str = ""
    """Its label; empty: none."""


class CopyLink(_Request, frozen=True, kw_only=True, tag="copy_link"):
    """Copy a link to what the page shows."""

    frame: int
    """The number shown to users."""
    run: int
    phase: int
    person: int
    """From 1, in the order of people.json; 0 if there is only one."""


class Leave(_Request, frozen=True, kw_only=True, tag="leave"):
    """Go to another page: the order of clips is that of the browser's list."""

    to: Literal["list", "next", "previous"]


class StepsRead(_Request, frozen=True, kw_only=True, tag="steps_read"):
    """Remember in this browser that the first steps have been read."""


class SwitchTheme(_Request, frozen=True, kw_only=True, tag="switch_theme"):
    """Go over to light or dark, and remember that in this browser."""


PageRequest = ShowPanel | CopyLink | Leave | StepsRead | SwitchTheme

STATES: dict[str, type[_State]] = {
    "layout": Layout,
    "bodies": Bodies,
    "side": SidePlate,
    "view": View,
    "space": Space,
    "other_people": OtherPeople,
    "skeleton": Skeleton,
    "keypoints": Keypoints,
    "view_keypoints": Keypoints,
    "style": Style,
    "selection": Selection,
    "framing": Framing,
    "focus": Focus,
    "timeline": Timeline,
    "rows": Rows,
    "marks": Marks,
    "keyframes": Keyframes,
    "menus": Menus,
    "suspicions": Suspicions,
    "fit": Fit,
    "provenance": Provenance,
    "range": ChosenRange,
    "cursor": Cursor,
    "keys": Keys,
    "notice": Notice,
    "header": Markup,
    "bar": Markup,
    "silhouette": Silhouette,
    "straight_lines": StraightLines,
    "beat": Beat,
}
"""By name; sending None removes a state."""
PageState = _State


def pixel_pairs(xy: Float[np.ndarray, "n 2"]) -> tuple[tuple[float, float], ...]:
    """Positions in pixels, to a hundredth."""
    return tuple((x, y) for x, y in np.round(np.asarray(xy, float), 2).tolist())


def segments(ends: Float[np.ndarray, "n 4"]) -> tuple[Segment, ...]:
    """Segments in pixels, to a tenth."""
    return tuple((x0, y0, x1, y1) for x0, y0, x1, y1 in np.round(ends, 1).tolist())


def triple(values: Float[np.ndarray, "3"]) -> Triple:
    """Three numbers, unrounded."""
    x, y, z = np.asarray(values, float).tolist()
    return x, y, z


def points_in_space(points: Float[np.ndarray, "n 3"]) -> tuple[Triple | None, ...]:
    """Points in metres, to a tenth of a millimetre; None where they are not finite."""
    return tuple(triple(point) if np.isfinite(point).all() else None for point in np.round(points, 4))


def shares(confidence: ArrayLike) -> tuple[float, ...]:
    """Confidences, to a thousandth."""
    return tuple(np.round(np.asarray(confidence, float), 3).tolist())


def curve_values(values: Float[np.ndarray, " T"], digits: int = 4) -> tuple[float | None, ...]:
    """Values for a curve, to this many digits; None where they are not finite."""
    return tuple(float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in np.asarray(values, float).tolist())


def spans(frames: ArrayLike) -> tuple[Span, ...]:
    """Runs of consecutive frames, from frame numbers in any order."""
    return tuple((run[0], run[-1]) for run in runs(np.unique(np.asarray(frames, int)).tolist()))
