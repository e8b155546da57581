"""What tcfit's page may send to the server: these eight messages of viser's protocol, in this form, and no others.

viser itself would take any message of its protocol, with any values: some it keeps and sends on to all tabs, others end
in a traceback. The names of types and fields here are viser's.
"""

from typing import Annotated

import msgspec

MESSAGE_BYTES = 1 << 20
"""A longer message ends its connection; the longest real one, a part of an upload, has half of that."""

Id = Annotated[str, msgspec.Meta(max_length=64)]
MOST = 1e9
"""No number is larger."""
Number = Annotated[float, msgspec.Meta(ge=-MOST, le=MOST)]
Vector = tuple[Number, Number, Number]
Pixels = Annotated[int, msgspec.Meta(ge=0, le=65_535)]
Count = Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]
# Not Number: the garbage collector crashes in msgspec 0.22 where a union has a bounded float and a tuple.
Value = float | str | tuple[float, float]
"""Of a widget: a number, a text or an option, two numbers."""


class _Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag=True):
    """One message; `type` says which."""


class ViewerCameraMessage(_Message, frozen=True):
    """Where the viewer's camera is, in the world; the field of view in radians."""

    wxyz: tuple[Number, Number, Number, Number]
    position: Vector
    fov: Annotated[float, msgspec.Meta(gt=0, lt=3.2)]
    near: Number
    far: Number
    image_height: Pixels
    image_width: Pixels
    look_at: Vector
    up_direction: Vector


class Updates(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What can change: the value alone."""

    value: Value


class GuiUpdateMessage(_Message, frozen=True):
    """The user has set a widget to another value; events of tcfit's own script come as a text field's value."""

    uuid: Id
    updates: Updates


class CommandTriggerMessage(_Message, frozen=True):
    """A command was chosen from the list of all."""

    uuid: Id


class FileTransferStartUpload(_Message, frozen=True):
    """A file will come in parts."""

    source_component_uuid: Id
    """The upload button's."""
    transfer_uuid: Id
    filename: Annotated[str, msgspec.Meta(max_length=1024)]
    mime_type: Annotated[str, msgspec.Meta(max_length=256)]
    part_count: Count
    size_bytes: Count


class FileTransferPart(_Message, frozen=True):
    """Part of a file, the first having number 0."""

    source_component_uuid: Id
    transfer_uuid: Id
    part_index: Count
    content: bytes


class TransformControlsDragStartMessage(_Message, frozen=True):
    """The user has taken hold of the rings around a joint."""

    name: Id
    """Of the node."""
    owner: Id
    """The tab's id in viser."""


class TransformControlsUpdateMessage(_Message, frozen=True):
    """The user has turned them."""

    name: Id
    wxyz: tuple[Number, Number, Number, Number]
    position: Vector
    owner: Id


class TransformControlsDragEndMessage(_Message, frozen=True):
    """The user has let go of them."""

    name: Id
    owner: Id


PageMessage = (
    ViewerCameraMessage
    | GuiUpdateMessage
    | CommandTriggerMessage
    | FileTransferStartUpload
    | FileTransferPart
    | TransformControlsDragStartMessage
    | TransformControlsUpdateMessage
    | TransformControlsDragEndMessage
)

_decoder = msgspec.msgpack.Decoder(PageMessage)
_encoder = msgspec.msgpack.Encoder()


def read(sent: bytes | str) -> PageMessage:
    """Decode a websocket message. Raises ValueError if tcfit's page does not send it."""
    if isinstance(sent, str):
        raise ValueError("a text")
    try:
        return _decoder.decode(sent)
    except RecursionError as error:  # lists in lists without end
        raise ValueError("too deep") from error


def written(message: PageMessage) -> bytes:
    """The message alone, without anything that `read` has passed over, such as a field that comes twice."""
    return _encoder.encode(message)
