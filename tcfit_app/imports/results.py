"""Results of other programs as runs of a project: read, brought into its camera's space, and kept to compare with."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.files.registry import FREE_FOLDER
from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS
from fitting_core.errors import InputError
from fitting_core.files.atomic import scratch_folder
from fitting_core.fit.result import FitResult, PhaseResult
from fitting_core.io import read_motion
from fitting_core.io.motion.imported_motion import ImportedMotion, cover
from fitting_core.io.result_files import FIT_NAME
from fitting_core.priors.files.registry import read_prior, registered_vposer, user_file
from fitting_core.priors.latent import LatentPrior
from fitting_core.video.frames import image_files
from tcfit_app.fitting.bodies import Bodies, record_of
from tcfit_app.project.project import Project
from tcfit_app.project.storage.names import name_of_file
from tcfit_app.project.storage.run_record import BodyRecord, Run

if TYPE_CHECKING:
    from fitting_core.io.motion.smplifyx import Decode
import io
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager

PHASE = 1
"""Under which phase a result stands: nothing follows its corrections, and nothing is fitted on from it."""
_SAME_SHAPE = 0.01
"""Share by which the sides' ratio of two images that show the same may differ."""


@dataclass(frozen=True, kw_only=True)
class ImportChoices:
    """What the files do not tell, or what to take instead."""

    first_frame: int | None = None
    """Number in the video of the result's first frame; None: as its files are numbered, or the clip's first."""
    person: int | None = None
    """Of several people in a result, the number; None: who is in most frames, or of SMPLify-X 0."""
    gender: str | None = None
    """Of the body; None: as the file says, else neutral."""
    body_model: str | None = None
    """Another kind of body than the result's: smplx, smplh or smpl."""
    focal_length: float | None = None
    """Pixels, for a result without a camera."""
    vposer: Path | None = None
    """The VPoser that SMPLify-X used; None: the one that was added."""


def import_run(
    project: Project,
    bodies: Bodies,
    path: Path,
    choices: ImportChoices | None = None,
    *,
    name: str = "",
    source: str = "",
    goes_on: Callable[[], None] = lambda: None,
) -> Run:
    """Read a result and keep it as a finished run of the project.

    Nothing is written unless all of it could be read.

    Args:
        project: Open for writing.
        bodies: Where body models come from.
        path: What `fitting_core.io.read_motion` reads.
        choices: None: all as the files say.
        name: Of the run; by default that of the file or folder.
        source: Where it comes from, for the user; by default the path.
        goes_on: Called before anything is written; may raise, which ends it.

    Raises:
        InputError: It cannot be read or does not fit the clip, its body is not there, or the project cannot be written.
    """
    source = name_of_file(source) if source else str(path)
    fit, body = imported_fit(path, project.clip, bodies, choices or ImportChoices(), source=source)
    goes_on()
    name, seen = name or name_of_file(_name(path.resolve())), project.last_edit
    run = project.runs.start(fit.config, body=record_of(body), edits_seen=seen, kind="imported", name=name)
    try:
        return project.runs.finish(run.id, fit, summary={"source": source, "format": fit.pose_prior})
    except InputError as error:
        project.runs.end(run.id, "failed", str(error))
        raise


def imported_fit(
    path: Path, clip: Clip, bodies: Bodies, choices: ImportChoices, *, source: str
) -> tuple[FitResult, BodyModel]:
    """A result as a fit of the clip, and the body that it is posed with.

    Raises:
        InputError: It cannot be read or does not fit the clip, or its body is not there.
    """
    decode = _vposer(choices.vposer)
    motion = read_motion(path, person=choices.person, gender=choices.gender, decode=decode)
    covered = cover(
        motion,
        len(clip),
        clip_first=clip.first_frame,
        clip_rate=clip.frame_rate,
        images=[image.stem for image in image_files(clip.source)],
        first_frame=choices.first_frame,
    )
    body, motion = _with_body(motion, bodies, choices)
    camera = _camera(motion, clip, choices.focal_length)
    params = motion.on(body, camera)[torch.as_tensor(covered.places)]
    put = () if motion.placed else (f"{path.name} tells no camera: its body was put before the clip's camera.",)
    told = (note.replace(path.name, Path(source).name) for note in (*motion.notes, *put, *covered.notes))
    notes = (f"Imported from {source}, read as {motion.format}.", *told)
    phase = PhaseResult(
        phase=PHASE, params=params, objective={}, frame_cost=np.full(len(clip), np.nan), seconds=0.0, notes=notes
    )
    fit = FitResult(
        phases=(phase,),
        camera=camera,
        config=PRESETS[DEFAULT_PRESET],
        observed=np.repeat(covered.there[:, None], N_JOINTS, axis=1),
        pose_prior=motion.format,
    )
    return fit, body


def _name(path: Path) -> str:
    """A generic name says nothing; the folder around it does."""
    return path.parent.name if path.name in ("results", FIT_NAME) and path.parent.name else path.name


def _vposer(given: Path | None) -> "Decode | None":
    """What decodes VPoser's numbers, read when the first are met; None if none is there."""
    if given is None and not user_file().is_file():
        return None

    def decode(latent: Float[Tensor, "T 32"]) -> Float[Tensor, "T 63"]:
        prior = LatentPrior(read_prior(given if given is not None else registered_vposer()))
        if prior.size != latent.shape[1]:
            raise InputError(
                f"{prior.title} has {prior.size} numbers, the results {latent.shape[1]}; expected the VPoser that they "
                "were fitted with."
            )
        return prior.decode(latent)

    return decode


