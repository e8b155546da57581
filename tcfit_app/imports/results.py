"""Other programs' results as runs of a project: read, converted to its camera space, and stored for comparison."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.clip import Clip
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS
from fitting_core.errors import InputError
from fitting_core.io import read_motion
from fitting_core.io.motion.imported_motion import ImportedMotion, cover, from_still
from fitting_core.io.result_files import FIT_NAME
from fitting_core.io.whole_result import read_whole_result
from fitting_core.priors.files.registry import read_prior, registered_vposer, user_file
from fitting_core.priors.latent import LatentPrior
from fitting_core.results.fit_result import FitResult, PhaseResult
from fitting_core.starts.posing import posed_on
from fitting_core.video.frame_names import spans
from fitting_core.video.images import image_files
from tcfit_app.fitting.bodies import Bodies, record_of
from tcfit_app.project.project import Project
from tcfit_app.project.storage.names import name_of_file
from tcfit_app.project.storage.run_record import BodyRecord, Run

if TYPE_CHECKING:
    from fitting_core.io.motion.smplifyx import Decode

PHASE = 1
"""The phase of an imported result: it follows no corrections, and no fit starts from it."""


@dataclass(frozen=True, kw_only=True)
class ImportChoices:
    """Values that the files lack, or that replace theirs."""

    first_frame: int | None = None
    """Video frame number of the result's first frame; None: as its files are numbered, or the clip's first."""
    person: int | None = None
    """The number, if a result has several people; None: the person in most frames, or for SMPLify-X 0."""
    gender: str | None = None
    """Of the body; None: as in the file, otherwise neutral."""
    body_model: str | None = None
    """Another kind of body than the result's: smplx, smplh or smpl."""
    focal_length: float | None = None
    """Pixels, for a result without a camera."""


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
    """Read a result and store it as a finished run of the project. Raises InputError if it cannot be read or does not
    match the clip, its body is missing, or the project cannot be written.

    Nothing is written unless all of it can be read.

    Args:
        project: Open for writing.
        bodies: The source of body models.
        path: What `fitting_core.io.read_motion` reads.
        choices: None: everything as in the files.
        name: Of the run; by default the program and the file or folder.
        source: Its origin, for users; by default the path.
        goes_on: Called before anything is written; raises to cancel.
    """
    shown = name_of_file(source) if source else _name(path.resolve())
    source = name_of_file(source) if source else str(path)
    fit, body, placed = imported_fit(path, project.clip, bodies, choices or ImportChoices(), source=source)
    goes_on()
    program = re.sub(r" (results?|npz)$", "", fit.pose_prior)
    name, seen = name or name_of_file(f"{program}: {Path(shown).stem}"), project.last_edit
    summary = {"source": source, "format": fit.pose_prior, "placed": placed}
    return project.runs.start(
        fit.config, fit=fit, body=record_of(body), edits_seen=seen, summary=summary, kind="imported", name=name
    )


def imported_fit(
    path: Path, clip: Clip, bodies: Bodies, choices: ImportChoices, *, source: str
) -> tuple[FitResult, BodyModel, bool]:
    """A result as a fit of the clip, the body it poses, and whether it has a camera. Raises InputError if it cannot be
    read or does not match the clip, or its body model is missing."""
    decode = vposer_decoder()
    motion = read_motion(path, person=choices.person, gender=choices.gender, decode=decode)
    covered = cover(
        motion,
        len(clip),
        clip_first=clip.first_frame,
        clip_rate=clip.frame_rate,
        images=[image.stem for image in image_files(clip.source)],
        first_frame=choices.first_frame,
    )
    body, motion = posed_body(motion, bodies, choices)
    camera = motion.camera_for(clip.camera, choices.focal_length)
    params = motion.on(body, camera)[torch.as_tensor(covered.places)]
    if not motion.placed:
        params = from_still(body, params, camera)
    put = (
        () if motion.placed else (f"{path.name} has no camera, so its body was placed in front of the clip's camera.",)
    )
    lacks = _lacking(motion, covered.missing, clip)
    renamed = (note.replace(path.name, Path(source).name) for note in (*motion.notes, *put, *covered.notes, *lacks))
    notes = (f"Imported from {source}, read as {motion.format}.", *renamed)
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
    return fit, body, motion.placed


def _lacking(motion: ImportedMotion, missing: list[int], clip: Clip) -> tuple[str, ...]:
    """A note about the clip's frames without a result."""
    if not missing:
        return ()
    frames = spans([clip.first_frame + t for t in missing])
    return (
        f"{motion.source.name} has no result for {len(missing)} of the clip's {len(clip)} frames ({frames}): nothing "
        "is shown there, and exports use the nearest frame's pose.",
    )


def _name(path: Path) -> str:
    """The folder's name if the file's is generic."""
    return path.parent.name if path.name in ("results", FIT_NAME) and path.parent.name else path.name


def vposer_decoder() -> "Decode | None":
    """A decoder of VPoser's latent numbers, loaded on first use; None if VPoser is missing."""
    if not user_file().is_file():
        return None

    def decode(latent: Float[Tensor, "T 32"]) -> Float[Tensor, "T 63"]:
        prior = LatentPrior(read_prior(registered_vposer()))
        if prior.size != latent.shape[1]:
            raise InputError(
                f"{prior.title} has {prior.size} numbers, but the results have {latent.shape[1]}; expected the "
                "VPoser that they were fitted with."
            )
        return prior.decode(latent)

    return decode


def posed_body(motion: ImportedMotion, bodies: Bodies, choices: ImportChoices) -> tuple[BodyModel, ImportedMotion]:
    """The body to pose, and the motion without numbers that do not apply to that body. Raises InputError if the body
    model is missing."""
    kind, gender = choices.body_model or motion.kind, choices.gender or motion.gender
    if motion.body_hash and choices.body_model is None and choices.gender is None:
        record = BodyRecord(kind=kind, gender=gender, hash=motion.body_hash)
        try:
            return bodies.of(record), motion
        except InputError as error:
            raise InputError(
                f"{motion.source}: needs a {gender} {kind} body that is missing (SHA-256 {motion.body_hash[:12]}"
                f"...). Add it with `tcfit models add`, or choose another: --body-model {kind}."
            ) from error
    try:
        body = bodies.find(kind=kind, gender=gender)
    except InputError as error:
        if kind == "smplx":
            raise
        raise InputError(f"{error} Or pose an SMPL-X body without the shape: --body-model smplx.") from error
    return body, posed_on(motion, body)


def project_of_result(result: Path, folder: Path) -> None:
    """Make a project with a result's keypoints and its fit as the first run, whole or not at all.

    Args:
        result: Its folder.
        folder: Of the project; must not exist, or be empty.

    Raises:
        InputError: As of `read_whole_result` and `Project.create`.
    """
    whole = read_whole_result(result)
    stored, fit = whole.stored, whole.fit
    body = BodyRecord(kind=stored.body_kind, gender=stored.gender, hash=stored.body_hash)

    def begin(project: Project) -> None:
        project.set_height(fit.config.height)
        project.runs.start(
            fit.config, fit=fit, body=body, edits_seen=project.last_edit, kind="fit", summary=whole.summary
        )

    Project.create(folder, whole.clip, begin=begin).close()
