"""One result of SMPLify-X, a pickle: read through the restricted unpickler and checked, and written."""

import io
import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fitting_core.body.model import N_BETAS, N_EXPRESSION
from fitting_core.errors import InputError, some_of
from fitting_core.files.archives import Member
from fitting_core.files.pickles import as_array, read_pickle

LATENT, BODY = 32, 63
"""Lengths of a body_pose: VPoser's numbers, or axis-angle of 21 joints."""
WIDTHS: dict[str, tuple[int, ...]] = {
    "global_orient": (3,),
    "jaw_pose": (3,),
    "leye_pose": (3,),
    "reye_pose": (3,),
    "left_hand_pose": tuple(range(1, 46)),
    "right_hand_pose": tuple(range(1, 46)),
    "body_pose": (LATENT, BODY),
    "betas": tuple(range(N_BETAS, 301)),
    "expression": tuple(range(N_EXPRESSION, 101)),
    "camera_translation": (3,),
}
"""Allowed lengths of each key."""
CAMERA = ("camera_focal", "camera_center", "image_size")
_MAX_BYTES = 16 * 2**20
"""Limit for one pickle; SMPLify-X's have 3 kB."""
_MAX_VALUE = 1e6


@dataclass(frozen=True, kw_only=True, eq=False)
class ResultFrame:
    """One person in one frame."""

    stem: str
    """Name of the folder around the pickle, which is the image's stem."""
    values: dict[str, Float[np.ndarray, "n"]]
    """By key, flat."""
    rotation: Float[np.ndarray, "3 3"]
    """From the body's space into that of the camera."""


def read_result(path: Path, member: Member) -> ResultFrame:
    """Read a pickle. Raises InputError if it is damaged, refers to code, lacks a key, or has invalid values.

    Args:
        path: What the user gave, for messages.
        member: The pickle: the path itself, or inside it.
    """
    itself = path.is_file() and member.path.name == path.name
    where = path if itself else path / member.path.relative_to(member.path.parts[0])
    if member.size > _MAX_BYTES:
        raise InputError(f"{where}: has {member.size / 2**20:.0f} MB; expected a result of SMPLify-X, some kilobytes.")
    try:
        with member.open() as stream:
            content = read_pickle(io.BytesIO(stream.read(_MAX_BYTES)))
        values = {key: _values(content, key, widths) for key, widths in WIDTHS.items()}
        values |= {key: _values(content, key, (2,)) for key in CAMERA if key in content}
        if "transl" in content:
            values["transl"] = _values(content, "transl", (3,))
        rotation = _rotation(content)
    except InputError as error:
        raise InputError(f"{where}: {error}. Expected a result of SMPLify-X; write it again.") from error
    return ResultFrame(stem=member.path.parent.name, values=values, rotation=rotation)


def _values(content: dict[str, Any], key: str, widths: tuple[int, ...]) -> Float[np.ndarray, "n"]:
    if key not in content:
        raise InputError(f"has no '{key}' (it has {some_of(content)})")
    try:
        array = as_array(content[key])
    except InputError as error:
        raise InputError(f"'{key}' is {error}") from error
    if array.dtype.kind not in "fiu" or array.size not in widths or array.ndim > 3:
        expected = " or ".join(map(str, widths)) if len(widths) < 4 else f"{widths[0]} to {widths[-1]}"
        raise InputError(f"'{key}' has the shape {array.shape} of {array.dtype}, expected {expected} numbers")
    flat = array.reshape(-1).astype(np.float64)
    if not (np.abs(flat) <= _MAX_VALUE).all():
        bad = flat[~(np.abs(flat) <= _MAX_VALUE)][0]
        raise InputError(f"'{key}' holds {bad:g}, expected finite numbers up to {_MAX_VALUE:g}")
    return flat


def _rotation(content: dict[str, Any]) -> Float[np.ndarray, "3 3"]:
    if "camera_rotation" not in content:
        return np.eye(3)
    matrix = _values(content, "camera_rotation", (9,)).reshape(3, 3)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-3 or np.linalg.det(matrix) < 0:
        raise InputError("'camera_rotation' is not a rotation matrix")
    return matrix


def pickled(arrays: dict[str, np.ndarray]) -> bytes:
    """Arrays as the pickle of a dictionary, in float32."""
    content = pickle.dumps({name: array.astype(np.float32) for name, array in arrays.items()}, protocol=2)
    # numpy 2 names a module that numpy 1 lacks; both know the old name. Protocol 2 ends names with a newline.
    return content.replace(b"cnumpy._core.multiarray\n", b"cnumpy.core.multiarray\n")
