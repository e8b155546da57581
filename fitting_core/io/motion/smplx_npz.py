"""SMPL-X animations as npz: of AMASS (SMPL-X and SMPL-H), the Blender add-ons, and tcfit's own fit.npz and exports.

| key | shape | |
|---|---|---|
| poses | (N, 165) or (N, 156) | axis-angle of all joints of SMPL-X or SMPL-H, hands with their mean pose |
| root_orient, pose_body, pose_hand, pose_jaw, pose_eye | (N, 3), (N, 63), (N, 90), (N, 3), (N, 6) | instead of poses |
| trans | (N, 3) | |
| betas | (10 or more) or (N, 10 or more) | the first ten count |
| expressions | (N, 10) | optional |
| gender, mocap_frame_rate or mocap_framerate | () | |
| axes, camera_to_world, camera_place | (), (3, 3), (3,), or N of these two | tcfit's: the world of poses and trans. \
Without them, AMASS's: z up |
| camera_focal, camera_center, image_size, camera_focal_from, camera_source, first_frame, body_kind, body_hash | | \
tcfit's, optional |
"""

from collections.abc import Iterable
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from fitting_core.body.model import N_BETAS, N_EXPRESSION, N_JOINTS, POSE_COLUMNS
from fitting_core.camera import Camera, FocalFrom, are_rotations, focal_from_words
from fitting_core.errors import InputError, some_of
from fitting_core.files.npz import read_npz
from fitting_core.io.motion.animation_npz import POSE_KEYS
from fitting_core.io.motion.imported_motion import ImportedMotion, body_params
from fitting_core.motion import AXES
from fitting_core.results.fit_result import stopped_note

_ADVICE = "Expected an npz of AMASS, of the SMPL-X Blender add-on or of tcfit, with 'poses' and 'trans'"
_GIVEN = ("root_orient", "pose_body")
"""Required parts of a pose; the others are zero if absent."""


def _layout(parts: Iterable[str]) -> dict[str, slice]:
    """Consecutive columns of parameters."""
    widths = {name: POSE_COLUMNS[name].stop - POSE_COLUMNS[name].start for name in parts}
    return {
        name: slice(stop - widths[name], stop) for name, stop in zip(widths, accumulate(widths.values()), strict=True)
    }


_FACE = ("jaw_pose", "leye_pose", "reye_pose")
_LAYOUTS: dict[int, tuple[str, dict[str, slice]]] = {
    165: ("smplx", POSE_COLUMNS),
    156: ("smplh", _layout(name for name in POSE_COLUMNS if name not in _FACE)),
}
"""By the width of `poses`: the body's kind, and the columns of each parameter."""
_NAMES = {"smplx": "SMPL-X", "smplh": "SMPL-H"}
_GENDERS = {"neutral": "neutral", "male": "male", "female": "female", "child": "child", "unknown": "neutral"}
_MAX_ANGLE, _MAX_LENGTH = 1e3, 1e6
_KEYS = (
    "poses trans betas expressions gender surface_model_type mocap_frame_rate mocap_framerate axes camera_to_world "
    "camera_place "
    "camera_focal camera_center image_size camera_focal_from camera_source first_frame body_kind body_hash complete "
    "last_phase"
).split()


def read_smplx_npz(path: Path) -> ImportedMotion:
    """Read an animation. Raises InputError if it is damaged, invalid, or not an SMPL-X or SMPL-H animation."""
    try:
        arrays = read_npz(path, (*_KEYS, *POSE_KEYS))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}). {_ADVICE}.") from error
    except ValueError as error:
        raise InputError(f"{path}: {error}. {_ADVICE}.") from error
    try:
        return _motion(path, arrays)
    except _Wrong as error:
        raise InputError(f"{path}: {error}. {_ADVICE}.") from error


class _Wrong(ValueError):
    """What is wrong, in words."""


