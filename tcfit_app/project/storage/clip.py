"""The clip of a project: its row in the database, its detections, and its video."""

import hashlib
import logging
import os
import re
import shutil
import sqlite3
from collections.abc import Mapping
from contextlib import closing, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from fitting_core.camera import DEFAULT_FOCAL, Camera, FocalFrom, default_focal, is_possible, with_focal_from
from fitting_core.clip import Clip
from fitting_core.config.settings import RANGES
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing, sync
from fitting_core.files.npz import read_npz
from fitting_core.files.regular import legible, regular_file
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.silhouettes import SILHOUETTE_SIDE, Silhouettes
from tcfit_app.project.storage import database
from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.columns import Columns, Count, Damage, json_of, line, of, or_none, text
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.media import UNREADABLE, MediaLink
from tcfit_app.project.storage.names import name_of_file

DETECTIONS = "detections.npz"
_WIDTHS = {"xy": (COUNT, 2), "confidence": (COUNT,)}
"""Its arrays: floating point, and their shapes behind the number of frames."""
_DETECTOR = "detector"
"""Its name beside them, which files of earlier versions lack."""
_LONGEST = 100
"""Letters of such a name."""
_SILHOUETTES = ("silhouettes", "silhouette_size", "silhouette_known")
"""More arrays of it, where a detector found silhouettes: see `Silhouettes`."""
_COMING = "detections.coming.npz"
"""Detections that take the place of those; the database's checksum says which of both files are the project's."""
_RATE = Annotated[float, msgspec.Meta(gt=0, le=10_000)]
_log = logging.getLogger(__name__)


def write_clip(draft: Path, clip: Clip, *, link: MediaLink | None) -> None:
    """Write a new project's database and detections.

    Args:
        draft: Where to.
        clip: With its detections.
        link: To the clip's source, if it has one.

    Raises:
        InputError: The database cannot be written.
        OSError: Another file cannot be written.
    """
    _write_detections(draft / DETECTIONS, clip)
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
        connection.execute("INSERT INTO clip VALUES (1, ?, ?, ?, ?, ?, ?, ?, ?, NULL)", values)


def read_clip(folder: Path, store: Database) -> tuple[Clip, MediaLink | None]:
    """The clip with its detections and without a source, and the link to that. `store.damage` has what is damaged.

    Raises:
        InputError: There is no clip, or its detections are missing or damaged.
    """
    rows = store.rows("SELECT * FROM clip")
    if not rows:
        raise InputError(f"{store.path}: has no clip in it; it is damaged. Take it from a backup.")
    row = Columns(rows[0], "the clip", store.damage)
    checksum = row.read("detections_sha256", _checksum, None, f"whether {DETECTIONS} is whole cannot be told")
    if checksum is not None and not store.read_only:
        _settle_detections(folder, checksum)
    keypoints, detector, silhouettes = _read_detections(folder, checksum)
    camera = row.read(
        "camera",
        lambda value: _camera(value, len(keypoints)),
        None,
        "one that stands still and sees all keypoints stands in for it",
    )
    notes = row.read("notes", json_of(tuple[str, ...]), (), "they are left out")
    clip = Clip(
        keypoints=keypoints,
        camera=_with_notes(camera, notes) if camera else _camera_around(keypoints),
        frame_rate=row.read("frame_rate", of(_RATE), 30.0, "30 frames per second stand in for it"),
        name=row.read("name", line, name_of_file(folder.resolve().stem), "that of the folder stands in for it"),
        first_frame=row.read("first_frame", of(Count), 0, "frames are counted from 0"),
        detector=detector,
        notes=notes,
        silhouettes=silhouettes,
    )
    return clip, _link(row)


def _link(row: Columns) -> MediaLink | None:
    return row.read("media", or_none(json_of(MediaLink)), UNREADABLE, "say where the video is")


def stored_link(copied: sqlite3.Connection) -> MediaLink | None:
    """The link to the video in a copy of a project's database."""
    return _link(_row_of_copy(copied))


