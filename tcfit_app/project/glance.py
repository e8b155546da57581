"""What lists of projects show of one, read without opening it and without torch: a millisecond each."""

import os
import re
import sqlite3
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.keypoints import ERROR_GROUPS
from tcfit_app.project.storage.clip_review import ClipReview, State, read_clip_review
from tcfit_app.project.storage.columns import Columns, Count, Damage, json_of, line, of, or_none, undamaged
from tcfit_app.project.storage.database import NAME, WITH_KINDS, WITH_REVIEW, glimpse
from tcfit_app.project.storage.lock import NAME as LOCK
from tcfit_app.project.storage.lock import Holder, holder
from tcfit_app.project.storage.media import MediaLink, located

_DETECTIONS = "detections.npz"
_HEAD = 2048
"""Bytes in which an array's shape stands, packed or not."""
_SHAPE = re.compile(rb"'shape': \((\d{1,8}), ")
"""In the head of an array of NumPy."""


@dataclass(frozen=True, kw_only=True)
class Glance:
    """A project from outside."""

    name: str
    frames: int
    """0 if its keypoints cannot be read."""
    frame_rate: float
    first_frame: int
    media: tuple[Path, ...]
    """Where its video or images may be, the likelier place first."""
    state: State
    review: ClipReview
    notes: int
    """Entries of the log that write notes on frames."""
    fit: int | None
    """The run that counts, by its number."""
    off: dict[str, float]
    """Of its last phase, as of `off_by_part`."""
    holder: Holder | None
    """Who has it open for writing."""


Stamp = tuple[object, ...]


def stamp(folder: Path) -> Stamp:
    """Another one whenever something of a project may have changed; without reading it."""
    return (*(_status(folder / name) for name in (NAME, f"{NAME}-wal", LOCK)), holder(folder))


def _status(path: Path) -> tuple[int, int] | None:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


def glance(folder: Path) -> Glance:
    """Look at a project. Raises InputError if it cannot be read."""
    with undamaged(folder / NAME), glimpse(folder / NAME) as (connection, version):

        def rows(query: str, *values: object) -> list[sqlite3.Row]:
            return connection.execute(query, values).fetchall()

        found, damage = rows("SELECT * FROM clip"), Damage()
        if not found:
            raise InputError(f"{folder / NAME}: has no clip in it; it is damaged. Take it from a backup.")
        clip = Columns(found[0])
        own = "AND kind <> 'imported'" if version >= WITH_KINDS else ""  # as `newest` has it
        newest = f"WHERE deleted IS NULL AND state = 'finished' {own} ORDER BY id DESC LIMIT 1"
        counting = rows(f"SELECT id, summary, parent{', kind' if own else ''} FROM runs {newest}")
        fit, found_off = _fit(counting)
        review = read_clip_review(rows, damage) if version >= WITH_REVIEW else ClipReview()
        if (worst := review.worst) is not None and own and fit is not None and counting[0]["kind"] == "corrections":
            fit = worst.run if worst.run == counting[0]["parent"] else fit  # all corrections were undone
        if worst is not None and worst.run == fit and worst.off:
            found_off = worst.off
        link = clip.read("media", or_none(json_of(MediaLink)))
        notes = rows("""SELECT count(*) FROM edits WHERE action LIKE '{"kind":"note%'""")[0][0]
        places = () if link is None else ((located(link, folder),) * bool(link.relative) + (Path(link.absolute),))
        return Glance(
            name=clip.read("name", line),
            frames=_frames(folder),
            frame_rate=clip.read("frame_rate", _rate),
            first_frame=clip.read("first_frame", of(Count)),
            media=places,
            state=review.state(fitted=fit is not None),
            review=review,
            notes=notes,
            fit=fit,
            off=found_off,
            holder=holder(folder),
        )


def _rate(value: object) -> float:
    rate = msgspec.convert(value, float)
    if not 0 < rate <= 10_000:
        raise ValueError(f"it is {rate:g}")
    return rate


class _Summary(msgspec.Struct):
    reprojection_px: dict[str, dict[str, float | None]] = {}


def off_by_part(figures: Mapping[str, float | None]) -> dict[str, float]:
    """How far body, hands and face are off: 95 % of their keypoints are less so, pixels. The median of all ("all") in
    summaries of earlier versions, which state no parts."""
    parts = {name: px for name in ERROR_GROUPS if (px := figures.get(f"{name}_p95")) is not None}
    median = figures.get("median")
    return parts if parts or median is None else {"all": median}


def off_by_phase(phases: Mapping[str, Mapping[str, float | None]]) -> dict[str, float]:
    """The same of the last phase, of `reprojection_px` in a summary."""
    return off_by_part(phases[max(phases)]) if phases else {}


def _fit(runs: list[sqlite3.Row]) -> tuple[int | None, dict[str, float]]:
    """The run that counts, if there is one, and how far it is off."""
    if not runs:
        return None, {}
    try:
        phases = msgspec.json.decode(runs[0]["summary"] or "{}", type=_Summary).reprojection_px
    except (ValueError, TypeError, RecursionError):
        phases = {}
    return runs[0]["id"], off_by_phase(phases)


def _frames(folder: Path) -> int:
    """How many the clip has, from the head of its first array: zipfile and numpy would take fifteen times as long."""
    try:
        with regular_file(folder / _DETECTIONS).open("rb") as file:
            head = file.read(_HEAD)
        name, extra = int.from_bytes(head[26:28], "little"), int.from_bytes(head[28:30], "little")
        array = zlib.decompressobj(-zlib.MAX_WBITS).decompress(head[30 + name + extra :], _HEAD)
    except (OSError, InputError, zlib.error):
        return 0
    shape = _SHAPE.search(array)
    return int(shape[1]) if shape is not None else 0
