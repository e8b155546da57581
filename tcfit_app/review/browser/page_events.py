"""What the page tells the server: gestures on the picture and the timeline, keys, buttons in panels.

Frames are indices into the clip, from 0. Image pixels: x right, y down.
"""

from typing import Annotated, Literal

import msgspec

EVENT_CHARACTERS = 16_384
"""Longer ones are refused unread. The longest real one, a drag of all 137 keypoints, has 700 characters."""

Text = Annotated[str, msgspec.Meta(max_length=64)]
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
    """Made up by the page; the same after a reload, another one in every other tab."""
    width: Size
    """Of viser's canvas, in CSS pixels. The timeline lies below the canvas, not on it."""
    height: Size


class Resized(_Event, frozen=True, tag="resized"):
    """viser's canvas has another size: the window, a docked panel or the timeline changed."""

    width: Size
    height: Size


class Key(_Event, frozen=True, tag="key"):
    """A key of the `keys` state was pressed."""

    action: Text
    repeat: bool
    """Whether it is being held down."""


class Seek(_Event, frozen=True, tag="seek"):
    """The user points at a frame in the timeline."""

    frame: Frame


class Range(_Event, frozen=True, tag="range"):
    """The user chose frames in the timeline, both ends included, or none."""

    first: Frame | None
    last: Frame | None


class Select(_Event, frozen=True, tag="select"):
    """The user chose keypoints; the page has drawn it already."""

    joints: Joints
    how: Literal["replace", "add", "toggle"]


class Drag(_Event, frozen=True, tag="drag"):
    """Keypoints are being dragged.

    After `start` come any number of `move` and one of `end` and `cancel`. The page draws them itself while it lasts,
    and until a `keypoints` state shows them where they were left (or two seconds have passed).
    """

    phase: Literal["start", "move", "end", "cancel"]
    joints: Joints
    dx: Pixels
    """Since the press, in image pixels."""
    dy: Pixels
    frame: Frame
    """The one whose keypoints are on the screen."""


class Press(_Event, frozen=True, tag="press"):
    """A button in the HTML of a panel was pressed."""

    command: Text
    value: Text


class Gesture(_Event, frozen=True, tag="gesture"):
    """The user begins to move viser's camera, or goes on."""


class Drawn(_Event, frozen=True, tag="drawn"):
    """What was sent for this frame has been drawn: the sign that the next can be sent. A hidden tab sends none."""

    frame: Frame


class Stranger(_Event, frozen=True, tag="stranger"):
    """viser's page is not the one that the script knows; it does nothing."""

    viser: Text
    """Its version."""
    missing: Annotated[tuple[Text, ...], msgspec.Meta(max_length=64)]
    """What the script needs and has not found."""

    def __str__(self) -> str:
        return f"tcfit needs viser 1.1.x, found {self.viser}, whose page lacks: {', '.join(self.missing)}"


PageEvent = Hello | Resized | Key | Seek | Range | Select | Drag | Press | Gesture | Drawn


class Envelope(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An event as it travels."""

    number: Annotated[int, msgspec.Meta(ge=1)]
    """1, 2, 3 ...: viser drops a value that equals the one before."""
    event: PageEvent | Stranger


_decoder = msgspec.json.Decoder(Envelope, strict=True)


def decode(text: str) -> Envelope:
    """The event in this JSON.

    Raises:
        msgspec.DecodeError: It is too long, no JSON, or no event.
    """
    if len(text) > EVENT_CHARACTERS:
        raise msgspec.DecodeError(f"{len(text)} characters, {EVENT_CHARACTERS} are the most")
    try:
        return _decoder.decode(text)
    except (UnicodeEncodeError, RecursionError) as error:  # lone surrogates; brackets without end
        raise msgspec.DecodeError(str(error)) from error