def _row_of_copy(copied: sqlite3.Connection) -> Columns:
    """Whose damage the project itself has told."""
    return Columns(copied.execute("SELECT * FROM clip").fetchone(), "the clip", Damage())


def _checksum(value: Any) -> str:
    if not re.fullmatch("[0-9a-f]{64}", text(value)):
        raise ValueError("it is no SHA-256")
    return value


def _camera(value: Any, frames: int) -> Camera:
    camera = msgspec.convert(with_focal_from(json_of(dict[str, Any])(value)), Camera)
    if not is_possible(camera):
        raise ValueError("it is no camera")
    if camera.path is not None and len(camera.path) != frames:
        raise ValueError(f"it moves through {len(camera.path)} frames, and the clip has {frames}")
    return camera


def _with_notes(camera: Camera, notes: tuple[str, ...]) -> Camera:
    """With its own of a clip's notes: earlier versions kept these only there, and each begins with the file's name."""
    if camera.notes or camera.focal_from is not FocalFrom.FILE:
        return camera
    own = (note for note in notes if camera.source.startswith(f"camera file {note.partition(': ')[0]}, "))
    return replace(camera, notes=tuple(own))


def _camera_around(keypoints: Keypoints) -> Camera:
    """Of a guessed focal length, for images that hold all that was detected."""
    seen = keypoints.xy * (keypoints.confidence > 0)[..., None]
    width, height = (max(1, int(np.ceil(farthest))) for farthest in seen.max((0, 1)))
    focal = default_focal((width, height))
    middle, size = (width / 2, height / 2), (width, height)
    return Camera(focal=(focal, focal), center=middle, size=size, focal_from=FocalFrom.DIAGONAL, source=DEFAULT_FOCAL)


def same_detections(one: Keypoints, other: Keypoints) -> bool:
    """Whether both are the same keypoints, whatever a person has said about them."""
    return np.array_equal(one.xy, other.xy) and np.array_equal(one.confidence, other.confidence)


def creation_time(folder: Path) -> str:
    """When a project was made, which tells it from others of its name. Raises InputError if it cannot be read."""
    with closing(Database(folder / database.NAME, read_only=True)) as store:
        rows = store.rows("SELECT created FROM clip")
        return Columns(rows[0], "the clip", store.damage).read("created", text, "", "it is left out") if rows else ""


def replace_camera(store: Database, camera: Camera, notes: tuple[str, ...]) -> None:
    """Give a project another camera with the same lens, and the notes of its clip. Raises InputError as `Database`."""
    with store.transaction() as connection:
        connection.execute(
            "UPDATE clip SET camera = ?, notes = ?",
            (msgspec.json.encode(camera).decode(), msgspec.json.encode(notes).decode()),
        )


def read_height(store: Database) -> float | None:
    """Centimetres of the person in a project; None: not known."""
    rows = store.rows("SELECT height FROM clip")
    return Columns(rows[0], "the clip", store.damage).read("height", or_none(_height), None, "it is not known")


def _height(value: Any) -> float:
    if (height := msgspec.convert(value, float)) not in RANGES["height"]:
        raise ValueError(f"it is {height:g}, expected {RANGES['height']} cm")
    return height


def replace_height(store: Database, height: float | None) -> None:
    """Give the person of a project another height. Raises InputError as `Database`."""
    with store.transaction() as connection:
        connection.execute("UPDATE clip SET height = ?", (height,))


