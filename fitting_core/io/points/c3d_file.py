"""C3D, the binary format of motion capture, by the package c3d: points with names, and events.

ezc3d, the other maintained reader, is compiled, and crashed the process on 16 of the first 189 files with a damaged
header or parameters; c3d, pure Python, raised an error or read on in all of 400.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import c3d
import numpy as np

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file
from fitting_core.io.points.named_points import (
    MOST_POINTS,
    NamedPoints,
    check_names,
    read_world,
    stated_camera,
    without_subject,
)

_UNITS = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "": 1e-3}
_MOST_BYTES, _MOST_FRAMES = 2**30, 10**6
_ROW = 255
"""Entries of one parameter: further ones are in parameters with a number appended to the name."""
_LAST_NUMBER = 65535
"""The highest frame number that all readers accept."""
_BLOCK = 512
_C3D = "a C3D file with 3D points"


@dataclass(frozen=True, kw_only=True)
class Event:
    """An event at a moment."""

    seconds: float
    """Of the video."""
    side: Literal["Left", "Right"]
    label: Literal["Foot Strike", "Foot Off"]


def write_c3d(
    path: Path,
    points: NamedPoints,
    *,
    events: Sequence[Event] = (),
    screen: tuple[str, str] | None = None,
    subject: str = "",
) -> None:
    """Write points in millimetres; frames are numbered from 1, the video's first one, at time 0. Raises OSError if it
    cannot be written; nothing is left of it.

    If a number would exceed _LAST_NUMBER, they are numbered from the points' first frame, and events are timed from it.
    The group TCFIT says where the camera stands, if known.

    Args:
        path: The file.
        points: At most MOST_POINTS.
        events: Written as the group EVENT, as in Vicon's programs.
        screen: The axes that point right and up on a screen, such as ("+X", "+Z"); None: not known.
        subject: Whose they are.
    """
    writer = c3d.Writer(point_rate=points.frame_rate, point_units="mm")
    first = points.first_frame or 0
    if first + len(points) > _LAST_NUMBER:  # some readers accept no higher numbers
        events = [replace(event, seconds=event.seconds - first / points.frame_rate) for event in events]
        first = 0
    writer.set_start_frame(first + 1)
    if screen is not None:
        writer.set_screen_axis(*screen)
    _set_texts(writer.point_group, "LABELS", points.names)
    _set_texts(writer.point_group, "DESCRIPTIONS", points.names)
    writer.set_analog_labels([""])
    group = writer.get_create("SUBJECTS")
    group.set("USED", "Subjects", 2, "<h", 1)
    _set_texts(group, "NAMES", (_plain(subject),))
    _set_events(writer, events, _plain(subject))
    if points.camera is not None:
        place = np.array(stated_camera(points.camera), "<f4")
        writer.get_create("TCFIT").add_param(
            "CAMERA",
            desc="R by rows, t (m): x_camera = R x + t",
            bytes_per_element=4,
            bytes=place.tobytes(),
            dimensions=[len(place)],
        )
    frames = np.zeros((len(points), len(points.names), 5), np.float32)
    frames[..., :3] = 1e3 * points.places
    frames[~np.isfinite(points.places).all(-1)] = (0, 0, 0, -1, 0)
    writer.add_frames([(frame, np.zeros((0, 0))) for frame in frames])
    with replacing(path) as draft, draft.open("wb") as file, _quietly():
        writer.write(file)


def _set_events(writer: c3d.Writer, events: Sequence[Event], subject: str) -> None:
    group = writer.get_create("EVENT")
    group.set("USED", "Events", 2, "<h", len(events))
    for start in range(0, len(events), _ROW):
        some, number = events[start : start + _ROW], _number(start)
        _set_texts(group, f"CONTEXTS{number}", [event.side for event in some])
        _set_texts(group, f"LABELS{number}", [event.label for event in some])
        _set_texts(group, f"DESCRIPTIONS{number}", [""] * len(some))
        _set_texts(group, f"SUBJECTS{number}", [subject] * len(some))
        times = np.array([[event.seconds // 60, event.seconds % 60] for event in some], "<f4")
        ids = np.array([_ICONS[event.label] for event in some], "<i2")
        for name, values, shape in (("TIMES", times, [2, len(some)]), ("ICON_IDS", ids, [len(some)])):
            group.add_param(
                f"{name}{number}",
                desc="Minutes, seconds" if name == "TIMES" else "",
                bytes_per_element=values.itemsize,
                bytes=values.tobytes(),
                dimensions=shape,
            )


_ICONS = {"Foot Strike": 1, "Foot Off": 2}
"""Vicon's numbers."""


