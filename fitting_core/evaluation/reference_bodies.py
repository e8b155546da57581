"""References that are poses of a body model: a truth of a generated clip, a fit, AMASS-style npz."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from fitting_core.body.files import load_body
from fitting_core.body.model import N_BETAS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.positions import joints_in_space, keypoints_in_space
from fitting_core.body.registry import FREE_FOLDER, find_body, list_bodies
from fitting_core.errors import InputError
from fitting_core.evaluation.reference import BodyOf, Reference, of_body, stated_first_frame, stated_rate
from fitting_core.evaluation.truth import read_truth
from fitting_core.evaluation.world_camera import WorldCamera, in_camera
from fitting_core.io.result_files import read_fit
from fitting_core.io.smplx_npz import turn_into_camera

_WIDTHS = {156: "smplh", 165: "smplx"}
"""Kind of body by the number of angles."""
_RATES = ("mocap_frame_rate", "mocap_framerate")


def body_of(record: BodyOf, *, search: Path | None = None) -> BodyModel:
    """The body model of a reference.

    Args:
        record: Which one.
        search: A model file or a folder that alone is searched; None: `registry.search_folders`, and the free bodies.

    Raises:
        InputError: It is not there; the message says which file goes where.
    """
    if not record.hash:
        return load_body(find_body(model=record.kind, gender=record.gender, search=search))
    for path in (*_candidates(search, record), *_candidates(FREE_FOLDER, record)):
        if hashlib.sha256(path.read_bytes()).hexdigest() == record.hash:
            return load_body(path)
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
    """The truth of a generated clip.

    Raises:
        InputError: It is damaged, or its body is not there.
    """
    truth = read_truth(path)
    body = body_of(BodyOf(kind="smplx", gender="neutral", hash=truth.body_hash), search=search)
    rate = truth.frame_rate
    return reference_of(path.name, "truth of a generated clip", body, truth.params, frame_rate=rate, in_camera=True)


def read_other_fit(path: Path, *, search: Path | None) -> Reference:
    """Another fit's result.

    Raises:
        InputError: It is damaged, or its body is not there.
    """
    fit = read_fit(path)
    body = body_of(BodyOf(kind=fit.body_kind, gender=fit.gender, hash=fit.body_hash), search=search)
    name = f"{path.parent.name}/{path.name}"
    found = reference_of(name, "another fit", body, fit.params, frame_rate=fit.frame_rate, in_camera=True)
    return replace(found, first_frame=fit.first_frame)


def read_amass(path: Path, arrays: dict[str, np.ndarray], camera: WorldCamera | None, search: Path | None) -> Reference:
    """AMASS's form: `poses` (T, 156) or (T, 165) with whole hands, `trans`, `betas`, `gender`, a frame rate.

    What tcfit exports says how its world is turned from the camera's space, so it needs no camera.

    Raises:
        InputError: It does not hold these, or there is no model of its kind and gender.
        ValueError: It says that its world is turned by what is no rotation.
    """
    poses, trans, betas = (np.asarray(arrays[name], np.float64) for name in ("poses", "trans", "betas"))
    frames, width = poses.shape if poses.ndim == 2 else (0, 0)
    if width not in _WIDTHS or trans.shape != (frames, 3) or betas.size < N_BETAS or not frames:
        raise InputError(
            f"{path}: has poses {poses.shape}, trans {trans.shape} and betas {betas.shape}; expected (frames, 165) for "
            f"SMPL-X or (frames, 156) for SMPL-H, (frames, 3), and at least {N_BETAS} betas."
        )
    if not all(np.isfinite(array).all() for array in (poses, trans, betas)):
        raise InputError(f"{path}: has numbers in poses, trans or betas that are not finite; expected a whole motion.")
    rate = stated_rate(path, arrays, _RATES)
    body = _amass_body(path, arrays, _WIDTHS[width], search)
    params = _amass_params(body, poses, trans, betas, arrays.get("expressions"))
    turn, placed = turn_into_camera(arrays)
    if camera is None and placed:
        camera = WorldCamera(rotation=turn, translation=np.zeros(3))
    if camera is not None:
        rest = body.joint_regressor @ (body.template + body.shape_directions @ betas.reshape(-1)[:N_BETAS])
        params = in_camera(params, rest[0], camera.rotation, camera.translation)
    kind = f"AMASS-style npz of {body.kind.upper()}"
    found = reference_of(path.name, kind, body, params, frame_rate=rate, in_camera=camera is not None)
    first = stated_first_frame(path, arrays)
    return replace(found, first_frame=first or 0, first_frame_known=first is not None)


def _amass_body(path: Path, arrays: dict[str, np.ndarray], kind: str, search: Path | None) -> BodyModel:
    gender = _text(arrays.get("gender", "neutral"))
    if "body_hash" in arrays:
        return body_of(BodyOf(kind=kind, gender=gender, hash=_text(arrays["body_hash"])), search=search)
    file = find_body(model=kind, gender=gender, search=search)
    if FREE_FOLDER in file.parents:
        raise InputError(
            f"{path}: needs the official {gender} {kind.upper()} model, for its betas mean another shape on the free "
            "body. Get it from its official site and run `tcfit models add` with it."
        )
    return load_body(file)


def _amass_params(
    body: BodyModel, poses: np.ndarray, trans: np.ndarray, betas: np.ndarray, expressions: np.ndarray | None
) -> BodyParams:
    frames = len(poses)
    face = poses[:, 66:75] if poses.shape[1] == 165 else np.zeros((frames, 9))
    hands = poses[:, -90:].reshape(frames, 2, 45) - body.hand_mean
    expression = np.zeros((frames, 10))
    if expressions is not None and expressions.ndim == 2 and len(expressions) == frames:
        count = min(10, expressions.shape[1])
        expression[:, :count] = expressions[:, :count]
    arrays = dict(
        betas=np.tile(betas.reshape(-1)[:N_BETAS], (frames, 1)),
        global_orient=poses[:, :3],
        body_pose=poses[:, 3:66],
        left_hand_pose=hands[:, 0],
        right_hand_pose=hands[:, 1],
        jaw_pose=face[:, :3],
        leye_pose=face[:, 3:6],
        reye_pose=face[:, 6:9],
        expression=expression,
        camera_translation=trans,
    )
    return BodyParams(**{name: torch.as_tensor(np.ascontiguousarray(array)) for name, array in arrays.items()})


def _text(value: object) -> str:
    """Old AMASS files hold bytes."""
    plain = np.asarray(value).reshape(-1)[0]
    return plain.decode() if isinstance(plain, bytes) else str(plain)
