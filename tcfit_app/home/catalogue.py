"""The rows of the list: read once, and again when something has changed. A thousand take some megabytes."""

import logging
import os
import platform
import threading
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain, takewhile
from pathlib import Path

import msgspec

from fitting_core.errors import InputError
from fitting_core.files.regular import legible, regular_file
from fitting_core.io.people_file import read_people_file
from tcfit_app.fitting.process_queue import Work
from tcfit_app.home.found import Found, Kind, find
from tcfit_app.home.messages import Row, unforeseen
from tcfit_app.project.glance import Glance, Stamp, glance, off_by_phase, stamp
from tcfit_app.project.storage.database import is_project
from tcfit_app.project.storage.lock import Holder

SUMMARY = "summary.json"
"""`result_files.SUMMARY_NAME`, which would take torch's two seconds to import."""

_ORDER: dict[Kind, int] = {"project": 0, "result": 1, "video": 2, "images": 2}
"""A clip is shown once: as its project, or else its result, or else its video or images. The first two say which are
theirs."""
_READERS = 4
"""Threads that wait for the disk."""
_SUMMARY_BYTES = 64 << 20
_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A clip that is listed."""

    found: Found
    stamp: Stamp
    row: Row
    media: tuple[Path, ...] = ()
    """As of `Glance`, or a result's video."""
    first_frame: int = 0
    """As of `Glance`."""
    by: str = ""
    """Who has it open, as of `busy`."""


class Catalogue:
    """Everything below a folder. Thread-safe.

    Args:
        root: The folder.
        work_on: Returns the job on a clip, by its key.
    """

    def __init__(self, root: Path, work_on: Callable[[str], Work | None] = lambda key: None) -> None:
        self.root, self._work_on = root.resolve(), work_on
        self._guard = threading.Lock()
        self._entries: dict[str, Entry] = {}
        self._videos: dict[str, tuple[int, float]] = {}
        """Cached frame counts and seconds."""

    def get(self, key: str) -> Entry | None:
        """A clip by its key."""
        return self._entries.get(key)

    def rows(self) -> list[Row]:
        """All of them, by place."""
        return [entry.row for entry in self._entries.values()]

    def refresh(self) -> tuple[list[Row], list[str]]:
        """Read the disk. Returns the changed rows, and the keys of clips that are gone."""
        with self._guard:
            before, now, claimed = self._entries, dict[str, Entry](), set[Path]()
            found = find(self.root)
            with ThreadPoolExecutor(_READERS) as pool:
                parts = [found[start::_READERS] for start in range(_READERS)]
                entries = chain.from_iterable(pool.map(lambda part: self._entries_of(part, before), parts))
                read = {entry.found: entry for entry in entries}
            projects = {one.path: read[one].media for one in found if one.kind == "project"}
            for one in sorted(found, key=lambda one: _ORDER[one.kind]):
                if one.footage in claimed or (one.kind == "result" and _beside(read[one], projects) is not None):
                    continue
                entry = now[one.key] = read[one]
                claimed.update((one.path, *(Path(os.path.normpath(path)) for path in entry.media)))
            self._entries = {one.key: now[one.key] for one in found if one.key in now}
            changed = [e.row for key, e in self._entries.items() if key not in before or before[key].row != e.row]
            return changed, [key for key in before if key not in self._entries]

    def refresh_some(self, keys: Collection[str]) -> list[Row]:
        """Read some clips again. Returns the changed rows."""
        with self._guard:
            changed = []
            for key in keys:
                if (before := self._entries.get(key)) is not None:
                    entry = self._entries[key] = self._entry(before.found, before)
                    changed += [entry.row] * (entry.row != before.row)
            return changed

    def knows_length(self, key: str, frames: int, seconds: float) -> None:
        """Report the length of a video."""
        self._videos[key] = (frames, seconds)

    def has_length(self, key: str) -> bool:
        """Whether the length of a video is cached."""
        return key in self._videos

    def _entries_of(self, found: list[Found], before: dict[str, Entry]) -> list[Entry]:
        return [self._entry(one, before.get(one.key)) for one in found]

    def _entry(self, found: Found, before: Entry | None) -> Entry:
        new = _stamp(found)
        entry = before if before is not None and before.stamp == new else _read(found, new)
        work = self._work_on(found.key)
        # A job of ours has the project open, which `work` shows already.
        by = "" if work is not None and not work.ended else entry.by
        row = msgspec.structs.replace(entry.row, work=work, busy=by)
        if found.is_footage and (length := self._videos.get(found.key)):
            row = msgspec.structs.replace(row, frames=length[0], seconds=length[1])
        return Entry(found=found, stamp=new, row=row, media=entry.media, first_frame=entry.first_frame, by=entry.by)