def replace_detections(folder: Path, store: Database, clip: Clip) -> None:
    """Give a project another clip's detections, with its notes and its camera; when this returns they are on the disk.

    Wherever it ends in between, the project opens with the old ones or the new ones: the new file lies beside the old
    one, the database's transaction decides, and then the new one takes the old one's place.

    Raises:
        InputError: The project cannot be written; it has its old detections then.
    """
    with accessing(folder):
        _write_detections(folder / _COMING, clip)
        new = _sha256(folder / _COMING)
        with store.transaction() as connection:
            connection.execute(
                "UPDATE clip SET detections_sha256 = ?, camera = ?, notes = ?",
                (new, msgspec.json.encode(clip.camera).decode(), msgspec.json.encode(clip.notes).decode()),
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
    with closing(database.copied(copied)) as connection:
        expected = _row_of_copy(connection).read("detections_sha256", _checksum, None, "")
    for name in (_COMING, DETECTIONS):  # in this order: the first becomes the second
        if (folder / name).is_file():
            with suppress(FileNotFoundError):
                shutil.copyfile(folder / name, target)
                if _sha256(target) == expected or (expected is None and name == DETECTIONS):
                    return True
    return False


def _write_detections(path: Path, clip: Clip) -> None:
    arrays = {name: np.asarray(getattr(clip.keypoints, name), dtype=float) for name in _WIDTHS}
    try:
        _check_detections(arrays)  # what could not be read back must not get there
    except ValueError as error:
        raise InputError(f"These keypoints cannot be stored: {error}.") from error
    arrays[_DETECTOR] = np.array(clip.detector[:_LONGEST])
    if (shown := clip.silhouettes) is not None:
        arrays |= dict(zip(_SILHOUETTES, (shown.packed, np.array(shown.size), shown.known), strict=True))
    with replacing(path) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def _read_detections(folder: Path, expected: str | None) -> tuple[Keypoints, str, Silhouettes | None]:
    """Keypoints, who detected them, and silhouettes if they were found as well.

    The checksum, if there is one, tells damage; a project of somebody else's may say that it is that of anything.
    """
    path, advice = folder / DETECTIONS, "It must stay as it was made: take it from a backup"
    try:
        path = path if expected is None else _detections_file(folder, expected)
        if expected is not None and _sha256(path) != expected:
            raise InputError(f"{path}: was changed since the project was made. {advice}.")
        arrays = read_npz(path, (*_WIDTHS, _DETECTOR, *_SILHOUETTES))
        detector = _detector(arrays.pop(_DETECTOR, None))
        shown = _silhouettes({name: arrays.pop(name) for name in _SILHOUETTES if name in arrays}, arrays)
        _check_detections(arrays)
    except InputError:  # is a ValueError, too
        raise
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}). {advice}.") from error
    for array in arrays.values():
        array.setflags(write=False)
    return Keypoints(**arrays), detector, shown


def _silhouettes(found: dict[str, np.ndarray], keypoints: Mapping[str, np.ndarray]) -> Silhouettes | None:
    """None where there are none. Raises ValueError if they are not those of a clip with these keypoints."""
    if not found:
        return None
    packed, size, known = (found[name] for name in _SILHOUETTES)
    if size.shape != (2,) or size.dtype.kind not in "iu" or not (size.min() >= 1 and size.max() <= SILHOUETTE_SIDE):
        raise ValueError(f"{_SILHOUETTES[1]} is {size.tolist()}, expected width and height up to {SILHOUETTE_SIDE}")
    count, (width, height) = len(keypoints["xy"]), size.tolist()
    shape = (count, -(-width * height // 8))
    if packed.shape != shape or packed.dtype != np.uint8 or known.shape != (count,) or known.dtype != bool:
        raise ValueError(f"{_SILHOUETTES[0]} is {packed.dtype} of the shape {packed.shape}, expected bytes of {shape}")
    return Silhouettes(packed=packed, size=(width, height), known=known)


def _detector(told: np.ndarray | None) -> str:
    """Its name; empty where the file does not tell, as those of earlier versions. Raises ValueError for no name."""
    if told is None:
        return ""
    if told.dtype.kind != "U" or told.shape != () or len(str(told)) > _LONGEST:
        raise ValueError(f"{_DETECTOR} is {told.dtype} of the shape {told.shape}, expected a name")
    return legible(str(told))


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
    return hashlib.sha256(regular_file(path).read_bytes()).hexdigest()
