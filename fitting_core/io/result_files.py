"""A fit as files in a folder: fit.npz, whose keys SMPL-X tools know, and summary.json.

fit.npz of N frames reads with np.load(allow_pickle=False). Axis-angle in radians, metres, camera space (see `AXES`).

| key | shape | |
|---|---|---|
| poses | (N, 165) | all joints: root, 21 of the body, jaw, eyes, left and right hand with their mean pose |
| root_orient, pose_body, pose_jaw, pose_eye, pose_hand | (N, 3), (N, 63), (N, 3), (N, 6), (N, 90) | its parts |
| trans, expressions | (N, 3), (N, 10) | |
| betas | (10,) | the shared shape; where only phase 1 has run, the mean over its frames, and trans keeps the pelvis |
| gender, surface_model_type, mocap_frame_rate, mocap_framerate | () | for the tools that read AMASS |
| global_orient, body_pose, left_hand_pose, right_hand_pose, jaw_pose, leye_pose, reye_pose, expression, \
camera_translation | (N, ...) | the same as `BodyParams` has it: hands as components over their mean |
| joints | (N, 55, 3) | posed joints |
| phase1_* | | BodyParams and joints of phase 1, betas (N, 10) |
| keypoints | (N, 137, 3) | what was fitted, as `keypoints.NAMES` has it: x and y in pixels of undistorted images, and \
confidence; what a person has said of depths and rotations is not there; files of earlier versions have none |
| frame_cost, phase1_frame_cost | (N,) | cost of each frame; files of earlier versions have none |
| observed | (N, 55) | whether a confident keypoint says how the joint is turned |
| start, stopped | (N,) | where each frame's fit came from and why its solver stopped, as numbers of the next two; not \
there where it is not known, as of an imported motion |
| start_texts, stopped_texts | (k,) | their meaning in English, the text of number i at i |
| joint_error_bars | (N, 22, 2) | how far off the body's joints may be relative to the pelvis, metres, along the ray \
of the camera through the joint and across it: 68 % of errors lie within, 95 % within 2.2 times as much; not there of \
phases 1 and 2, of fits without the lifter, and in files of earlier versions |
| angle_error_bars | (N, 13) | the same of joint angles (`results/error_bars.py` names them), degrees |
| gravity, gravity_deviation, ground, ground_deviation, ground_text, contacts, contact_probability | | what is known \
of the world: see fitting_core/ground/arrays.py; not there in files of earlier versions |
| size | () | of the person beside the people that the lifter knows; not there in files of earlier versions |
| camera_*, image_size, lens_*, world_*, path_* | | the camera: see fitting_core/io/camera_arrays.py |
| view1_*, view2_* | | other views of the person, if there are any: see fitting_core/io/view_arrays.py |
| first_frame, frames | (), (N,) | numbers in the video, from 0 |
| detector | () | detector of the keypoints: openpose, mediapipe or coco-wholebody; empty if unknown, missing \
in files of earlier versions |
| body_kind, body_hash, axes, last_phase, complete, format | () | what it is, and how far the fit went |

The arrays have SMPL-X's layout for any kind of body, so surface_model_type is always "smplx".
"""

import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from jaxtyping import Bool, Float

from fitting_core.body.model import N_BETAS, N_JOINTS, BodyModel
from fitting_core.body.params import BodyParams, full_pose
from fitting_core.body.points.positions import joints_in_space
from fitting_core.camera import Camera
from fitting_core.clip import Clip, OtherView
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.files.regular import StrPath, legible, regular_file
from fitting_core.ground.arrays import grounding_arrays, grounding_from
from fitting_core.ground.grounding import Grounding
from fitting_core.io.camera_arrays import camera_arrays, camera_from
from fitting_core.io.motion.animation_npz import pose_arrays
from fitting_core.io.summary import summary
from fitting_core.io.view_arrays import keypoint_array, keypoints_from, view_arrays, views_from
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.motion import Motion
from fitting_core.results.error_bars import ErrorBars, error_bar_arrays, error_bars_from
from fitting_core.results.fit_result import FitResult, size_from, stopped_note
from fitting_core.results.provenance import STARTS, STOPS, Provenance

RESULT_NAMES = FIT_NAME, SUMMARY_NAME, OVERLAY_NAME = "fit.npz", "summary.json", "overlay.mp4"
_SUMMARY_BYTES = 2**24
FORMAT = "tcfit fit 1"
AXES = (
    "Camera space in metres: x right, y down, z away from the camera. Angles are axis-angle in radians. Vertices are "
    "the body skinned with poses, betas and expressions, plus trans; the camera stands at the origin, unrotated; one "
    "that moves does so in each frame (path_rotation, path_translation)."
)
PHASE1 = "phase1_"
"""Before the names of the parameters that phase 1 found, frame by frame."""

