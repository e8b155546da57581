"""The clip of a project: its row in the database, its detections, and its video."""

import hashlib
import logging
import os
import re
from collections.abc import Mapping
from contextlib import closing, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from fitting_core.camera import Camera, FocalFrom, is_possible, with_focal_from
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
from tcfit_app.project.storage.columns import Columns, Count, json_of, line, of, or_none, text, undamaged
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.media import MediaLink
from tcfit_app.project.storage.names import name_of_file

DETECTIONS = "detections.npz"
_WIDTHS = {"xy": (COUNT, 2), "confidence": (COUNT,)}
"""Detection arrays: floating point, with their shapes after the frame axis."""
_DETECTOR = "detector"
"""The detector's name, missing in files of earlier versions."""
_LONGEST = 100
"""Maximum length of that name."""
_SILHOUETTES = ("silhouettes", "silhouette_size", "silhouette_known")
"""Further arrays if the detector provides silhouettes: see `Silhouettes`."""
_COMING = "detections.coming.npz"
"""New detections waiting to replace the old ones; the database's checksum says which file is valid."""
_RATE = Annotated[float, msgspec.Meta(gt=0, le=10_000)]
_log = logging.getLogger(__name__)


def write_clip(draft: Path, clip: Clip, *, link: MediaLink | None) -> None:
    """Write a new project's database and detections.

    Args:
        draft: Target folder.
        clip: With its detections.
        link: To the clip's source, if any.

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
    with closing(Database(draft / database.NAME, read_only=False)) as store, store.transaction() as connection:
        connection.execute("INSERT INTO clip VALUES (1, ?, ?, ?, ?, ?, ?, ?, ?, NULL)", values)


def read_clip(folder: Path, store: Database) -> tuple[Clip, MediaLink | None]:
    """The clip with its detections, without a source, and the link to the source. Raises InputError if there is no
    clip, it is damaged, or its detections are missing or damaged."""
    rows = store.rows("SELECT * FROM clip")
    if not rows:
        raise InputError(f"{store.path}: has no clip: it is damaged. Restore it from a backup.")
    with undamaged(store.path):
        row = Columns(rows[0])
        checksum = row.read("detections_sha256", _checksum)
        if not store.read_only:
            _settle_detections(folder, checksum)
        keypoints, detector, silhouettes = _read_detections(folder, checksum)
        notes = row.read("notes", json_of(tuple[str, ...]))
        clip = Clip(
            keypoints=keypoints,
            camera=_with_notes(row.read("camera", lambda value: _camera(value, len(keypoints))), notes),
            frame_rate=row.read("frame_rate", of(_RATE)),
            name=row.read("name", line),
            first_frame=row.read("first_frame", of(Count)),
            detector=detector,
            notes=notes,
            silhouettes=silhouettes,
        )
        return clip, row.read("media", or_none(json_of(MediaLink)))


def _checksum(value: Any) -> str:
    if not re.fullmatch("[0-9a-f]{64}", text(value)):
        raise ValueError("it is not a SHA-256")
    return value


def _camera(value: Any, frames: int) -> Camera:
    camera = msgspec.convert(with_focal_from(json_of(dict[str, Any])(value)), Camera)
    if not is_possible(camera):
        raise ValueError("it is not a camera")
    if camera.path is not None and len(camera.path) != frames:
        raise ValueError(f"it moves through {len(camera.path)} frames, but the clip has {frames}")
    return camera


def _with_notes(camera: Camera, notes: tuple[str, ...]) -> Camera:
    """With the camera's notes among a clip's: earlier versions stored them only there, after the file's name."""
    if camera.notes or camera.focal_from is not FocalFrom.FILE:
        return camera
    own = (note for note in notes if camera.source.startswith(f"camera file {note.partition(': ')[0]}, "))
    return replace(camera, notes=tuple(own))


def same_detections(one: Keypoints, other: Keypoints) -> bool:
    """Whether both have the same keypoints, ignoring a person's edits."""
    return np.array_equal(one.xy, other.xy) and np.array_equal(one.confidence, other.confidence)


def replace_camera(store: Database, camera: Camera, notes: tuple[str, ...]) -> None:
    """Store another camera with the same lens, and the clip's notes. Raises InputError as `Database`."""
    with store.transaction() as connection:
        connection.execute(
            "UPDATE clip SET camera = ?, notes = ?",
            (msgspec.json.encode(camera).decode(), msgspec.json.encode(notes).decode()),
        )