def _motion(path: Path, arrays: dict[str, np.ndarray]) -> ImportedMotion:
    poses = _poses(arrays)
    if poses.shape[1] not in _LAYOUTS:
        smpl = " (SMPL's 24 joints: it has no hands)" if poses.shape[1] == 72 else ""
        raise _Wrong(f"'poses' has {poses.shape[1]} columns{smpl}, expected 165 (SMPL-X) or 156 (SMPL-H)")
    kind, columns = _LAYOUTS[poses.shape[1]]
    frames = len(poses)
    turn, placed = _turn_into_camera(arrays, frames)
    trans = _numbers(arrays, "trans", (frames, 3), _MAX_LENGTH) - _camera_place(arrays, frames)
    betas, notes = _betas(arrays, frames)
    found = {name: poses[:, part] for name, part in columns.items()}
    found |= {"betas": betas, "camera_translation": (turn @ trans[..., None])[..., 0]}
    if "expressions" in arrays:
        found["expression"] = _numbers(arrays, "expressions", (frames, N_EXPRESSION), _MAX_LENGTH)
    first = _first_frame(arrays)
    own = "camera_focal" in arrays
    return ImportedMotion(
        source=path,
        format=f"tcfit {_NAMES[kind]} npz" if own else f"{_NAMES[kind]} npz",
        kind=_text(arrays, "body_kind", kind),
        gender=_gender(arrays),
        body_hash=_text(arrays, "body_hash", ""),
        params=body_params(found, 45),
        whole_hands=True,
        turn=torch.as_tensor(turn).expand(frames, 3, 3),
        placed=placed,
        numbers=tuple(range(first or 0, (first or 0) + frames)),
        numbered=first is not None,
        frame_rate=_frame_rate(arrays),
        camera=_camera(arrays),
        notes=(*notes, *_stopped(arrays)),
    )


def _stopped(arrays: dict[str, np.ndarray]) -> tuple[str, ...]:
    """A note on a fit of tcfit that did not go through."""
    if "complete" not in arrays or "last_phase" not in arrays or arrays["complete"].all():
        return ()
    return (stopped_note(int(_numbers(arrays, "last_phase", (), 3))),)


def _poses(arrays: dict[str, np.ndarray]) -> Float[np.ndarray, "N J"]:
    """All joints in one array, concatenated in SMPL-X's order if given in parts."""
    if "poses" in arrays:
        shape = arrays["poses"].shape
        if len(shape) != 2:
            joints = {3 * N_JOINTS: "55", 156: "52"}.get(int(np.prod(shape[1:])), "")
            flat = f"; flatten the {joints} joints of each frame" if joints else ""
            raise _Wrong(
                f"'poses' has the shape {shape}, expected ({shape[0] if shape else 'frames'}, {3 * N_JOINTS}), or 156 "
                f"columns for SMPL-H{flat}"
            )
        return _numbers(arrays, "poses", (shape[0], None), _MAX_ANGLE)
    if missing := [name for name in (*_GIVEN, "trans") if name not in arrays]:
        has = some_of(sorted(arrays))
        raise _Wrong(f"has neither 'poses' nor {', '.join(map(repr, missing))} (it has {has})")
    frames = len(arrays["trans"]) if arrays["trans"].ndim else 0
    poses = np.zeros((frames, 3 * N_JOINTS))
    for name, part in POSE_KEYS.items():
        if name in arrays:
            poses[:, part] = _numbers(arrays, name, (frames, part.stop - part.start), _MAX_ANGLE)
    return poses


def _numbers(arrays: dict[str, np.ndarray], name: str, shape: tuple[int | None, ...], most: float) -> np.ndarray:
    if name not in arrays:
        raise _Wrong(f"has no '{name}' (it has {some_of(sorted(arrays))})")
    array = arrays[name]
    if array.dtype.kind not in "fiu":
        raise _Wrong(f"'{name}' holds {array.dtype} values, expected numbers")
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        expected = ", ".join("any number" if n is None else str(n) for n in shape)
        raise _Wrong(f"'{name}' has the shape {array.shape}, expected ({expected})")
    if array.size == 0:
        raise _Wrong(f"'{name}' is empty: there is no frame")
    array = array.astype(np.float64)
    if not (np.abs(array) <= most).all():
        bad = array[~(np.abs(array) <= most)][0]
        raise _Wrong(f"'{name}' holds {bad:g}, expected finite numbers up to {most:g}")
    return array


