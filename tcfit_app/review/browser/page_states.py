"""What the server tells the page: plain values, each of which replaces the one of the same name.

Frames are indices into the clip, from 0. Image pixels: x right, y down. Colours are CSS colours ("#4da3ff").
"""

from typing import Annotated, Literal

import msgspec
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from fitting_core import keypoints
from fitting_core.frame_runs import runs

Color = Annotated[str, msgspec.Meta(pattern="^#[0-9a-fA-F]{6}$")]
Span = tuple[int, int]
"""First and last frame, both included."""
Triple = tuple[float, float, float]


class _State(msgspec.Struct, frozen=True, kw_only=True):
    """One state."""


Place = tuple[float, float, float, float]
"""Left, top, right and bottom on the canvas, as shares of its width and height."""


class Poster(_State, frozen=True, kw_only=True):
    """A picture in the flat world, or the side view's plate."""

    node: str = "/posters/0"
    """viser's node that holds it."""
    bodies: tuple[str, ...] = ()
    """The nodes of the bodies in it."""
    window: Place = (0.0, 0.0, 1.0, 1.0)
    """The part of the canvas in which it is drawn, and outside of which nothing of it is."""
    width: float
    """In image heights, as lengths in viser's world are."""
    kind: Literal["picture", "side"] = "picture"
    clipped: bool = False
    """Bodies end where the picture ends."""
    label: str
    """In its window's corner; empty for none."""
    color: Color = "#cfd6df"


class Layout(_State, frozen=True, kw_only=True):
    """What the canvas shows.

    Posters: the pixel (u, v) of a poster of W x H lies at ((u - W/2)/H, (v - H/2)/H, 0) in viser's world. All are H
    high, and a picture's pixels are the image's. What viser's camera sees in the middle of the canvas each picture has
    in the middle of its window. The page handles the left button, and the camera only pans and zooms. In space viser's
    camera is as usual, and of the posters there are only the labels.
    """

    mode: Literal["poster", "space"]
    image: tuple[int, int] = (0, 0)
    """Width and height in pixels."""
    posters: tuple[Poster, ...] = ()
    wipe: bool = False
    """Two pictures share a window: the first is seen left of a divider, the other right of it."""


class FitBody(_State, frozen=True, kw_only=True):
    """A body's BODY_25 keypoints, as the fit has them."""

    color: Color
    points: tuple[Triple | None, ...]
    """In camera space, metres; None where the body has no such keypoint."""
    error_bars: tuple[tuple[float, float] | None, ...] = ()
    """How far off they may be along the camera's ray and across it, metres; none where nobody knows."""


class Bodies(_State, frozen=True, kw_only=True):
    """The fits' keypoints in space."""

    bodies: tuple[FitBody, ...]
    """Of the fits on show, the one that is corrected last."""
    down: Triple
    """Where things fall: a unit vector in camera space."""
    floor: float
    """Metres along it from the camera."""


class Side(_State, frozen=True, kw_only=True):
    """How the side view's plate shows camera space, in pixels as in `Layout`."""

    plate: tuple[Triple, Triple]
    """A point goes to plate · point + the body's shift."""
    shifts: tuple[tuple[float, float], ...]
    """Of each of `Bodies`; the camera that filmed stands at the last one."""
    metre: float
    """Its length in pixels."""
    zero: float
    """u of one of the ticks on the floor."""
    floor: float | None
    """v of the floor; None where it is seen from above."""
    sight: tuple[Triple, Triple]
    """The line of sight of the picture's pixel (u, v) goes along sight · (u, v, 1) from the camera."""


class Space(_State, frozen=True, kw_only=True):
    """How 3D shows camera space."""

    turn: tuple[Triple, Triple, Triple]
    """A point goes to turn · point + place in viser's world."""
    place: Triple
    offsets: tuple[float, ...]
    """By which each of `Bodies` is moved along its x."""


class OtherPerson(_State, frozen=True, kw_only=True):
    """One of the clip's people who is drawn beside the one that is corrected."""

    number: int
    """Comes back in `GoToPerson`."""
    name: str
    hint: str
    """What a press on the name, or on the person, does."""
    at: tuple[float, float] | None
    """The image's pixel above which the name stands; None: it stands nowhere."""
    bones: tuple[tuple[float, float, float, float], ...] = ()
    """Lines that are drawn dimmed, where nothing else shows the person: from x, y to x, y in image pixels."""