def _number(start: int) -> str:
    return "" if start == 0 else str(1 + start // _ROW)


def _set_texts(group: "c3d.c3d.GroupEditable", name: str, texts: Sequence[str]) -> None:
    """Texts of equal length, in rows of at most _ROW."""
    for start in range(0, len(texts), _ROW):
        some = texts[start : start + _ROW]
        long = max(1, *map(len, some))
        packed = "".join(text.ljust(long) for text in some)
        assert packed.isascii(), "multi-byte letters would shift all later texts"
        group.set_str(f"{name}{_number(start)}", "", packed, long, len(some))


def _plain(text: str) -> str:
    """As ASCII, up to 60 letters."""
    return text.encode("ascii", "replace").decode().replace("?", "_")[:60]


def read_c3d(path: Path) -> NamedPoints:
    """Read points. Those with a negative residual, and those at exactly 0, 0, 0, were not seen. Raises InputError if it
    is not a C3D file, has no points, or fewer frames than it states."""
    try:
        regular_file(path, most=_MOST_BYTES)
        with path.open("rb") as file, _quietly():
            if file.read(2)[1:] != b"\x50":
                raise InputError(f"{path}: does not begin like such a file; expected {_C3D}.")
            file.seek(0)
            return _read(path, _Reader(file))
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); expected {_C3D}.") from error
    except Exception as error:  # c3d raises almost anything for a damaged file
        raise InputError(f"{path}: is damaged ({type(error).__name__}: {error!s:.80}); expected {_C3D}.") from error


class _Reader(c3d.Reader):
    """Accepts files that c3d refuses, and programs write."""

    def _check_metadata(self) -> None:
        """Header and parameters may disagree about analogue signals."""

    def get_analog_transform_parameters(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Analogue signals are not read: their scale, which some programs write as one number, is ignored."""
        return 1.0, np.ones(self.analog_used), np.zeros(self.analog_used, int)

    @property
    def first_frame(self) -> int:
        """Not 16-bit, which overflows after frame 65535."""
        return int(super().first_frame)

    @property
    def last_frame(self) -> int:
        """Likewise. If the first frame's number is 0, POINT:FRAMES is not a frame's number."""
        return int(super().last_frame if self.first_frame else self.header.last_frame)


def _read(path: Path, reader: c3d.Reader) -> NamedPoints:
    count, rate = int(reader.point_used), float(reader.point_rate)
    if not 0 < count <= MOST_POINTS:
        raise InputError(f"{path}: holds {count} points; expected 1 to {MOST_POINTS}.")
    if not 0 < rate < np.inf:
        raise InputError(f"{path}: has {rate:g} frames per second; expected a number above 0.")
    unit = _text(reader.get("POINT:UNITS"))
    if unit not in _UNITS:
        raise InputError(f"{path}: is in {unit[:20]!r}; expected {', '.join(filter(None, _UNITS))}.")
    frames = _frames(path, reader, count)
    names = _labels(reader)[:count]
    named = [i for i, name in enumerate(names) if name]
    names = without_subject([names[i] for i in named])
    check_names(path, names)
    places = np.full((frames, len(named), 3), np.nan)
    for t, (_, points, _) in zip(range(frames), reader.read_frames(copy=False, analog_transform=False), strict=False):
        seen = (points[named, 3] >= 0) & (points[named, :3] != 0).any(1)
        places[t, seen] = _UNITS[unit] * points[named, :3][seen]
    return NamedPoints(
        names=names,
        places=places,
        frame_rate=rate,
        # The first frame's number is 1 even in a trimmed trial.
        first_frame=max(reader.first_frame - 1, 0) or None,
        camera=read_world(path, [] if (param := reader.get("TCFIT:CAMERA")) is None else param.float_array.tolist()),
    )


def _frames(path: Path, reader: c3d.Reader, points: int) -> int:
    """The number of frames. Raises InputError if the file is too short for the number it states."""
    frames = int(reader.frame_count)
    width = 4 if reader.point_scale < 0 else 2
    each = width * (4 * points + int(reader.analog_used) * int(reader.analog_per_frame))
    size = path.stat().st_size
    before = int(reader.header.data_block) - 1  # blocks: the header, and parameters
    room = max(0, size - _BLOCK * before) // each if before > 1 else 0
    if not 0 < frames <= min(room, _MOST_FRAMES):
        raise InputError(
            f"{path}: states {frames} frames of {points} points, but has room for {room}; expected 1 to "
            f"{_MOST_FRAMES}, all present. It was cut off, or is damaged."
        )
    return frames


def _labels(reader: c3d.Reader) -> list[str]:
    """Of all points, even if they are more than one parameter can list."""
    found: list[str] = []
    for number in range(MOST_POINTS // _ROW + 1):
        param = reader.get(f"POINT:LABELS{_number(number * _ROW)}")
        if param is not None:
            found += [str(label).strip(" \0") for label in np.ravel(param.string_array)]
    return found


def _text(param: "c3d.c3d.Param | None") -> str:
    return "" if param is None else param.string_value.strip(" \0").lower()


def _quietly() -> warnings.catch_warnings:
    """Without c3d's warnings about files without analogue signals, and about what is checked here."""
    return warnings.catch_warnings(action="ignore")