def read_height(store: Database) -> float | None:
    """The person's height in centimetres; None: unknown."""
    rows = store.rows("SELECT height FROM clip")
    with undamaged(store.path):
        return Columns(rows[0]).read("height", or_none(_height))


def _height(value: Any) -> float:
    if (height := msgspec.convert(value, float)) not in RANGES["height"]:
        raise ValueError(f"it is {height:g}, expected {RANGES['height']} cm")
    return height


def replace_height(store: Database, height: float | None) -> None:
    """Store the person's height. Raises InputError as `Database`."""
    with store.transaction() as connection:
        connection.execute("UPDATE clip SET height = ?", (height,))


def replace_detections(folder: Path, store: Database, clip: Clip) -> None:
    """Store another clip's detections, notes and camera; they are on disk when this returns.

    Wherever it is interrupted, the project opens with the old or the new ones: the new file is written next to the old
    one, the database's transaction decides, and then the new file replaces the old one.

    Raises:
        InputError: The project cannot be written; it keeps its old detections.
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
    """Move new detections into place, or delete them if the database does not know them.

    If that fails they are found under their own name until the project is opened again successfully.
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
    """The file of the project's detections: under the other name until the project is next opened for writing."""
    coming = folder / _COMING
    with suppress(FileNotFoundError):  # another process may just be renaming it
        if _sha256(coming) == expected:
            return coming
    return folder / DETECTIONS


def _write_detections(path: Path, clip: Clip) -> None:
    arrays = {name: np.asarray(getattr(clip.keypoints, name), dtype=float) for name in _WIDTHS}
    try:
        _check_detections(arrays)  # nothing unreadable may be stored
    except ValueError as error:
        raise InputError(f"Cannot store these keypoints: {error}.") from error
    arrays[_DETECTOR] = np.array(clip.detector[:_LONGEST])
    if (shown := clip.silhouettes) is not None:
        arrays |= dict(zip(_SILHOUETTES, (shown.packed, np.array(shown.size), shown.known), strict=True))
    with replacing(path) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def _read_detections(folder: Path, expected: str) -> tuple[Keypoints, str, Silhouettes | None]:
    """Keypoints, their detector, and silhouettes if any.

    The checksum only detects damage; a project made by someone else may contain any.
    """
    path, advice = folder / DETECTIONS, "It must not be changed: restore it from a backup"
    try:
        path = _detections_file(folder, expected)
        if _sha256(path) != expected:
            raise InputError(f"{path}: was changed after the project was created. {advice}.")
        arrays = read_npz(path, (*_WIDTHS, _DETECTOR, *_SILHOUETTES))
        detector = _detector(arrays.pop(_DETECTOR, None))
        shown = _silhouettes({name: arrays.pop(name) for name in _SILHOUETTES if name in arrays}, arrays)
        _check_detections(arrays)
    except InputError:  # is also a ValueError
        raise
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}). {advice}.") from error
    for array in arrays.values():
        array.setflags(write=False)
    return Keypoints(xy=arrays["xy"], confidence=arrays["confidence"]), detector, shown


def _silhouettes(found: dict[str, np.ndarray], keypoints: Mapping[str, np.ndarray]) -> Silhouettes | None:
    """None if missing. Raises ValueError if they do not match the clip's keypoints."""
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


def _detector(value: np.ndarray | None) -> str:
    """The detector's name; empty in files of earlier versions. Raises ValueError if invalid."""
    if value is None:
        return ""
    if value.dtype.kind != "U" or value.shape != () or len(str(value)) > _LONGEST:
        raise ValueError(f"{_DETECTOR} is {value.dtype} of the shape {value.shape}, expected a name")
    return legible(str(value))


def _check_detections(arrays: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError if these are not a clip's keypoints, KeyError if an array is missing."""
    for name, width in _WIDTHS.items():
        array = arrays[name]
        if array.dtype.kind != "f" or not array.ndim or array.shape[1:] != width:
            expected = ", ".join(map(str, width))
            raise ValueError(
                f"{name} is {array.dtype} of the shape {array.shape}, expected floats (frames, {expected})"
            )
        if not np.isfinite(array).all():
            raise ValueError(f"{name} has values that are not finite")
    xy, confidence = arrays["xy"], arrays["confidence"]
    if len(xy) != len(confidence) or not len(xy):
        raise ValueError(f"it has {len(xy)} frames of positions but {len(confidence)} of confidences")
    if not ((confidence >= 0) & (confidence <= 1)).all():
        raise ValueError("a confidence is not between 0 and 1")


def _sha256(path: Path) -> str:
    return hashlib.sha256(regular_file(path).read_bytes()).hexdigest()
