"""The focal length that a camera wrote into its photographs: one number of the Exif data of JPEG files."""

import struct
from collections.abc import Iterator
from pathlib import Path

from fitting_core.files.regular import regular_file

_START, _APP1, _SCAN = b"\xff\xd8", 0xE1, 0xDA
_HEADER = b"Exif\0\0"
_LONGEST = 1 << 18
"""Bytes of a file that are looked at: Exif data stand at its start, in at most 64 KiB."""
_EXIF_IFD, _FOCAL_35MM = 0x8769, 0xA405
_SHORT, _LONG = 3, 4


def focal_35mm(path: Path) -> float | None:
    """The 35 mm equivalent in millimetres that a photograph tells; None where it tells none, or is no JPEG file."""
    try:
        with regular_file(path, most=None).open("rb") as file:
            content = file.read(_LONGEST)
        data = _exif(content)
        if data is None:
            return None
        order = {b"II": "<", b"MM": ">"}[data[:2]]
        first = _entries(data, order, struct.unpack_from(order + "I", data, 4)[0])
        inner = dict(_entries(data, order, dict(first)[_EXIF_IFD]))
        return float(inner[_FOCAL_35MM]) or None  # 0 stands for "unknown"
    except (KeyError, struct.error):
        return None


def _exif(content: bytes) -> bytes | None:
    """The TIFF structure in the segment APP1 of a JPEG file (Exif 2.3, section 4.7)."""
    if not content.startswith(_START):
        return None
    at = len(_START)
    while at + 4 <= len(content) and content[at] == 0xFF and content[at + 1] != _SCAN:
        (length,) = struct.unpack_from(">H", content, at + 2)
        segment = content[at + 4 : at + 2 + length]
        if content[at + 1] == _APP1 and segment.startswith(_HEADER):
            return segment[len(_HEADER) :]
        at += 2 + length
    return None


def _entries(data: bytes, order: str, at: int) -> Iterator[tuple[int, int]]:
    """Tags and values of a directory, of those whose value is one whole number (TIFF 6.0, section 2)."""
    (count,) = struct.unpack_from(order + "H", data, at)
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, number = struct.unpack_from(order + "HHI", data, entry)
        if number == 1 and kind in (_SHORT, _LONG):
            yield tag, struct.unpack_from(order + ("H" if kind == _SHORT else "I"), data, entry + 8)[0]
