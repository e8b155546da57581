"""Messages between the list and its page."""

import json
from typing import Annotated, Literal

import msgspec

from tcfit_app.fitting.process_queue import Work
from tcfit_app.home.found import Kind
from tcfit_app.project.storage.clip_review import NOTE_CHARACTERS, State

Key = Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{12}$")]
"""A clip's key; unknown ones are refused."""
Keys = Annotated[tuple[Key, ...], msgspec.Meta(max_length=20_000)]

# --- to the page ---


def unforeseen(error: BaseException) -> str:
    """An internal error in words for users; log its traceback too."""
    return f"{type(error).__name__}: {error}. tcfit's terminal has the details."


class Row(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A clip in the list."""

    key: str
    name: str
    place: str
    group: str = ""
    """The place of the folder in which the people of this clip lie."""
    kind: Kind
    state: State = "new"
    frames: int = 0
    """0: unknown."""
    seconds: float = 0.0
    score: float | None = None
    """Of the worst place of the last fit, 1 or more; 0: nothing is suspicious; None: not computed."""
    left: int = 0
    """Suspicious places."""
    words: str = ""
    """About the worst of them."""
    frame: int | None = None
    """The worst one's, in numbers of the video."""
    off: dict[str, float] = {}
    """Reprojection error of body, hands and face: 95th percentile, pixels."""
    reviewer: str = ""
    altered: bool = False
    """Approved, and changed since."""
    note: str = ""
    notes: int = 0
    """Number of notes on frames."""
    busy: str = ""
    """Its current users."""
    work: Work | None = None
    problem: str = ""
    """Why it cannot be read."""


class Rows(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="rows"):
    """New or changed clips."""

    rows: list[Row]
    gone: list[str] = []
    whole: bool = False
    """These are all clips."""


class Picture(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="picture"):
    """A JPEG in base64; empty without a picture."""

    key: str
    data: str


class Opened(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="opened"):
    """A clip is ready to be opened."""

    key: str


class Refusal(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="refusal"):
    """An error message."""

    text: str


class Choice(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """An option."""

    value: str
    title: str
    hint: str = ""
    missing: bool = False
    """It is not available on this computer; `hint` says why."""


class Formats(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="formats"):
    """The export formats."""

    groups: dict[str, list[Choice]]
    axes: list[Choice]
    views: list[Choice]
    chosen: list[str]
    """The default ones."""


ToPage = Rows | Picture | Opened | Refusal | Formats


def encode(message: ToPage) -> str:
    """The JSON text of a message. Paths in it may not be valid UTF-8."""
    try:
        return msgspec.json.encode(message).decode()
    except UnicodeEncodeError:
        return json.dumps(msgspec.to_builtins(message))  # has escapes for the bytes that are not


# --- from the page ---


class _Asked(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", forbid_unknown_fields=True):
    """A request of a page."""


class Look(_Asked, frozen=True, kw_only=True, tag="look"):
    """Pictures of the clips that are in sight."""

    keys: Annotated[tuple[Key, ...], msgspec.Meta(max_length=100)]


class Open(_Asked, frozen=True, kw_only=True, tag="open"):
    """Prepare to open; a result or a video becomes a project first."""

    key: Key


class Fit(_Asked, frozen=True, kw_only=True, tag="fit"):
    """Fit one after the other; missing projects and keypoints are created."""

    keys: Keys


class AskFormats(_Asked, frozen=True, kw_only=True, tag="formats"):
    """Ask for the export formats."""


class Export(_Asked, frozen=True, kw_only=True, tag="export"):
    """Export one after the other, each beside its project."""

    keys: Keys
    formats: Annotated[tuple[Annotated[str, msgspec.Meta(max_length=100)], ...], msgspec.Meta(max_length=100)]
    axes: Literal["", "camera", "y-up", "z-up"] = ""
    view: Literal["", "side", "both"] = ""


class Cancel(_Asked, frozen=True, kw_only=True, tag="cancel"):
    """Cancel fits and exports, and clear messages of finished ones."""

    keys: Keys


class Approve(_Asked, frozen=True, kw_only=True, tag="approve"):
    """Approve clips, or withdraw the approval."""

    keys: Keys
    approved: bool


class WriteNote(_Asked, frozen=True, kw_only=True, tag="note"):
    """On the clip as a whole."""

    key: Key
    text: Annotated[str, msgspec.Meta(max_length=NOTE_CHARACTERS)]


FromPage = Look | Open | Fit | AskFormats | Export | Cancel | Approve | WriteNote
_DECODER = msgspec.json.Decoder(FromPage)


def decode(message: str | bytes) -> FromPage:
    """Raises msgspec.DecodeError for anything that the list's page does not send."""
    return _DECODER.decode(message)