def _betas(arrays: dict[str, np.ndarray], frames: int) -> tuple[Float[np.ndarray, "N 10"], tuple[str, ...]]:
    array = arrays.get("betas")
    if array is None:
        return np.zeros((frames, N_BETAS)), ("It has no shape: the mean shape is shown.",)
    betas = _numbers(arrays, "betas", (None,) * array.ndim, _MAX_LENGTH)
    betas = betas[None] if betas.ndim == 1 else betas
    if betas.ndim != 2 or len(betas) not in (1, frames) or betas.shape[1] < N_BETAS:
        raise _Wrong(f"'betas' has the shape {array.shape}, expected {N_BETAS} or more, for all frames or for each")
    more = np.abs(betas[:, N_BETAS:]).max(initial=0)
    notes = (f"Of its {betas.shape[1]} shape parameters the first {N_BETAS} are used.",) if more > 0 else ()
    return np.broadcast_to(betas[:, :N_BETAS], (frames, N_BETAS)), notes


def _turn_into_camera(arrays: dict[str, np.ndarray], frames: int) -> tuple[Float[np.ndarray, "*T 3 3"], bool]:
    """Rotation from an animation's world to camera space, per frame if the camera moves; and whether there is one."""
    if "camera_to_world" in arrays:
        matrices = _once_or_by_frame(arrays, "camera_to_world", frames, (3, 3), 2.0)
        if not are_rotations(matrices).all():
            raise _Wrong("'camera_to_world' is not a rotation")
        return matrices.swapaxes(-1, -2), True
    # fit.npz is in camera space and has no matrix to say so.
    if _text(arrays, "axes", "").lower().startswith("camera"):
        return np.eye(3), True
    return np.array(AXES["z-up"].from_camera, float).T, False


def _camera_place(arrays: dict[str, np.ndarray], frames: int) -> Float[np.ndarray, "*T 3"]:
    """Where the camera is in the file's world, metres."""
    if "camera_place" not in arrays:
        return np.zeros(3)
    return _once_or_by_frame(arrays, "camera_place", frames, (3,), _MAX_LENGTH)


def _once_or_by_frame(
    arrays: dict[str, np.ndarray], name: str, frames: int, shape: tuple[int, ...], most: float
) -> np.ndarray:
    by_frame = arrays[name].ndim > len(shape)
    return _numbers(arrays, name, (frames, *shape) if by_frame else shape, most)


def _frame_rate(arrays: dict[str, np.ndarray]) -> float | None:
    for name in ("mocap_frame_rate", "mocap_framerate"):
        if name in arrays and arrays[name].size == 1 and arrays[name].dtype.kind in "fiu":
            rate = float(arrays[name].reshape(()))
            if not 0 < rate <= 2000:
                raise _Wrong(f"'{name}' is {rate:g}, expected frames per second, above 0 and up to 2000")
            return rate
    return None


def _first_frame(arrays: dict[str, np.ndarray]) -> int | None:
    if "first_frame" not in arrays:
        return None
    first = _numbers(arrays, "first_frame", (), 1e12)
    if first < 0 or first != int(first):
        raise _Wrong(f"'first_frame' is {float(first):g}, expected a whole number from 0")
    return int(first)


def _gender(arrays: dict[str, np.ndarray]) -> str:
    word = _text(arrays, "gender", "neutral").strip().lower()
    if word not in _GENDERS:
        raise _Wrong(f"'gender' is {word!r:.20}, expected neutral, male, female or child")
    return _GENDERS[word]


def _text(arrays: dict[str, np.ndarray], name: str, default: str) -> str:
    """A text, which Python 2 wrote as bytes."""
    array = arrays.get(name)
    if array is None or array.size != 1:
        return default
    value: Any = array.reshape(())[()]
    return value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)


def _camera(arrays: dict[str, np.ndarray]) -> Camera | None:
    names = ("camera_focal", "camera_center", "image_size")
    if not all(name in arrays for name in names):
        return None
    (fx, fy), (cx, cy), (width, height) = (_numbers(arrays, name, (2,), _MAX_LENGTH).tolist() for name in names)
    if not (min(fx, fy) > 0 and min(width, height) >= 1):
        raise _Wrong(f"the camera has a focal length of {fx:g} x {fy:g} and an image of {width:g} x {height:g} pixels")
    source = _text(arrays, "camera_source", "told by the file")
    stated = _text(arrays, "camera_focal_from", focal_from_words(source))
    focal_from = next((one for one in FocalFrom if one == stated), FocalFrom.PROGRAM)
    return Camera(focal=(fx, fy), center=(cx, cy), size=(int(width), int(height)), focal_from=focal_from, source=source)
