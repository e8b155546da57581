"""The clip of a project: its row in the database, its detections, and its video."""

import hashlib
import logging
import os
import shutil
import sqlite3
from collections.abc import Mapping
from contextlib import closing, suppress
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import numpy as np

from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz
from fitting_core.keypoints import COUNT, Keypoints
from tcfit_app.project.storage import database, media
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.durable import accessing, durable, sync
from tcfit_app.project.storage.media import MediaLink
from tcfit_app.project.storage.names import name_of_file

DETECTIONS = "detections.npz"
_WIDTHS = {"xy": (COUNT, 2), "confidence": (COUNT,)}
"""Its arrays: floating point, and their shapes behind the number of frames."""
_COMING = "detections.coming.npz"
"""Detections that take the place of those; the database's checksum says which of both files are the project's."""
_log = logging.getLogger(__name__)


def write_clip(draft: Path, folder: Path, clip: Clip, *, copy_media: bool) -> None:
    """Write a new project's database, detections and media.

    Args:
        draft: Where to.
        folder: What that folder is going to be called.
        clip: With its detections.
        copy_media: Copy the clip's source; else it is linked.

    Raises:
        InputError: The source cannot be read, or the database not be written.
        OSError: Another file cannot be written.
    """
    _write_detections(draft / DETECTIONS, clip.keypoints)
    link = None
    if clip.source:
        link = media.copy(clip.source, draft) if copy_media else media.link(clip.source, folder)
    Database.create(draft / database.NAME)
    values = (
        name_of_file(clip.name),
        datetime.now(UTC).isoformat(),
        clip.frame_rate,
        clip.first_frame,
        msgspec.json.encode(clip.camera).decode(),
        msgspec.json.encode(clip.notes).decode(),
        msgspec.json.encode(link).decode() if link else None,
        _sha256(draft / DETECTIONS),
    )
    with (
        closing(Database(draft / database.NAME, read_only=False)) as store,
        store.transaction() as connection,
    ):
        connection.execute("INSERT INTO clip VALUES (1, ?, ?, ?, ?, ?, ?, ?, ?)", values)
    sync(draft)


def read_clip(folder: Path, store: Database) -> tuple[Clip, MediaLink | None]:
    """The clip with its detections and without a source, and the link to that.

    Raises:
        InputError: One of them is missing or damaged.
    """
    rows = store.rows("SELECT * FROM clip")
    if not rows:
        raise InputError(f"{store.path}: has no clip in it; it is damaged. Take it from a backup.")
    row = rows[0]
    if not store.read_only:
        _settle_detections(folder, row["detections_sha256"])
    keypoints = _read_detections(folder, row["detections_sha256"])
    try:
        link = None if row["media"] is None else msgspec.json.decode(row["media"], type=MediaLink)
        clip = Clip(
            keypoints=keypoints,
            camera=msgspec.json.decode(row["camera"], type=Camera),
            frame_rate=row["frame_rate"],
            name=row["name"],
            first_frame=row["first_frame"],
            notes=msgspec.json.decode(row["notes"], type=tuple[str, ...]),
        )
    except (ValueError, TypeError) as error:
        raise InputError(f"{store.path}: the clip in it cannot be read ({error}); it is damaged.") from error
    return clip, link


def same_detections(one: Keypoints, other: Keypoints) -> bool:
    """Whether both are the same keypoints, whatever a person has said about them."""
    return np.array_equal(one.xy, other.xy) and np.array_equal(one.confidence, other.confidence)


def creation_time(folder: Path) -> str:
    """When a project was made, which tells it from others of its name. Raises InputError if it cannot be read."""
    with closing(Database(folder / database.NAME, read_only=True)) as store:
        rows = store.rows("SELECT created FROM clip")
    return rows[0]["created"] if rows else ""


