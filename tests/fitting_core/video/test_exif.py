"""Focal lengths in photographs, against files put together byte by byte."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from fitting_core.video.exif import focal_35mm


def tiff(order: str, entries: list[tuple[int, int, int]]) -> bytes:
    """A directory with a pointer to another one, which has these entries: tag, kind, value."""

    def entry(tag: int, kind: int, value: int) -> bytes:
        packed = struct.pack(order + ("H" if kind == 3 else "I"), value).ljust(4, b"\0")
        return struct.pack(order + "HHI", tag, kind, 1) + packed

    head = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, 8)
    first = struct.pack(order + "H", 1) + entry(0x8769, 4, 8 + 2 + 12 + 4) + bytes(4)
    return head + first + struct.pack(order + "H", len(entries)) + b"".join(entry(*e) for e in entries) + bytes(4)


def jpeg(data: bytes) -> bytes:
    """A small picture with a comment before its Exif data."""
    picture = cv2.imencode(".jpg", np.zeros((6, 8, 3), np.uint8))[1].tobytes()
    segments = [(0xFE, b"a comment"), (0xE1, b"Exif\0\0" + data)]
    return picture[:2] + b"".join(struct.pack(">BBH", 0xFF, kind, len(s) + 2) + s for kind, s in segments) + picture[2:]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("kind", "value"), [(3, 26), (4, 135)])
def test_what_a_photograph_tells(tmp_path: Path, order: str, kind: int, value: int):
    path = tmp_path / "one.jpg"
    path.write_bytes(jpeg(tiff(order, [(0x9000, 3, 1), (0xA405, kind, value)])))
    assert focal_35mm(path) == value


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\xd8",
        b"\x89PNG\r\n\x1a\n",
        jpeg(tiff("<", [(0xA405, 3, 0)])),  # unknown, says the standard
        jpeg(tiff("<", [(0x9000, 3, 26)])),
        jpeg(b""),
        jpeg(b"II"),
        jpeg(tiff("<", [(0xA405, 3, 26)])[:-8]),
        jpeg(b"XX" + tiff("<", [(0xA405, 3, 26)])[2:]),
    ],
)
def test_nothing_where_nothing_is_told(tmp_path: Path, content: bytes):
    path = tmp_path / "one.jpg"
    path.write_bytes(content)
    assert focal_35mm(path) is None
