"""What the page sends the server: gestures on picture and timeline, keys, buttons in panels.

Frames are indices into the clip, from 0. Image pixels: x right, y down.
"""

from typing import Annotated, Literal

import msgspec

EVENT_CHARACTERS = 16_384
"""Longer messages are refused unread. The longest valid one, a drag of all 137 keypoints, has 700 characters."""

Text = Annotated[str, msgspec.Meta(max_length=64)]
Value = Annotated[str, msgspec.Meta(max_length=256)]
"""Of a button, also the key of an entry of the review queue, which names all of its limbs."""
Pixels = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
Size = Annotated[int, msgspec.Meta(ge=0, le=65_535)]
Frame = Annotated[int, msgspec.Meta(ge=0)]
Joint = Annotated[int, msgspec.Meta(ge=0, lt=137)]
Joints = Annotated[tuple[Joint, ...], msgspec.Meta(max_length=137)]


class _Event(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type"):
    """One event; `type` in JSON says which."""


class Hello(_Event, frozen=True, tag="hello"):
    """The page is ready: the first event of every connection."""

    tab: Text
    """Chosen by the page; the same after a reload, different in every other tab."""
    width: Size
    """Of viser's canvas, in CSS pixels. The timeline is below the canvas, not on it."""
    height: Size
    browser: Text = ""
    """Chosen by the page; the same in all tabs of a browser, permanently."""
    dark: bool = True
    """As in `Theme`."""
    hinted: bool = True
    """The first steps have been read in this browser."""
    plots: Annotated[tuple[Text, ...], msgspec.Meta(max_length=64)] | None = None
    """The timeline rows last shown in this browser; None: there were none."""


class Theme(_Event, frozen=True, tag="theme"):
    """The page has become light or dark, as its system or by the user's choice."""

    dark: bool


class Resized(_Event, frozen=True, tag="resized"):
    """viser's canvas was resized: the window, a docked panel or the timeline changed."""

    width: Size
    height: Size


class Key(_Event, frozen=True, tag="key"):
    """A key from the `keys` state was pressed."""

    action: Text
    repeat: bool
    """Whether it is repeating while held down."""


class Seek(_Event, frozen=True, tag="seek"):
    """The user points at a frame in the timeline."""

    frame: Frame


class Range(_Event, frozen=True, tag="range"):
    """The user selected frames in the timeline, both ends included, or none."""

    first: Frame | None
    last: Frame | None


class OpenLink(_Event, frozen=True, tag="open_link"):
    """The page was opened by a link to a frame, and possibly a fit."""

    frame: Annotated[int, msgspec.Meta(ge=-(2**53), le=2**53)]
    """The number shown to users."""
    run: Annotated[int, msgspec.Meta(ge=0, le=2**53)] | None = None
    phase: Annotated[int, msgspec.Meta(ge=1, le=3)] | None = None
    person: Annotated[int, msgspec.Meta(ge=0, le=2**53)] | None = None
    """As in `CopyLink`; None: the person on show."""


class Plot(_Event, frozen=True, tag="plot"):
    """The user added or removed a row of the timeline."""

    name: Text
    """One of the timeline's choices."""
    shown: bool


class MoveKey(_Event, frozen=True, tag="move_key"):
    """The user dragged the tick of a keyframe to another frame."""

    frame: Frame
    to: Frame


class LookAt(_Event, frozen=True, tag="look_at"):
    """The user clicked on a review queue entry in the timeline; the page has already gone to its frame."""

    entry: Value
    """Its `Suspicion.key`."""


class Select(_Event, frozen=True, tag="select"):
    """The user selected keypoints; the page has already drawn that."""

    joints: Joints
    how: Literal["replace", "add", "toggle"]
    view: bool = False
    """In another view's picture."""


class Drag(_Event, frozen=True, tag="drag"):
    """Keypoints are being dragged.

    `start` is followed by any number of `move`, then `end` or `cancel`. Meanwhile the page draws them itself, until a
    `keypoints` state shows their final positions (or two seconds have passed).
    """

    phase: Literal["start", "move", "end", "cancel"]
    joints: Joints
    dx: Pixels
    """Since the press, in image pixels."""
    dy: Pixels
    frame: Frame
    """The person whose keypoints are on the screen."""
    view: bool = False
    """They are another view's, in its pixels."""


class DragDepth(_Event, frozen=True, tag="drag_depth"):
    """A keypoint of the fit is being dragged along its viewing ray in the side view; phases as in `Drag`."""

    phase: Literal["start", "move", "end", "cancel"]
    joint: Annotated[int, msgspec.Meta(ge=0, lt=25)]
    metres: Annotated[float, msgspec.Meta(ge=-10, le=10)]
    """Away from the camera, since the press."""
    frame: Frame
    """The fit that is on the screen."""


class Framed(_Event, frozen=True, tag="framed"):
    """A rectangle was drawn in a picture, as requested by `Framing`."""

    left: Pixels
    top: Pixels
    right: Pixels
    bottom: Pixels
    frame: Frame
    """The frame that was on the screen."""


class Press(_Event, frozen=True, tag="press"):
    """A button in the HTML of a panel was pressed."""

    command: Text
    value: Value


class TooLarge(_Event, frozen=True, tag="too_large"):
    """The user chose a file larger than `connect` allows; the page does not upload it."""

    name: Text
    """Only its end, if long."""
    size: Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]
    """In bytes."""


class Gesture(_Event, frozen=True, tag="gesture"):
    """The user starts or continues to move viser's camera."""


class GoToPerson(_Event, frozen=True, tag="go_to_person"):
    """The user wants to see another of the clip's people."""

    person: Annotated[int, msgspec.Meta(ge=0, lt=1000)]
    """Index from 0, as in `OtherPeople`."""


class Drawn(_Event, frozen=True, tag="drawn"):
    """What was sent for this frame has been drawn, so that the next can be sent. A hidden tab does not send this."""

    frame: Frame


class Stranger(_Event, frozen=True, tag="stranger"):
    """viser's page differs from the one that the script supports; the script does nothing."""

    viser: Text
    """Its version."""
    missing: Annotated[tuple[Text, ...], msgspec.Meta(max_length=64)]
    """What the script needs but did not find."""

    def __str__(self) -> str:
        return f"tcfit needs viser 1.1.x, found {self.viser}, whose page lacks: {', '.join(self.missing)}"


PageEvent = (
    Hello
    | Theme
    | Resized
    | Key
    | Seek
    | Range
    | Plot
    | MoveKey
    | LookAt
    | OpenLink
    | Select
    | Drag
    | DragDepth
    | Framed
    | Press
    | TooLarge
    | Gesture
    | GoToPerson
    | Drawn
)


class Envelope(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An event with its number."""

    number: Annotated[int, msgspec.Meta(ge=1)]
    """1, 2, 3 ...: viser drops a value that equals the one before."""
    event: PageEvent | Stranger


_decoder = msgspec.json.Decoder(Envelope, strict=True)


def decode(text: str) -> Envelope:
    """The event in a JSON text. Raises msgspec.DecodeError if it is too long, not JSON, or not an event."""
    if len(text) > EVENT_CHARACTERS:
        raise msgspec.DecodeError(f"{len(text)} characters, {EVENT_CHARACTERS} are the most")
    try:
        return _decoder.decode(text)
    except (UnicodeEncodeError, RecursionError) as error:  # lone surrogates; endless brackets
        raise msgspec.DecodeError(str(error)) from error