class OtherPeople(_State, frozen=True, kw_only=True):
    """Those who are in the frame on show."""

    people: tuple[OtherPerson, ...] = ()


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
    hands: tuple[tuple[int, int, int], ...] = ()
    """A wrist among the body's keypoints, and its hand's keypoints, start ... stop - 1, the first the same wrist."""
    root: int = keypoints.INDEX["mid_hip"]
    """Depths are told from there."""


class Keypoints(_State, frozen=True, kw_only=True):
    """One frame's keypoints; confidence 0 is a missing one."""

    frame: int
    xy: tuple[tuple[float, float], ...]
    confidence: tuple[float, ...]
    bad: tuple[int, ...] = ()
    edited: tuple[int, ...] = ()
    pinned: tuple[int, ...] = ()
    """Of edited ones: in one place in space."""
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
    hand_along: bool = True
    """A wrist that is dragged takes its hand along."""
    error_bars: bool = True
    """In the side view and in 3D."""


Path = tuple[tuple[float, float] | None, ...]
"""Image pixels, one of each frame; None where there is nothing."""


class Trail(_State, frozen=True, kw_only=True):
    """Where the selected keypoints are in the frames around the one on show."""

    now: int
    """Which of the frames is on show."""
    detected: tuple[Path, ...]
    """Of each keypoint, with all corrections."""
    fitted: tuple[tuple[Path, ...], ...]
    """By picture, of each keypoint."""
    colors: tuple[Color, ...]
    """By picture: the fit's."""


class Silhouette(_State, frozen=True, kw_only=True):
    """What the person covers of the frame on show."""

    lines: tuple[tuple[tuple[float, float], ...], ...]
    """Closed outlines, of holes as well; image pixels."""


class Focus(_State, frozen=True, kw_only=True):
    """The image's pixel that takes the place of its middle: what a close-up follows."""

    x: float
    y: float


class Framing(_State, frozen=True, kw_only=True):
    """The next drag in a picture draws a rectangle, which comes back in `Framed`."""

    around: str
    """What is to be in it, as it stands beside it."""


class Selection(_State, frozen=True, kw_only=True):
    """The selected keypoints."""

    joints: tuple[int, ...] = ()
    suggested: bool = False
    """Not by the user: a press takes one of them alone."""


class Curve(_State, frozen=True, kw_only=True):
    """One line in a row of the timeline."""

    label: str
    """Whose it is: "A", "B", or empty where the row's title says all."""
    color: Color
    values: tuple[float | None, ...]
    """For each frame."""
    error_bars: tuple[float | None, ...] = ()
    """How far off they may be to either side; none where nobody knows."""


class Heat(_State, frozen=True, kw_only=True):
    """Values by part of the body, drawn as colours."""

    parts: tuple[str, ...]
    """From top to bottom."""
    values: tuple[tuple[float | None, ...], ...]
    """For each part those of all frames."""
    top: float
    """Where colours end, which start at 0."""
    worse: Literal["high", "low"]
    """Which values are bright."""
    words: tuple[str, ...] = ()
    """What the values 0, 1 and so on stand for, if they are no amounts."""


class Row(_State, frozen=True, kw_only=True):
    """Curves of the timeline over one axis of values."""

    name: str
    """One of the choices."""
    title: str
    unit: str = ""
    curves: tuple[Curve, ...] = ()
    signed: bool = False
    """Values lie on both sides of zero, as differences do."""
    heat: Heat | None = None
    """In place of curves."""
    video: bool = False
    """Thumbnails are in place of curves."""
    height: float = 1.0
    """Times that of a row of curves."""
    empty: str = "Curves appear here once there is a fit."
    """In place of curves while there are none."""


class FitName(_State, frozen=True, kw_only=True):
    """A fit whose curves are in the timeline."""

    label: str
    """As its curves have it."""
    title: str
    color: Color


class Rows(_State, frozen=True, kw_only=True):
    """The rows of the timeline, from top to bottom."""

    rows: tuple[Row, ...] = ()
    fits: tuple[FitName, ...] = ()


