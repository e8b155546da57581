"""A person in a learned system's file: frames, poses and positions in camera space, from checked arrays."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int

from fitting_core.body import rotations
from fitting_core.body.model import N_BETAS
from fitting_core.camera import Camera, FocalFrom
from fitting_core.errors import InputError, some_of
from fitting_core.files.pickles import as_array
from fitting_core.files.torch_pickles import plain

BODY = 22
"""Joints of a body without hands and face: the root and 21 others. SMPL's two hand joints are left out."""
SMPL_JOINTS = 24
_MAX_VALUE, _MAX_FRAME, _MAX_FRAMES = 1e6, 10**9, 10**6
_ORTHONORMAL = 1e-2
"""Allowed deviation from a rotation for a network's matrix, in half precision at worst."""
Focal = tuple[Callable[[tuple[int, int]], float], str]


@dataclass(frozen=True, kw_only=True, eq=False)
class SystemMotion:
    """One person. Angles in radians, lengths in metres, camera space: x right, y down, z away."""

    pose: Float[np.ndarray, "T 66"]
    """Axis-angle of the root and of 21 joints."""
    more: Mapping[str, Float[np.ndarray, "T n"]] = field(default_factory=dict)
    """Hands relative to their mean, jaw and expression, by their names in BodyParams; missing ones are zero."""
    points: Float[np.ndarray, "T 137 3"] | None = None
    """Keypoints in camera space, NaN where missing, instead of a pose, shape and translation, which are then zero."""
    betas: Float[np.ndarray, "T 10"]
    translation: Float[np.ndarray, "T 3"]
    numbers: Int[np.ndarray, "T"] | None = None
    """Of the frames in the video; None: not stated."""
    stems: tuple[str, ...] = ()
    kind: str = "smpl"
    flat_hands: bool = False
    """Whether hands are flat instead of the body's mean."""
    camera: Camera | None = None
    focal: Focal | None = None
    """If no camera is stated: the focal length in pixels by image size, and its description."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class System:
    """How a learned system's files are recognised and read."""

    title: str
    holds: Callable[[Any], bool]
    """Whether a file's content is of this system."""
    people: Callable[[Any], Mapping[int, Sequence[int]]]
    """For all people by number: their frames."""
    track: Callable[[Any, int], SystemMotion]
    """One of them."""


def is_mapping_with(content: object, *keys: str) -> bool:
    """Whether it is a dictionary with one of these keys."""
    return isinstance(content, dict) and any(key in content for key in keys)


def as_mapping(content: object, what: str) -> dict[Any, Any]:
    """The content, if it is a dictionary. Raises InputError if it is not."""
    if not isinstance(content, dict):
        raise InputError(f"{what} is a {type(content).__name__}, expected a dictionary")
    return content


def rows(values: object, key: str, width: int, frames: int | None = None) -> Float[np.ndarray, "T width"]:
    """An array of numbers for each frame. Raises InputError if it is missing, of another shape, or not of finite
    numbers.

    Args:
        values: A dictionary.
        key: In it.
        width: Numbers per frame, in any shape.
        frames: Expected count; None: any.
    """
    array = _numbers(values, key)
    if array.ndim == 0 or not len(array) or array.size != len(array) * width or frames not in (None, len(array)):
        raise InputError(f"'{key}' has the shape {array.shape}, expected ({frames or 'frames'}, {width})")
    return finite(array.reshape(len(array), width), key)


def flat(values: object, key: str, count: int) -> Float[np.ndarray, "count"]:
    """Numbers of the given count in any shape. Raises InputError as `rows` does."""
    array = _numbers(values, key)
    if array.size != count:
        raise InputError(f"'{key}' has the shape {array.shape}, expected {count} numbers")
    return finite(array.reshape(count), key)


def _numbers(values: object, key: str) -> np.ndarray:
    if key not in (found := as_mapping(values, f"what holds '{key}'")):
        raise InputError(f"has no '{key}' (it has {some_of(map(plain, found))})")
    try:
        array = as_array(found[key])
    except InputError as error:
        raise InputError(f"'{key}' is {error}") from error
    if array.dtype.kind not in "fiu":
        raise InputError(f"'{key}' holds {array.dtype} values, expected numbers")
    return array