def replace_detections(folder: Path, store: Database, keypoints: Keypoints, notes: tuple[str, ...]) -> None:
    """Give a project other detections, with the notes of its clip; when this returns they are on the disk.

    Wherever it ends in between, the project opens with the old ones or the new ones: the new file lies beside the old
    one, the database's transaction decides, and then the new one takes the old one's place.

    Raises:
        InputError: The project cannot be written; it has its old detections then.
    """
    with accessing(folder):
        _write_detections(folder / _COMING, keypoints)
        new = _sha256(folder / _COMING)
        with store.transaction() as connection:
            connection.execute(
                "UPDATE clip SET detections_sha256 = ?, notes = ?", (new, msgspec.json.encode(notes).decode())
            )
    _settle_detections(folder, new)


def _settle_detections(folder: Path, expected: str) -> None:
    """Let detections to come take their place, or delete them if the database does not know them.

    Where that fails they are found under their own name, until somebody opens the project and it succeeds.
    """
    coming = folder / _COMING
    try:
        if not coming.exists():
            return
        if _sha256(coming) == expected:
            os.replace(coming, folder / DETECTIONS)
        else:
            coming.unlink()
        sync(folder)
    except OSError as error:
        _log.warning("%s stays under that name for now: %s", coming, error)


def _detections_file(folder: Path, expected: str) -> Path:
    """Where the project's detections lie: under the other name too, as long as nobody has opened it for writing."""
    coming = folder / _COMING
    with suppress(FileNotFoundError):  # whoever has the project open may just give it its name
        if _sha256(coming) == expected:
            return coming
    return folder / DETECTIONS


def copy_detections(folder: Path, copied: Path, target: Path) -> bool:
    """Copy the detections that go with a copy of a project's database, while others may write to the project.

    Args:
        folder: The project's.
        copied: The copy of its database.
        target: The file to write.

    Returns:
        False if they are not there: they were replaced after the database was copied, or are damaged.

    Raises:
        OSError: Something cannot be read or written.
    """
    with closing(sqlite3.connect(copied)) as connection:
        (expected,) = connection.execute("SELECT detections_sha256 FROM clip").fetchone()
    for name in (_COMING, DETECTIONS):  # in this order: the first becomes the second
        if (folder / name).is_file():
            with suppress(FileNotFoundError):
                shutil.copyfile(folder / name, target)
                if _sha256(target) == expected:
                    return True
    return False


def _write_detections(path: Path, keypoints: Keypoints) -> None:
    arrays = {name: np.asarray(getattr(keypoints, name), dtype=float) for name in _WIDTHS}
    try:
        _check_detections(arrays)  # what could not be read back must not get there
    except ValueError as error:
        raise InputError(f"These keypoints cannot be stored: {error}.") from error
    with durable(path) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def _read_detections(folder: Path, expected: str) -> Keypoints:
    """The checksum tells damage; a project of somebody else's may say that it is the one of anything."""
    path, advice = folder / DETECTIONS, "It must stay as it was made: take it from a backup"
    try:
        path = _detections_file(folder, expected)
        if _sha256(path) != expected:
            raise InputError(f"{path}: was changed since the project was made. {advice}.")
        arrays = read_npz(path, _WIDTHS)
        _check_detections(arrays)
    except InputError:  # is a ValueError, too
        raise
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}). {advice}.") from error
    for array in arrays.values():
        array.setflags(write=False)
    return Keypoints(**arrays)


def _check_detections(arrays: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError if these are no keypoints of a clip, KeyError if an array is missing."""
    for name, width in _WIDTHS.items():
        array = arrays[name]
        if array.dtype.kind != "f" or not array.ndim or array.shape[1:] != width:
            expected = ", ".join(map(str, width))
            raise ValueError(
                f"{name} is {array.dtype} of the shape {array.shape}, expected floats (frames, {expected})"
            )
        if not np.isfinite(array).all():
            raise ValueError(f"{name} has values that are no finite numbers")
    xy, confidence = arrays["xy"], arrays["confidence"]
    if len(xy) != len(confidence) or not len(xy):
        raise ValueError(f"it has {len(xy)} frames of positions and {len(confidence)} of confidences")
    if not ((confidence >= 0) & (confidence <= 1)).all():
        raise ValueError("a confidence is not between 0 and 1")


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