class Choice(_State, frozen=True, kw_only=True):
    """A row that the timeline can have."""

    name: str
    title: str
    """With its unit."""
    group: str = ""
    """Those of one group stand together."""


class Timeline(_State, frozen=True, kw_only=True):
    """The strip below the canvas. Without one there is no strip."""

    length: int
    """Frames."""
    frame_rate: float
    first_frame: int = 0
    """The number that users see for frame 0."""
    choices: tuple[Choice, ...] = ()


class Thumbnails(_State, frozen=True, kw_only=True):
    """Small pictures of some of the video's frames, for a row of the timeline."""

    frames: tuple[int, ...]
    images: tuple[str, ...]
    """JPEGs in base64."""


class WrittenNote(_State, frozen=True, kw_only=True):
    """A note on frames."""

    first: int
    last: int
    text: str


class Marks(_State, frozen=True, kw_only=True):
    """Frames to remark, as spans."""

    edited: tuple[Span, ...] = ()
    bad: tuple[Span, ...] = ()
    flagged: tuple[Span, ...] = ()
    checked: tuple[Span, ...] = ()
    apart: tuple[Span, ...] = ()
    """Where A and B differ most."""
    notes: tuple[WrittenNote, ...] = ()


class MenuItem(_State, frozen=True, kw_only=True):
    """A line of a menu that does one of the app's actions, or opens another menu."""

    label: str
    action: str = ""
    """Comes back in `Key`."""
    more: tuple["MenuItem", ...] = ()
    """In place of an action: the lines of that menu."""
    keys: str = ""
    """That do the same, for the user."""
    disabled: bool = False


class FrameMenus(_State, frozen=True, kw_only=True):
    """What can be done in the timeline, in groups: about the selected frames, and elsewhere."""

    selected: tuple[tuple[MenuItem, ...], ...] = ()
    elsewhere: tuple[tuple[MenuItem, ...], ...] = ()


class PictureMenus(_State, frozen=True, kw_only=True):
    """What can be done in the picture, in groups: with the selected keypoints, and where there is none."""

    keypoints: tuple[tuple[MenuItem, ...], ...] = ()
    elsewhere: tuple[tuple[MenuItem, ...], ...] = ()


class Keyframes(_State, frozen=True, kw_only=True):
    """The frames with keyframes of the selected keypoints, or of any while none are selected."""

    frames: tuple[int, ...] = ()
    subject: str = "a keypoint"
    """Whose they are."""


class Suspicion(_State, frozen=True, kw_only=True):
    """An entry of the review queue."""

    first: int
    last: int
    frame: int
    """The worst of them."""
    kind: str
    """Which one of that frame."""
    score: float
    """From 1 on."""
    reason: str


class Suspicions(_State, frozen=True, kw_only=True):
    """The review queue of the fit that corrections are made to, in the order of frames."""

    found: tuple[Suspicion, ...] = ()


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
    state: Literal["found", "fitting", "phase1", "phase2", "done"]
    """Has its keypoints; is being fitted; has a fit of phase 1; of phase 2; is finished."""


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
    live: int | None = None
    """Which body a drag has led to last: the page tells when it has drawn that of the same frame, too."""


class KeyBinding(_State, frozen=True, kw_only=True):
    """A key and what it does."""

    key: str
    """`KeyboardEvent.key` of letters, in lower case ("b"), and of signs ("[", "?"), with whatever else a keyboard needs
    for those; `.code` of all others, which have their place ("ArrowLeft", "Digit1", "Space")."""
    action: str
    """Comes back in `Key`."""
    shift: bool = False
    ctrl: bool = False
    """Control, or Command on a Mac."""
    held: bool = False
    """The page itself does what it does, while it is held: the pictures show the video alone."""


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
    number: int = 0
    """Of the beat."""


class Saving(_State, frozen=True, kw_only=True):
    """The page saves what its canvas shows, once for each of these."""

    name: str
    """Of the file."""
    number: int = 0
    """As of `Typing`."""


class Typing(_State, frozen=True, kw_only=True):
    """The user wants to type into a field of a panel, once for each of these."""

    panel: str
    field: str
    """Its label."""
    number: int = 0
    """Another one each time that it is asked for: see `Channel.ask`."""


