"""What the list's page is sent, and what it may send."""

import json
from collections.abc import Callable
from typing import Annotated, Literal

import msgspec

from tcfit_app.home.found import Kind
from tcfit_app.project.storage.clip_review import NOTE_CHARACTERS, State

Key = Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{12}$")]
"""Of a clip; one that is not in the list means nothing."""
Keys = Annotated[tuple[Key, ...], msgspec.Meta(max_length=20_000)]

# --- to the page ---


class Work(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is done to a clip in the background."""

    step: str
    """In words."""
    share: float | None = None
    """0 to 1."""
    ended: Literal["", "failed", "done"] = ""
    """How; `step` then says why, or what was done."""


Report = Callable[[Work], None]


def failure(error: BaseException) -> Work:
    """The end of a job by an unforeseen error."""
    return Work(step=unforeseen(error), ended="failed")


def unforeseen(error: BaseException) -> str:
    """An error that no user can have caused, for users; log its traceback too."""
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
    """0: not known."""
    seconds: float = 0.0
    score: float | None = None
    """Of the worst place of the last fit, from 1 on; 0: nothing is suspicious; None: it was not looked for."""
    left: int = 0
    """Suspicious places."""
    words: str = ""
    """About the worst of them."""
    frame: int | None = None
    """Of the worst of them, as users see it."""
    off: dict[str, float] = {}
    """How far body, hands and face are off: 95 % of the keypoints are less so, pixels."""
    reviewer: str = ""
    spent: float = 0.0
    """Seconds of all reviewers."""
    altered: bool = False
    """Approved once, and changed since."""
    note: str = ""
    notes: int = 0
    """On frames."""
    busy: str = ""
    """Who works on it now."""
    work: Work | None = None
    problem: str = ""
    """Why nothing is known of it."""


class Rows(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="rows"):
    """Clips that are new or others than before."""

    rows: list[Row]
    gone: list[str] = []
    whole: bool = False
    """There are no others."""
    me: str = ""
    """Under what name this page's user is known."""


class Picture(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="picture"):
    """A JPEG in base64; empty if there is none."""

    key: str
    data: str


class Opened(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="opened"):
    """A clip can be gone to."""

    key: str


class Told(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="told"):
    """Something went wrong."""

    text: str


class Choice(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Something that can be chosen."""

    value: str
    title: str
    hint: str = ""
    missing: bool = False
    """It cannot be chosen on this computer; `hint` says why."""


class Formats(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="formats"):
    """What clips can be exported as."""

    groups: dict[str, list[Choice]]
    axes: list[Choice]
    views: list[Choice]
    chosen: list[str]
    """Of a page that has not chosen yet."""


ToPage = Rows | Picture | Opened | Told | Formats


def encode(message: ToPage) -> str:
    """The JSON text of a message. Paths in it may not be valid UTF-8."""
    try:
        return msgspec.json.encode(message).decode()
    except UnicodeEncodeError:
        return json.dumps(msgspec.to_builtins(message))  # has escapes for the bytes that are not


# --- from the page ---


class _Asked(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", forbid_unknown_fields=True):
    """What a page asks for."""


class Look(_Asked, frozen=True, kw_only=True, tag="look"):
    """Pictures of the clips that are in sight."""

    keys: Annotated[tuple[Key, ...], msgspec.Meta(max_length=100)]


class Open(_Asked, frozen=True, kw_only=True, tag="open"):
    """Make ready to be gone to; of a result or a video a project is made."""

    key: Key


class Fit(_Asked, frozen=True, kw_only=True, tag="fit"):
    """One after the other; where keypoints or a project are missing they are made."""

    keys: Keys


class AskFormats(_Asked, frozen=True, kw_only=True, tag="formats"):
    """What clips can be exported as."""


class Export(_Asked, frozen=True, kw_only=True, tag="export"):
    """One after the other, each beside its project."""

    keys: Keys
    formats: Annotated[tuple[Annotated[str, msgspec.Meta(max_length=100)], ...], msgspec.Meta(max_length=100)]
    axes: Literal["", "camera", "y-up", "z-up"] = ""
    view: Literal["", "side", "both"] = ""


class Cancel(_Asked, frozen=True, kw_only=True, tag="cancel"):
    """Their fits and exports, or what is told of those that have ended."""

    keys: Keys


class Approve(_Asked, frozen=True, kw_only=True, tag="approve"):
    """Say that they are done, or no longer."""

    keys: Keys
    approved: bool


class WriteNote(_Asked, frozen=True, kw_only=True, tag="note"):
    """On the clip as a whole."""

    key: Key
    text: Annotated[str, msgspec.Meta(max_length=NOTE_CHARACTERS)]


FromPage = Look | Open | Fit | AskFormats | Export | Cancel | Approve | WriteNote
_DECODER = msgspec.json.Decoder(FromPage)


def decode(message: str | bytes) -> FromPage:
    """Raises msgspec.DecodeError for what no page of ours sends."""
    return _DECODER.decode(message)