_NAMES = tuple(f.name for f in fields(BodyParams))
_WIDTHS = {name: tensor.shape[1] for name, tensor in vars(BodyParams.neutral(0)).items()}
_HANDS = ("left_hand_pose", "right_hand_pose")
_TEXTS = {"start_texts": STARTS, "stopped_texts": STOPS}


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredFit:
    """The content of fit.npz, for T frames."""

    params: BodyParams
    """Of the last finished phase."""
    phase1: BodyParams
    """Each frame fitted on its own."""
    joints: Float[np.ndarray, "T 55 3"]
    """Camera space, metres."""
    observed: Bool[np.ndarray, "T 55"]
    provenance: Provenance | None
    """Of the last finished phase; None in files of earlier versions."""
    camera: Camera
    frame_rate: float
    first_frame: int
    """Number of the first fitted frame in the video."""
    gender: str
    body_kind: str
    body_hash: str
    last_phase: int
    complete: bool
    """Whether the fit went through; if not, these are the phases that it finished."""
    error_bars: ErrorBars | None = None
    """Of the last finished phase; None if the file lacks it."""
    grounding: Grounding | None = None
    """Gravity, contacts and floor; None in files of earlier versions."""
    size: float | None = None
    """As `FitResult.size`; None in files of earlier versions."""
    keypoints: Keypoints | None = None
    """The fitted keypoints; None in files of earlier versions."""
    detector: str = ""
    """As `Clip.detector`."""
    frame_cost: Float[np.ndarray, "T"] | None = None
    """Of the last finished phase; None if the file lacks it."""
    phase1_frame_cost: Float[np.ndarray, "T"] | None = None
    """The same of phase 1."""
    views: tuple[OtherView, ...] = ()
    """As `Clip.views`, without their videos."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What users of the result should know."""
        return () if self.complete else (stopped_note(self.last_phase),)


