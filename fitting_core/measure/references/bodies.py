"""References that are poses of a body model: a truth of a generated clip, a fit, AMASS-style npz."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting_core.body.files.former import former_body
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body, list_bodies
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.errors import InputError
from fitting_core.io.motion.imported_motion import ImportedMotion
from fitting_core.io.motion.smplx_npz import read_smplx_npz
from fitting_core.io.result_files import read_fit
from fitting_core.io.truth import read_truth
from fitting_core.measure.references.reference import BodyOf, Reference, of_body
from fitting_core.shipped import FREE_FOLDER
from fitting_core.world_camera import WorldCamera, in_camera


def body_of(record: BodyOf, *, search: Path | None = None) -> BodyModel:
    """The body model of a reference. Raises InputError if it is not there; the message says which file goes where.

    Args:
        record: Which one.
        search: A model file or a folder that alone is searched; None: `registry.search_folders`, and the free bodies.
    """
    if not record.hash:
        return load_body(find_body(model=record.kind, gender=record.gender, search=search))
    for path in (*_candidates(search, record), *_candidates(FREE_FOLDER, record)):
        if hashlib.sha256(path.read_bytes()).hexdigest() == record.hash:
            return load_body(path)
    if (former := former_body(record.hash)) is not None:
        return former
    raise InputError(
        f"The {record.gender} {record.kind} body of the reference (its file's SHA-256 begins {record.hash[:12]}) is "
        "not on this computer. Put that file where `tcfit models` looks."
    )


def _candidates(search: Path | None, record: BodyOf) -> list[Path]:
    """Body files, the likeliest first."""
    if search is not None and search.is_file():
        return [search]
    found = sorted(list_bodies(search), key=lambda b: (b.kind != record.kind, b.gender != record.gender))
    return [file.path for file in found if not file.problem]


def reference_of(
    name: str, kind: str, body: BodyModel, params: BodyParams, *, frame_rate: float | None, in_camera: bool
) -> Reference:
    """A reference of a posed body."""
    points, exists = keypoints_in_space(body, params)
    points[:, ~exists] = np.nan
    return Reference(
        name=name,
        kind=kind,
        frame_rate=frame_rate,
        in_camera=in_camera,
        points=points,
        joints=joints_in_space(body, params),
        params=params,
        body=of_body(body),
    )


def read_generated(path: Path, *, search: Path | None) -> Reference:
    """The truth of a generated clip. Raises InputError if it is damaged, or its body is not there."""
    truth = read_truth(path)
    body = body_of(BodyOf(kind="smplx", gender="neutral", hash=truth.body_hash), search=search)
    rate = truth.frame_rate
    return reference_of(path.name, "truth of a generated clip", body, truth.params, frame_rate=rate, in_camera=True)


def read_other_fit(path: Path, *, search: Path | None) -> Reference:
    """Another fit's result. Raises InputError if it is damaged, or its body is not there."""
    fit = read_fit(path)
    body = body_of(BodyOf(kind=fit.body_kind, gender=fit.gender, hash=fit.body_hash), search=search)
    name = f"{path.parent.name}/{path.name}"
    found = reference_of(name, "another fit", body, fit.params, frame_rate=fit.frame_rate, in_camera=True)
    return replace(found, first_frame=fit.first_frame, notes=fit.notes)


def read_amass(path: Path, camera: WorldCamera | None, search: Path | None) -> Reference:
    """An SMPL-X or SMPL-H animation, as `io.smplx_npz` reads it.

    What tcfit exports says how its world is turned from the camera's space, so it needs no camera.

    Raises:
        InputError: It is not an animation, or there is no model of its kind and gender.
    """
    motion = read_smplx_npz(path)
    body = _amass_body(motion, search)
    params = motion.in_own_space(body)
    if camera is None and motion.placed:
        camera = WorldCamera(rotation=motion.turn[0].numpy(), translation=np.zeros(3))
    if camera is not None:
        params = in_camera(params, motion.pelvis(body).numpy(), camera)
    kind, rate = f"AMASS-style npz of {body.kind.upper()}", motion.frame_rate
    found = reference_of(path.name, kind, body, params, frame_rate=rate, in_camera=camera is not None)
    return replace(found, first_frame=motion.numbers[0], first_frame_known=motion.numbered, notes=motion.notes)


def _amass_body(motion: ImportedMotion, search: Path | None) -> BodyModel:
    if motion.body_hash:
        return body_of(BodyOf(kind=motion.kind, gender=motion.gender, hash=motion.body_hash), search=search)
    file = find_body(model=motion.kind, gender=motion.gender, search=search)
    if FREE_FOLDER in file.parents:
        raise InputError(
            f"{motion.source}: needs the official {motion.gender} {motion.kind.upper()} model, for its betas mean "
            "another shape on the free body. Get it from its official site and run `tcfit models add` with it."
        )
    return load_body(file)
