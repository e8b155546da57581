"""Limits on uploads, because viser keeps all parts of a file in memory and joins any of them."""

from dataclasses import dataclass, field

from tcfit_app.server.page_messages import MESSAGE_BYTES, FileTransferPart, FileTransferStartUpload

UPLOAD_BYTES = 256 << 20
"""Of one file; the page knows it too, and does not begin with a larger one."""
AT_ONCE = 2
"""Files that one page may be uploading at the same time."""
ROOM_BYTES = 4 * UPLOAD_BYTES
"""Of all files that are being uploaded, by all pages."""
_LEAST_PART = 64 << 10
"""Smaller parts, but for the last, would cost more memory than they bring; viser's page sends 512 KiB."""


def too_large(size: int) -> str:
    """The message about a file of that many bytes."""
    most = f"It has {size / 2**20:,.1f} MB; expected at most {UPLOAD_BYTES >> 20} MB."
    return f"{most} Copy it to the computer that runs tcfit, and give its path."


class NoRoom(ValueError):
    """A valid request that is refused now or at this size; reported to the user."""


@dataclass
class UploadRoom:
    """What all pages share."""

    free: int = ROOM_BYTES


@dataclass
class _Transfer:
    source: str
    size: int
    parts: int
    received: int = 0
    seen: set[int] = field(default_factory=set)


class Uploads:
    """Those of one page. What is refused must not get to viser."""

    def __init__(self, room: UploadRoom) -> None:
        self._room = room
        self._going: dict[str, _Transfer] = {}

    def begin(self, message: FileTransferStartUpload) -> None:
        """A file is announced.

        Raises:
            NoRoom: It is too large, or there are too many.
            ValueError: No page announces such a file.
        """
        size, parts = message.size_bytes, message.part_count
        if message.transfer_uuid in self._going or not _parts_of(size, MESSAGE_BYTES) <= parts <= _parts_of(
            size, _LEAST_PART
        ):
            raise ValueError(f"an upload of {size} bytes in {parts} parts")
        if size > UPLOAD_BYTES:
            raise NoRoom(too_large(size))
        if len(self._going) >= AT_ONCE or size > self._room.free:
            raise NoRoom("Too much is being uploaded at the moment. Reload this page, and try again.")
        if parts:
            self._room.free -= size
            self._going[message.transfer_uuid] = _Transfer(message.source_component_uuid, size, parts)

    def take(self, message: FileTransferPart) -> None:
        """Receive a part. Raises ValueError if it was not announced."""
        going, index, length = self._going.get(message.transfer_uuid), message.part_index, len(message.content)
        if going is None or message.source_component_uuid != going.source:
            raise ValueError("a part of no upload")
        last = len(going.seen) + 1 == going.parts
        received = going.received + length
        if index >= going.parts or index in going.seen or received > going.size or last != (received == going.size):
            raise ValueError(f"part {index} of {going.parts} with {length} bytes")
        going.seen.add(index)
        going.received = received
        if last:
            self._forget(message.transfer_uuid)

    def end(self) -> None:
        """The page is gone, and viser has forgotten its files."""
        for transfer in list(self._going):
            self._forget(transfer)

    def _forget(self, transfer: str) -> None:
        self._room.free += self._going.pop(transfer).size


def _parts_of(size: int, length: int) -> int:
    return -(-size // length)