def finite(array: np.ndarray, key: str) -> np.ndarray:
    """The same in float64. Raises InputError if some numbers are not finite or implausibly large."""
    with np.errstate(invalid="ignore"):  # of the NaNs that warn when they are cast
        array = array.astype(np.float64)
    good = np.abs(array) <= _MAX_VALUE
    if not good.all():
        raise InputError(f"'{key}' holds {array[~good][0]:g}, expected finite numbers up to {_MAX_VALUE:g}")
    return array


def shape_numbers(values: object, key: str, frames: int) -> Float[np.ndarray, "T 10"]:
    """The first ten shape parameters of each frame, given for each or for all. Raises InputError as `rows` does."""
    array = _numbers(values, key)
    width = array.shape[-1] if array.ndim else 0
    if not N_BETAS <= width <= 300 or array.size not in (width, frames * width):
        raise InputError(f"'{key}' has the shape {array.shape}, expected {frames} x {N_BETAS} or more")
    found = finite(array.reshape(-1, width)[:, :N_BETAS], key)
    return np.broadcast_to(found, (frames, N_BETAS)).copy()


def stated_frames(values: object, key: str) -> Int[np.ndarray, "T"]:
    """Frame numbers, without repetitions. Raises InputError if they are not."""
    array = _numbers(values, key).reshape(-1)
    whole = finite(array, key).astype(np.int64)
    if not len(whole) or len(whole) > _MAX_FRAMES or (whole != array).any() or whole.min() < 0:
        raise InputError(f"'{key}' does not hold frame numbers, expected a whole number from 0 for each frame")
    if len(set(whole.tolist())) < len(whole):
        raise InputError(f"'{key}' has a frame twice, expected those of one clip")
    return whole


def by_person(people: object) -> dict[int, Any]:
    """A dictionary's entries by the numbers of people. Raises InputError if its keys are not."""
    found = {plain(key): values for key, values in as_mapping(people, "what holds the people").items()}
    if not all(type(key) is int for key in found):
        raise InputError("has people without numbers, expected a number for each")
    return found


def people_by(people: object, key: str) -> dict[int, list[int]]:
    """For each person in a dictionary, the frames under one of their keys. Raises InputError if they are missing."""
    return {number: stated_frames(values, key).tolist() for number, values in by_person(people).items()}


def first_of(content: object) -> object:
    """The first value of a dictionary, None if it is empty."""
    return next(iter(content.values()), None) if isinstance(content, dict) else None


def axis_angles(matrices: Float[np.ndarray, "T n"], key: str) -> Float[np.ndarray, "T m"]:
    """Axis-angle of flattened row-major rotation matrices. Raises InputError if they are not rotations."""
    turns = torch.as_tensor(matrices).reshape(len(matrices), -1, 3, 3)
    off = (turns @ turns.mT - torch.eye(3, dtype=turns.dtype)).abs().amax()
    if float(off) > _ORTHONORMAL or float(torch.linalg.det(turns).amin()) < 0:
        raise InputError(f"'{key}' holds matrices that are not rotations")
    return rotations.log(turns).reshape(len(matrices), -1).numpy()


def body_angles(smpl_pose: Float[np.ndarray, "T 72"]) -> Float[np.ndarray, "T 66"]:
    """SMPL's pose without its two hand joints."""
    return smpl_pose[:, : 3 * BODY]


def centred(focal: float, center: Sequence[float], source: str) -> Camera:
    """A camera with the principal point in the middle of its image, which determines the image's size. Raises
    InputError if it is not a valid camera."""
    size = (round(2 * center[0]), round(2 * center[1]))
    if not (focal > 0 and min(size) >= 1 and max(size) <= 10**5):
        raise InputError(f"has a focal length of {focal:g} pixels and a principal point at {list(center)}")
    middle = (center[0], center[1])
    return Camera(focal=(focal, focal), center=middle, size=size, focal_from=FocalFrom.PROGRAM, source=source)


def positive(numbers: np.ndarray, key: str) -> np.ndarray:
    """The same. Raises InputError if some are not above 0."""
    if not (numbers > 0).all():
        raise InputError(f"'{key}' holds {numbers.min():g}, expected numbers above 0")
    return numbers
