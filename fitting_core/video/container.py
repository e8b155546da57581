"""What a video's container says without decoding: when its packets are shown, and whether the file was cut short."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np
from jaxtyping import Float

_VP8 = cv2.VideoWriter.fourcc(*"VP80")
_VP8_SHOWN = 0x10  # In the first byte of a packet (RFC 6386, section 9.1).
_MP4_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"styp")


def packet_times(path: Path) -> Float[np.ndarray, "P"]:
    """When each packet is shown, in milliseconds and sorted: 30,000 packets take a tenth of a second.

    VP8's packets that are never shown, only referred to (10 beside 180 frames), are left out. Not always when frames
    are: see `fitting_core.video.decoding`. Empty if OpenCV's backend cannot read a file without decoding it.
    """
    packets = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    some_hidden = int(packets.get(cv2.CAP_PROP_FOURCC)) == _VP8
    times = []
    while packets.grab():
        if not some_hidden or int(packets.retrieve()[1].flat[0]) & _VP8_SHOWN:
            times.append(packets.get(cv2.CAP_PROP_POS_MSEC))
    packets.release()
    return np.sort(np.array(times, dtype=float))  # Packets come in the order of decoding.


def ends_early(path: Path) -> bool:
    """Whether an AVI, MP4, MOV, MKV or WebM file has fewer bytes than its own parts say.

    Other containers, and streams written without lengths, cannot be told: False. The number of frames in the header is
    no sign: whole files of variable rate, cut without encoding again, or in FLV, have fewer.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
        file.seek(0)
        if head[:4] == b"RIFF":
            return _end_of_parts(file, size, _riff) > size
        if head[4:8] in _MP4_BOXES:
            return _end_of_parts(file, size, _box) > size
        return head[:4] == b"\x1a\x45\xdf\xa3" and _end_of_parts(file, size, _element) > size


def _end_of_parts(file: BinaryIO, size: int, length_of: Callable[[BinaryIO], int | None]) -> int:
    """Where the last part on the top level ends, in bytes; 0 if one does not say its length."""
    end = 0
    while end < size:
        file.seek(end)
        length = length_of(file)
        if not length:
            return 0
        end += length
    return end


def _riff(file: BinaryIO) -> int | None:
    """Bytes of the chunk that starts here: padded to an even number."""
    head = file.read(8)
    length = int.from_bytes(head[4:], "little")
    return 8 + length + length % 2 if len(head) == 8 and 0 < length < 0xFFFFFFFF else None


def _box(file: BinaryIO) -> int | None:
    """Bytes of the MP4 box that starts here; a length of 1 stands for a longer number, 0 for the rest: not told."""
    head = file.read(16)
    if len(head) < 8:
        return None
    (length,) = struct.unpack_from(">I", head)
    length = int.from_bytes(head[8:], "big") if length == 1 else length
    return length if length >= 8 else None  # its own head


def _element(file: BinaryIO) -> int | None:
    """Bytes of the EBML element that starts here; a length of all ones is not known, as in live recordings."""
    head = file.read(12)
    id_bytes = 9 - head[0].bit_length()
    length_bytes = 9 - head[id_bytes].bit_length() if id_bytes <= 4 < len(head) - id_bytes else 9
    if length_bytes > 8:
        return None
    length = int.from_bytes(head[id_bytes : id_bytes + length_bytes], "big") & ((1 << 7 * length_bytes) - 1)
    return None if length == (1 << 7 * length_bytes) - 1 else id_bytes + length_bytes + length