def write_result(
    folder: StrPath, fit: FitResult, clip: Clip, body: BodyModel, *, complete: bool = True, command: str = ""
) -> dict[str, Any]:
    """Write fit.npz and summary.json, each atomically; an overlay of an earlier fit is removed.

    Args:
        folder: Made if it does not exist.
        fit: At least one phase of it.
        clip: What was fitted.
        body: With which body.
        complete: Whether all phases that were asked for have finished.
        command: The command line, for the record.

    Returns:
        What is in summary.json.

    Raises:
        InputError: The folder cannot be written.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / OVERLAY_NAME).unlink(missing_ok=True)
        write_npz(folder / FIT_NAME, fit_arrays(fit, clip, body, complete=complete))
        with replacing(folder / SUMMARY_NAME) as draft:
            content = summary(fit, clip, body, complete=complete, command=command)
            content |= {
                "video": _relative(clip, folder),
                "other_videos": [_relative(view.clip, folder) for view in clip.views],
            }
            draft.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n")
            return content
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror or error}). Free space, or choose another --out."
        ) from error


def _relative(clip: Clip, folder: Path) -> str | None:
    """From a result to its video, relative, so that both can be moved together."""
    return None if clip.source is None else legible(os.path.relpath(clip.source.resolve(), folder.resolve()))


def video_of(folder: Path) -> Path | None:
    """The video or images of a result, if its summary.json names them and they exist."""
    try:
        told = msgspec.json.decode(regular_file(folder / SUMMARY_NAME, most=_SUMMARY_BYTES).read_bytes())
        path = folder / told["video"]
        return path if path.exists() else None
    except (OSError, ValueError, KeyError, TypeError, InputError):  # of an earlier version, or not ours
        return None


def is_result(folder: Path) -> bool:
    """Whether a folder holds a result that `write_result` wrote."""
    return (folder / FIT_NAME).is_file() and (folder / SUMMARY_NAME).is_file()


def fit_arrays(fit: FitResult, clip: Clip, body: BodyModel, *, complete: bool = True) -> dict[str, np.ndarray]:
    """The arrays of fit.npz by name, as the table above describes them."""
    first = fit.phases[0].params
    motion = Motion(body=body, params=fit.last.params, camera=fit.camera, frame_rate=clip.frame_rate, name=clip.name)
    shaped = motion.one_shape.params
    last = fit.last.params if fit.last.phase == 1 else shaped  # phase 1 has betas of its own in the file
    arrays: dict[str, Any] = _smplx_arrays(body, shaped)
    arrays |= {name: getattr(last, name).numpy() for name in _NAMES} | {"betas": shaped.betas[0].numpy()}
    arrays |= {PHASE1 + name: getattr(first, name).numpy() for name in _NAMES}
    arrays |= {"joints": joints_in_space(body, last), f"{PHASE1}joints": joints_in_space(body, first)}
    arrays |= camera_arrays(fit.camera)
    arrays |= {
        "keypoints": keypoint_array(clip.keypoints),
        "frame_cost": fit.last.frame_cost,
        f"{PHASE1}frame_cost": fit.phases[0].frame_cost,
        "observed": fit.observed,
        "first_frame": clip.first_frame,
        "frames": clip.first_frame + np.arange(len(clip)),
        "mocap_frame_rate": clip.frame_rate,
        "mocap_framerate": clip.frame_rate,
        "detector": clip.detector,
        "gender": body.gender,
        "body_kind": body.kind,
        "body_hash": body.hash,
        "axes": AXES,
        "last_phase": fit.last.phase,
        "complete": complete,
        "format": FORMAT,
    }
    arrays |= _provenance_arrays(fit.last.provenance) | error_bar_arrays(fit.last.error_bars)
    arrays |= grounding_arrays(fit.grounding) | ({} if fit.size is None else {"size": fit.size})
    arrays |= view_arrays(clip.views)
    return {name: np.asarray(value) for name, value in arrays.items()}


def _provenance_arrays(provenance: Provenance | None) -> dict[str, Any]:
    if provenance is None:
        return {}
    texts = {name: [table[i] for i in range(len(table))] for name, table in _TEXTS.items()}
    return {"start": provenance.start, "stopped": provenance.stopped, **texts}


def _smplx_arrays(body: BodyModel, params: BodyParams) -> dict[str, Any]:
    """The keys of SMPL-X npz files as AMASS and the Blender add-ons name them."""
    pose = full_pose(body, params).flatten(1).numpy()
    return {
        "surface_model_type": "smplx",
        **pose_arrays(pose),
        "trans": params.camera_translation.numpy(),
        "expressions": params.expression.numpy(),
    }


def read_fit(path: StrPath) -> StoredFit:
    """Read fit.npz, or the fit.npz of a result's folder.

    Raises:
        InputError: It is missing, damaged, or not a result of tcfit.
    """
    path = Path(path)
    file = path / FIT_NAME if path.is_dir() else path
    arrays = _read_arrays(file)
    try:
        return _stored(arrays)
    except KeyError as error:
        raise InputError(f"{file}: lacks {error}; expected a fit.npz of tcfit. Fit the clip again.") from error
    except (ValueError, TypeError) as error:
        raise InputError(f"{file}: is damaged ({error}). Fit the clip again.") from error


def _read_arrays(file: Path) -> dict[str, np.ndarray]:
    try:
        arrays = read_npz(file)
    except FileNotFoundError as error:
        raise InputError(f"{file}: does not exist; expected a result of tcfit fit. Name its --out folder.") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: is not a complete npz archive ({error}). Fit the clip again.") from error
    found = str(arrays.get("format", "an npz of another program"))
    if found != FORMAT:
        raise InputError(f"{file}: is {found!r}; expected {FORMAT!r}, which tcfit fit writes.")
    return arrays


def _stored(arrays: dict[str, np.ndarray]) -> StoredFit:
    frames, last_phase = len(arrays["poses"]), int(arrays["last_phase"])
    phase1 = _params(arrays, PHASE1, frames)
    shared = np.broadcast_to(_shaped(arrays, "betas", (N_BETAS,)), (frames, N_BETAS))
    betas = arrays[f"{PHASE1}betas"] if last_phase == 1 else shared
    return StoredFit(
        params=_params(arrays | {"betas": betas}, "", frames),
        phase1=phase1,
        joints=_shaped(arrays, "joints", (frames, N_JOINTS, 3)),
        observed=_shaped(arrays, "observed", (frames, N_JOINTS)).astype(bool),
        provenance=_provenance(arrays, frames),
        camera=_camera(arrays, frames),
        frame_rate=float(arrays["mocap_frame_rate"]),
        first_frame=int(arrays["first_frame"]),
        **{name: str(arrays[name]) for name in ("gender", "body_kind", "body_hash")},
        last_phase=last_phase,
        complete=bool(arrays["complete"]),
        error_bars=error_bars_from(arrays, frames),
        grounding=grounding_from(arrays, frames),
        size=size_from(arrays),
        keypoints=_keypoints(arrays, frames),
        detector=str(arrays.get("detector", "")),
        frame_cost=_known(arrays, "frame_cost", (frames,)),
        phase1_frame_cost=_known(arrays, f"{PHASE1}frame_cost", (frames,)),
        views=views_from(arrays),
    )


def _keypoints(arrays: dict[str, np.ndarray], frames: int) -> Keypoints | None:
    found = _known(arrays, "keypoints", (frames, COUNT, 3))
    return None if found is None else keypoints_from(found)


def _known(arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...]) -> np.ndarray | None:
    return _shaped(arrays, name, shape) if name in arrays else None


def _camera(arrays: dict[str, np.ndarray], frames: int) -> Camera:
    camera = camera_from(arrays)
    if camera.path is not None and len(camera.path) != frames:
        raise ValueError(f"its camera moves through {len(camera.path)} frames, expected {frames}")
    return camera


def _provenance(arrays: dict[str, np.ndarray], frames: int) -> Provenance | None:
    if "start" not in arrays:
        return None
    start, stopped = (_shaped(arrays, name, (frames,)).astype(np.uint8) for name in ("start", "stopped"))
    return Provenance(start, stopped)


def _params(arrays: dict[str, np.ndarray], prefix: str, frames: int) -> BodyParams:
    components = int(arrays[f"{prefix}{_HANDS[0]}"].shape[-1])
    widths = _WIDTHS | dict.fromkeys(_HANDS, components)
    return BodyParams(**{name: torch.tensor(_shaped(arrays, prefix + name, (frames, widths[name]))) for name in _NAMES})


def _shaped(arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...]) -> np.ndarray:
    array = arrays[name]
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}, expected {shape}")
    return array