class Linking(_State, frozen=True, kw_only=True):
    """The page copies a link to what it shows, once for each of these."""

    frame: int
    """The number that users see."""
    run: int
    phase: int
    person: int
    """From 1, in the order of people.json; 0 where there is but one."""
    number: int = 0
    """As of `Typing`."""


class Hint(_State, frozen=True, kw_only=True):
    """One of the first steps."""

    text: str
    keys: str = ""


class Hints(_State, frozen=True, kw_only=True):
    """What to do first: the page shows it until it is closed."""

    steps: tuple[Hint, ...]
    number: int = 0
    """As of `Typing`."""


class Legend(_State, frozen=True, kw_only=True):
    """A colour bar."""

    title: str
    unit: str
    low: float
    high: float
    colors: tuple[Color, ...]
    """Evenly from low to high."""


class Leaving(_State, frozen=True, kw_only=True):
    """The page goes to another one, once for each of these: the order of clips is that of the browser's list."""

    to: Literal["list", "next", "previous"]
    number: int = 0
    """As of `Typing`."""


STATES: dict[str, type[_State]] = {
    "layout": Layout,
    "bodies": Bodies,
    "side": Side,
    "space": Space,
    "other_people": OtherPeople,
    "skeleton": Skeleton,
    "keypoints": Keypoints,
    "style": Style,
    "selection": Selection,
    "framing": Framing,
    "trail": Trail,
    "focus": Focus,
    "timeline": Timeline,
    "rows": Rows,
    "thumbnails": Thumbnails,
    "marks": Marks,
    "keyframes": Keyframes,
    "frame_menus": FrameMenus,
    "picture_menus": PictureMenus,
    "suspicions": Suspicions,
    "fit": Fit,
    "provenance": Provenance,
    "range": ChosenRange,
    "cursor": Cursor,
    "keys": Keys,
    "notice": Notice,
    "chips": Chips,
    "legend": Legend,
    "silhouette": Silhouette,
    "beat": Beat,
    "saving": Saving,
    "typing": Typing,
    "linking": Linking,
    "leaving": Leaving,
    "hints": Hints,
}
"""By the name under which each is sent; None in place of one takes it away."""

PageState = (
    (
        Layout
        | Side
        | Skeleton
        | Keypoints
        | Style
        | Selection
        | Framing
        | Trail
        | Silhouette
        | Focus
        | Bodies
        | Space
        | Legend
        | OtherPeople
    )
    | (Timeline | Rows | Thumbnails | Marks | Keyframes | Suspicions | FrameMenus | PictureMenus | Fit | Provenance)
    | (ChosenRange | Cursor | Keys | Notice | Chips | Beat | Saving | Typing | Linking | Leaving | Hints)
)


def pixel_pairs(xy: Float[np.ndarray, "n 2"]) -> tuple[tuple[float, float], ...]:
    """Positions in pixels, to a hundredth."""
    return tuple((x, y) for x, y in np.round(np.asarray(xy, float), 2).tolist())


def triple(values: Float[np.ndarray, "3"]) -> Triple:
    """Three numbers as they are."""
    x, y, z = np.asarray(values, float).tolist()
    return x, y, z


def points_in_space(points: Float[np.ndarray, "n 3"]) -> tuple[Triple | None, ...]:
    """Points in metres, to a tenth of a millimetre; None where they are not finite."""
    return tuple(triple(point) if np.isfinite(point).all() else None for point in np.round(points, 4))


def shares(confidence: ArrayLike) -> tuple[float, ...]:
    """Confidences, to a thousandth."""
    return tuple(np.round(np.asarray(confidence, float), 3).tolist())


def curve_values(values: Float[np.ndarray, " T"], digits: int = 4) -> tuple[float | None, ...]:
    """Values for a curve, to so many digits; None where they are not finite."""
    return tuple(float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in np.asarray(values, float).tolist())


def spans(frames: ArrayLike) -> tuple[Span, ...]:
    """Runs of frames that follow each other, of frame numbers in any order."""
    return tuple((run[0], run[-1]) for run in runs(np.unique(np.asarray(frames, int)).tolist()))