def _with_body(motion: ImportedMotion, bodies: Bodies, choices: ImportChoices) -> tuple[BodyModel, ImportedMotion]:
    """The body to pose, and the motion without those of its numbers that mean nothing to that body."""
    kind, gender = choices.body_model or motion.kind, choices.gender or motion.gender
    if motion.body_hash and choices.body_model is None and choices.gender is None:
        record = BodyRecord(kind=kind, gender=gender, hash=motion.body_hash)
        try:
            return bodies.of(record), motion
        except InputError as error:
            raise InputError(
                f"{motion.source}: belongs to a {gender} {kind} body that is not here (SHA-256 {motion.body_hash[:12]}"
                f"...). Add that with `tcfit models add`, or choose another: --body-model {kind}."
            ) from error
    try:
        body = bodies.find(kind=kind, gender=gender)
    except InputError as error:
        if kind == "smplx":
            raise
        raise InputError(f"{error} Or pose an SMPL-X body, without the shape: --body-model smplx.") from error
    own = body.source is not None and FREE_FOLDER in body.source.parents
    if body.hash == motion.body_hash or (not own and body.kind == motion.kind and not motion.body_hash):
        return body, motion
    whose = "tcfit's free body" if own else f"the {body.kind} body {body.source}"
    return body, _without_shape(motion, whose)


def _without_shape(motion: ImportedMotion, whose: str) -> ImportedMotion:
    """Betas, expressions and hand components are numbers of one body model; joint angles are not."""
    params = motion.params
    empty = {name: torch.zeros_like(getattr(params, name)) for name in ("betas", "expression")}
    lost = "shape and expression"
    if not motion.whole_hands and params.left_hand_pose.shape[1] < 45:
        empty |= {name: torch.zeros_like(getattr(params, name)) for name in ("left_hand_pose", "right_hand_pose")}
        lost = "shape, expression and hands (components)"
    note = f"It is posed on {whose}, to which its {lost} mean nothing: these are left out, joint angles are kept."
    return replace(motion, params=replace(params, **empty), notes=(*motion.notes, note))


def _camera(motion: ImportedMotion, clip: Clip, focal_length: float | None) -> Camera:
    """The camera that the result was found with, for images of the clip's size; it stands where the clip's does."""
    found = _own_camera(motion, clip, focal_length)
    return replace(found, lens=clip.camera.lens, world=clip.camera.world)


def _own_camera(motion: ImportedMotion, clip: Clip, focal_length: float | None) -> Camera:
    size = clip.camera.size
    if motion.camera is not None:
        return _scaled(motion, motion.camera, size)
    if focal_length is not None:
        if not (np.isfinite(focal_length) and focal_length > 0):
            raise InputError(f"The focal length is {focal_length:g}; expected pixels, above 0.")
        focal = (focal_length, "as given when it was imported")
    elif (told := motion.focal_for(size)) is not None:
        focal = told
    else:
        return clip.camera
    middle = (size[0] / 2, size[1] / 2)
    return Camera(focal=(focal[0], focal[0]), center=middle, size=size, source=focal[1])


def _scaled(motion: ImportedMotion, camera: Camera, size: tuple[int, int]) -> Camera:
    x, y = size[0] / camera.size[0], size[1] / camera.size[1]
    if abs(x / y - 1) > _SAME_SHAPE:
        raise InputError(
            f"{motion.source}: was found on images of {camera.size[0]} x {camera.size[1]} pixels, and the clip has "
            f"{size[0]} x {size[1]}; expected the result of this clip."
        )
    return replace(
        camera,
        focal=(camera.focal[0] * x, camera.focal[1] * y),
        center=(camera.center[0] * x, camera.center[1] * y),
        size=size,
    )


_STARTS: dict[bytes, str] = {
    b"PK\x03\x04": ".zip",
    b"\x1f\x8b": ".tar.gz",
    b"\x93NUMPY": ".npy",
    **dict.fromkeys(
        (b"\x80", b"\x78\x01", b"\x78\x5e", b"\x78\x9c", b"\x78\xda", b"BZh", b"\x5d\x00\x00", b"\xfd7zXZ"), ".pkl"
    ),
}
"""By a file's first bytes: what it is called here. The name that it came with never becomes part of a path."""


@contextmanager
def upload(name: str, content: bytes) -> Iterator[Path]:
    """An uploaded file on the disk, as long as the block lasts; errors about it have the name that the user knows.

    Raises:
        InputError: It is nothing that is read from uploads.
    """
    shown = name_of_file(name)
    suffix = next((suffix for start, suffix in _STARTS.items() if content.startswith(start)), None)
    if suffix is None:
        found = "is empty" if not content else "is no result"
        raise InputError(
            f"{shown}: {found}; expected an npz, a zip of SMPLify-X's results, one of their pickles, or a learned "
            "system's result."
        )
    if suffix == ".zip" and _has_arrays(content):
        suffix = ".npz"
    with kept_as(f"upload{suffix}", content, shown) as path:
        yield path


@contextmanager
def kept_as(name: str, content: bytes, shown: str) -> Iterator[Path]:
    """A file of this name and content, as long as the block lasts; errors call it what the user does."""
    with scratch_folder() as folder:
        path = folder / name
        path.write_bytes(content)
        try:
            yield path
        except InputError as error:
            raise InputError(str(error).replace(str(path), shown).replace(path.name, shown)) from error


def _has_arrays(content: bytes) -> bool:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return any(member.endswith(".npy") for member in archive.namelist())
    except (OSError, ValueError, zipfile.BadZipFile):
        return False
