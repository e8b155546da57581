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
_ROWS = [f"{t + 1}\t{t / 120:.4f}\t" + "\t".join(map(str, places)) for t, places in enumerate(_PLACES.reshape(40, -1))]
Change = Callable[[bytearray], bytes | bytearray]


def c3d(says: str, change: Change, *, places: np.ndarray = _PLACES, names: tuple[str, ...] = _NAMES) -> Case:
    """A C3D file with one broken place."""

    def make(folder: Path) -> Path:
        path = folder / "walk.c3d"
        write_c3d(path, NamedPoints(names=names, places=places, frame_rate=120.0))
        path.write_bytes(change(bytearray(path.read_bytes())))
        return path

    return Case(make, read_reference, says)


def trc(says: str, *, rate: str = "120", names: tuple[str, ...] = _NAMES, rows: list[str] = _ROWS) -> Case:
    """A TRC file in metres."""
    head = ["PathFileType\t4\t(X/Y/Z)\twalk.trc", "DataRate\tNumMarkers\tUnits", f"{rate}\t{len(names)}\tm"]
    text = "\n".join([*head, "Frame#\tTime\t" + "\t\t\t".join(names), "", *rows])
    return Case(content("walk.trc", text), read_reference, says)


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


_WIDE = tuple(f"M{i}" for i in range(100_000))
_NOTHING = np.full_like(_PLACES, np.nan)
LABORATORY: dict[str, Case] = {
    "trc another rate": trc("40 frames go from 0 to 0.325 s, and at the 60 per second", rate="60"),
    "trc 120 Hz": trc("do not give a rate and a number of markers .*'120 Hz'", rate="120 Hz"),
    "trc frames left out": trc("30 frames go from 0 to 0.325 s", rows=[*_ROWS[:12], *_ROWS[22:]]),
    "trc frames in disorder": trc("from 0.1667 to 0.1583 s", rows=[*_ROWS[20:], *_ROWS[:20]]),
    "trc a time beyond all": trc("line 6 cannot be read", rows=["1\t1e300" + "\t0.5" * 15]),
    "trc numbers of nobody": trc("line 6 .* more than 15 numbers", rows=[row + "\t0.5" for row in _ROWS]),
    "trc decimal commas": trc("line 6 .*could not convert", rows=[row.replace(".", ",") for row in _ROWS]),
    "trc two names of a point": trc("are both right_knee", names=("RKnee", "right_knee", "Nose", "Neck", "LKnee")),
    "trc of spaces": Case(content("walk.trc", "PathFileType 4 (X/Y/Z)\n" * 9), read_reference, "do not give a rate"),
    "trc 100000 markers": trc("names 100000; expected .* up to 2000", names=_WIDE, rows=["1\t0"] * 1000),
    "c3d empty": Case(content("walk.c3d", b""), read_reference, "does not begin like such a file"),
    "c3d a text": Case(content("walk.c3d", "walk"), read_reference, "does not begin like such a file"),
    "c3d a folder": Case(directory("walk.c3d"), read_reference, "is a folder"),
    "c3d header alone": c3d("is damaged", lambda data: data[:512]),
    "c3d cut within its parameters": c3d("is damaged|has room for", lambda data: data[:700]),
    "c3d cut within its frames": c3d("states 40 frames of 5 points", lambda data: data[:-1500]),
    "c3d 10^9 frames": c3d("states 1000000000 frames .* room for", _many_frames),
    "c3d 60000 points": c3d("holds 60000 points", _parameter(b"POINT", b"USED", "<H", 60000)),
    "c3d no points": c3d("holds 0 points", _parameter(b"POINT", b"USED", "<H", 0)),
    "c3d 1000 points": c3d("states 40 frames of 1000 points", _parameter(b"POINT", b"USED", "<H", 1000)),
    "c3d rate 0": c3d("has 0 frames per second", _parameter(b"POINT", b"RATE", "<f", 0.0)),
    "c3d rate NaN": c3d("has nan frames per second", _parameter(b"POINT", b"RATE", "<f", float("nan"))),
    "c3d unit": c3d("is in 'ft'", _unit(b"ft")),
    "c3d frames in the header": c3d("has room for 0", _put(16, "<H", 1)),
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
