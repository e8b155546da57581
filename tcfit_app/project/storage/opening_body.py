"""opening.npz: the body with which a project opens, for pages that are drawn before torch is loaded.

It holds only for the fit, the corrections and the body model that it was posed from. Missing, out of date or
damaged, it is ignored.

| key | shape | |
|---|---|---|
| vertices | (V, 3) uint16 | steps from the least to the greatest coordinate of each axis |
| bounds | (2, 3) | these coordinates: camera space, metres |
| faces | (F, 3) | |
| opacities | (V,) uint8 | as in `BodyLayer`; missing if all are seen |
| about | () | JSON: the key of what it was posed from, the run, cameras |
"""

import hashlib
import logging
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Float32, Int, UInt8

from fitting_core.camera import Camera, is_possible
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz, write_npz
from tcfit_app.project.storage import media
from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.columns import json_of
from tcfit_app.project.storage.database import NAME, Database
from tcfit_app.project.storage.media import MediaLink
from tcfit_app.project.storage.run_record import BodyRecord

_FILE = "opening.npz"
_FORMAT = "tcfit opening 1"
_STEPS = 2**16 - 1
_MOST = 2**25
"""Bytes, unpacked."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True, eq=False)
class OpeningBody:
    """The newest fit's body in the clip's first frame."""

    run: int
    vertices: Float32[np.ndarray, "V 3"]
    """Camera space, metres."""
    faces: Int[np.ndarray, "F 3"]
    opacities: UInt8[np.ndarray, "V"] | None
    camera: Camera
    """The clip's, in its first frame."""
    fit_camera: Camera
    """The fit's."""


class _About(msgspec.Struct, frozen=True, kw_only=True):
    format: str
    key: str
    run: int
    camera: Camera
    fit_camera: Camera


def write_opening_body(folder: Path, database: Database, body: OpeningBody) -> None:
    """Store it in a project. Raises InputError if it cannot be written."""
    low, high = body.vertices.min(0), body.vertices.max(0)
    steps = np.round((body.vertices - low) / np.maximum(high - low, 1e-9) * _STEPS)
    arrays = {
        "vertices": steps.astype(np.uint16),
        "bounds": np.stack([low, high]),
        "faces": body.faces.astype(np.min_scalar_type(len(steps))),
    } | ({} if body.opacities is None else {"opacities": body.opacities})
    with accessing(folder):
        about = _About(
            format=_FORMAT,
            key=_key(folder, database, body.run),
            run=body.run,
            camera=replace(body.camera, path=None),
            fit_camera=replace(body.fit_camera, path=None),
        )
        write_npz(folder / _FILE, arrays | {"about": np.array(msgspec.json.encode(about).decode())})


def read_opening_body(folder: Path) -> tuple[OpeningBody, Path, int] | None:
    """What is stored in a project, with its video or images and the first frame's number there; None if it does not
    hold any more, or there is no picture."""
    if not (folder / _FILE).is_file():
        return None
    try:
        arrays = read_npz(folder / _FILE, most=_MOST)
        about = msgspec.json.decode(str(arrays["about"]), type=_About)
        with closing(Database(folder / NAME, read_only=True)) as database:
            if about.format != _FORMAT or about.key != _key(folder, database, about.run):
                return None
            row = database.rows("SELECT media, first_frame FROM clip")[0]
        path = media.find(json_of(MediaLink)(row["media"]), folder).path if row["media"] else None
        return None if path is None else (_body(arrays, about), path, int(row["first_frame"]))
    except (InputError, OSError, ValueError, KeyError, IndexError, TypeError) as error:
        _log.info("%s is not used: %s", folder / _FILE, error)
        return None


def _body(arrays: dict[str, np.ndarray], about: _About) -> OpeningBody:
    steps, (low, high), faces = arrays["vertices"], arrays["bounds"], arrays["faces"].astype(np.int64)
    opacities = arrays.get("opacities")
    vertices = (low + steps / _STEPS * (high - low)).astype(np.float32)
    sound = steps.shape == (len(steps), 3) and faces.shape == (len(faces), 3) and np.isfinite(vertices).all()
    if not sound or not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError("it is not a mesh")
    if opacities is not None and (opacities.shape != (len(vertices),) or opacities.dtype != np.uint8):
        raise ValueError("its opacities do not match its vertices")
    if not (is_possible(about.camera) and is_possible(about.fit_camera)):
        raise ValueError("it has no possible camera")
    return OpeningBody(
        run=about.run,
        vertices=vertices,
        faces=faces,
        opacities=opacities,
        camera=about.camera,
        fit_camera=about.fit_camera,
    )


def _key(folder: Path, database: Database, run: int) -> str:
    """Identifies everything that the body on show depends on: clip, edits, runs, and the files of the fit and of its
    body model."""
    found = hashlib.sha256()
    runs = database.rows("SELECT * FROM runs ORDER BY id")
    rows = [*database.rows("SELECT * FROM clip"), *database.rows("SELECT * FROM edits ORDER BY id DESC LIMIT 1"), *runs]
    source = json_of(BodyRecord)(next(row["body"] for row in runs if row["id"] == run)).source
    model = Path(source).stat() if source else None
    there = sorted(path.name for path in (folder / "runs").glob("*.npz"))
    parts = [tuple(row) for row in rows], there, source, model and (model.st_size, model.st_mtime_ns)
    found.update(repr(parts).encode())
    result = folder / "runs" / f"{run:06d}.npz"
    for path in (result, *sorted(result.with_suffix("").glob("*.npz"))):
        found.update(path.name.encode())
        with path.open("rb") as file:
            found.update(hashlib.file_digest(file, "sha256").digest())
    return found.hexdigest()