def project_beside(result: Found) -> Path | None:
    """The folder of a result's project; None if it has none."""
    media = {place: _media(place) for place in takewhile(is_project, result.project_places())}
    return _beside(_read(result, ()), media)


def _media(project: Path) -> tuple[Path, ...]:
    try:
        return glance(project).media
    except InputError:  # reported when it is opened
        return ()


def _beside(result: Entry, projects: Mapping[Path, tuple[Path, ...]]) -> Path | None:
    """The project of a result among some, given by their media. One of another video is another clip's."""
    for place in result.found.project_places():
        if place not in projects:
            return None
        own = [path for path in result.media if path.exists()]
        if not own or not projects[place] or any(path.exists() and path.samefile(own[0]) for path in projects[place]):
            return place
    return None


def _stamp(found: Found) -> Stamp:
    if found.kind == "project":
        return stamp(found.path)
    try:
        status = os.stat(found.footage if found.is_footage else found.path / SUMMARY)
    except OSError:
        return ()
    return status.st_mtime_ns, status.st_size


def _read(found: Found, new: Stamp) -> Entry:
    name = found.path.stem if found.kind in ("project", "video") else found.path.name
    row = Row(
        key=found.key,
        name="".join(c if c.isprintable() else "?" for c in name),
        place=legible(found.place),
        kind=found.kind,
    )
    media, first_frame, by = tuple[Path, ...](), 0, ""
    try:
        if found.kind == "project":
            seen = glance(found.path)
            row, media, first_frame = _of_project(row, seen), seen.media, seen.first_frame
            by = busy(seen.holder)
        elif found.kind == "result":
            row, media = _of_result(row, found.path / SUMMARY)
        if found.one_of_people:
            row = _of_people(row, found.path)
    except InputError as error:
        row = msgspec.structs.replace(row, problem=str(error))
    except Exception as error:  # one clip must not keep the others off the list
        _log.exception("%s could not be read", found.path)
        row = msgspec.structs.replace(row, problem=unforeseen(error))
    return Entry(found=found, stamp=new, row=row, media=media, first_frame=first_frame, by=by)


def _of_people(row: Row, folder: Path) -> Row:
    """With the names of the clip and the person, as their file has them."""
    people = read_people_file(folder.parent)
    name = next((f"{people.name} - {one.name}" for one in people.people if one.folder == folder.name), row.name)
    return msgspec.structs.replace(row, name=name, group=row.place.rpartition("/")[0])


def _of_project(row: Row, seen: Glance) -> Row:
    review, worst = seen.review, seen.review.worst
    if worst is not None and worst.run != seen.fit:
        worst = None
    return msgspec.structs.replace(
        row,
        name=seen.name,
        state=seen.state,
        frames=seen.frames,
        seconds=seen.frames / seen.frame_rate,
        score=None if worst is None else worst.score,
        left=0 if worst is None else worst.left,
        words="" if worst is None else worst.words,
        frame=None if worst is None or not worst.left else seen.first_frame + worst.frame,
        off=seen.off,
        reviewer=review.reviewer,
        altered=review.altered,
        note=review.note,
        notes=seen.notes,
    )


def busy(holder: Holder | None) -> str:
    """Who has a project open, for the user; empty for a review that this process keeps open without a viewer."""
    if holder is None or holder.names:
        return "" if holder is None else holder.names
    here = holder.computer in ("", platform.node())
    if here and holder.process == str(os.getpid()):
        return ""
    where = "" if here else f" on {holder.computer}"
    return f"another tcfit (process {holder.process}{where})" if holder.process else "another tcfit"


class _Summary(msgspec.Struct):
    frames: int = 0
    frame_rate: float = 30.0
    reprojection_px: dict[str, dict[str, float | None]] = {}
    video: str | None = None


def _of_result(row: Row, path: Path) -> tuple[Row, tuple[Path, ...]]:
    try:
        found = msgspec.json.decode(regular_file(path, most=_SUMMARY_BYTES).read_bytes(), type=_Summary)
    except InputError:  # is a ValueError
        raise
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read ({error}).") from error
    row = msgspec.structs.replace(
        row,
        state="fitted",
        frames=max(found.frames, 0),
        seconds=max(found.frames, 0) / found.frame_rate if found.frame_rate > 0 else 0.0,
        off=off_by_phase(found.reprojection_px),
    )
    return row, () if found.video is None else (path.parent / found.video,)
