"""Malformed files of laboratories: C3D, and TRC beyond what malformed_references.py has."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fitting_core.io.points.c3d_file import write_c3d
from fitting_core.io.points.named_points import NamedPoints
from fitting_core.measure.references.files import read_reference
from tests.fitting_core.io.malformed import Case, content, directory

_NAMES = ("LASI", "RASI", "LKNE", "RKNE", "C7")
_PLACES = np.random.default_rng(0).normal(0, 0.3, (40, 5, 3))
Change = Callable[[bytearray], bytes | bytearray]


def c3d(says: str, change: Change, *, places: np.ndarray = _PLACES, names: tuple[str, ...] = _NAMES) -> Case:
    """A C3D file with one broken place."""

    def make(folder: Path) -> Path:
        path = folder / "walk.c3d"
        write_c3d(path, NamedPoints(names=names, places=places, frame_rate=120.0))
        path.write_bytes(change(bytearray(path.read_bytes())))
        return path

    return Case(make, read_reference, says)


def _put(place: int, form: str, *values: float) -> Change:
    """Numbers in the header."""

    def change(data: bytearray) -> bytearray:
        struct.pack_into(form, data, place, *values)
        return data

    return change


def _parameter(group: bytes, name: bytes, form: str, *values: float) -> Change:
    """The numbers of a parameter, which lie behind its name, 2 bytes of offset, a type and its dimensions.

    Before a name are its length and the number of its group, which is negative before the group's own.
    """

    def change(data: bytearray) -> bytearray:
        number = -struct.unpack_from("b", data, data.index(group, 512) - 1)[0]
        place = data.index(bytes([len(name), number]) + name, 512) + 2 + len(name) + 2
        assert data[place + 1] <= 1, "a number, or a row of them"
        struct.pack_into(form, data, place + 2 + data[place + 1], *values)
        return data

    return change


def _unit(text: bytes) -> Change:
    """In place of mm."""

    def change(data: bytearray) -> bytearray:
        place = data.index(b"mm", data.index(b"UNITS", 512))
        data[place : place + 2] = text
        return data

    return change


def _many_frames(data: bytearray) -> bytearray:
    """10^9 frames, by ACTUAL_END_FIELD."""
    frames = 10**9
    return _parameter(b"TRIAL", b"ACTUAL_END_FIELD", "<HH", frames & 0xFFFF, frames >> 16)(data)


_NOTHING = np.full_like(_PLACES, np.nan)
LABORATORY: dict[str, Case] = {
    "c3d empty": Case(content("walk.c3d", b""), read_reference, "does not begin as such files do"),
    "c3d a text": Case(content("walk.c3d", "walk"), read_reference, "does not begin as such files do"),
    "c3d a folder": Case(directory("walk.c3d"), read_reference, "is a folder"),
    "c3d header alone": c3d("is damaged", lambda data: data[:512]),
    "c3d cut within its parameters": c3d("is damaged|has room for", lambda data: data[:700]),
    "c3d cut within its frames": c3d("says that it holds 40 frames", lambda data: data[:-1500]),
    "c3d 10^9 frames": c3d("says that it holds 1000000000 frames .* room for", _many_frames),
    "c3d 60000 points": c3d("holds 60000 points", _parameter(b"POINT", b"USED", "<H", 60000)),
    "c3d no points": c3d("holds 0 points", _parameter(b"POINT", b"USED", "<H", 0)),
    "c3d 1000 points": c3d("says that it holds 40 frames of 1000 points", _parameter(b"POINT", b"USED", "<H", 1000)),
    "c3d rate 0": c3d("has 0 frames per second", _parameter(b"POINT", b"RATE", "<f", 0.0)),
    "c3d rate NaN": c3d("has nan frames per second", _parameter(b"POINT", b"RATE", "<f", float("nan"))),
    "c3d unit": c3d("is in 'ft'", _unit(b"ft")),
    "c3d frames far behind": c3d("has room for 0", _put(16, "<H", 60000)),
    "c3d parameters far behind": c3d("is damaged", _put(0, "<B", 255)),
    "c3d unknown processor": c3d("is damaged", _put(515, "<B", 7)),
    "c3d last before first": c3d("expected 1 to", _parameter(b"TRIAL", b"ACTUAL_START_FIELD", "<HH", 500, 0)),
    "c3d same names": c3d("has two points 'LKNE'", lambda data: data, names=("LASI", "RASI", "LKNE", "LKNE", "C7")),
    "c3d unknown names": c3d("names 0 known points", lambda data: data, names=tuple("abcde")),
    "c3d all out of sight": c3d("no finite point", lambda data: data, places=_NOTHING),
    "c3d in metres": c3d("look|Scale", lambda data: data, places=_PLACES / 1000),
}
"""By name."""
