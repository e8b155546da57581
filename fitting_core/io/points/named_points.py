"""Named moving points, as in motion capture files."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.camera import World, matrix_of, vector_of
from fitting_core.errors import InputError

MOST_POINTS = 2000
"""Limit for a file."""
_ROTATION_ERROR = 1e-4
"""Allowed deviation of R R^T from the identity: C3D has 32-bit floats."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedPoints:
    """N points over T frames."""

    names: tuple[str, ...]
    places: Float[np.ndarray, "T N 3"]
    """Metres, in the file's own world; NaN where a point was not seen."""
    frame_rate: float
    """Frames per second."""
    first_frame: int | None = None
    """Number of the first frame at this rate, from 0; None: the file does not say."""
    camera: World | None = None
    """Pose of the clip's camera in the file's world; None if unknown or moving."""
    notes: tuple[str, ...] = ()
    """Notes for the user on how they were read."""

    def __post_init__(self) -> None:
        assert self.places.shape[1:] == (len(self.names), 3)

    def __len__(self) -> int:
        return len(self.places)


def without_subject(names: Sequence[str]) -> tuple[str, ...]:
    """LASI for Anna:LASI, if all names have the same subject before them."""
    subjects = {name.rpartition(":")[0] for name in names} - {""}
    return tuple(name.rpartition(":")[2] for name in names) if len(subjects) == 1 else tuple(names)


def check_names(path: object, names: tuple[str, ...]) -> None:
    """Raises InputError if two points have the same name."""
    if len(set(names)) < len(names):
        twice = next(name for i, name in enumerate(names) if name in names[:i])
        raise InputError(f"{path}: has two points {twice[:40]!r}; expected each name once. Rename one of them.")


def stated_camera(camera: World) -> list[float]:
    """A camera's pose as twelve numbers: R by rows, then t, metres."""
    return [float(value) for row in (*camera.rotation, camera.translation) for value in row]


def read_world(path: object, numbers: Sequence[float | str]) -> World | None:
    """The inverse of `stated_camera`; None for nothing. Raises InputError if these are no pose."""
    if not len(numbers):
        return None
    try:
        pose = np.array(numbers, float).reshape(4, 3)
        rotation = pose[:3]
        if not np.abs(rotation @ rotation.T - np.eye(3)).max() < _ROTATION_ERROR or np.linalg.det(rotation) < 0:
            raise ValueError("the first nine are not a rotation")
        return World(rotation=matrix_of(rotation), translation=vector_of(pose[3]))
    except ValueError as error:
        raise InputError(
            f"{path}: its camera pose is not a rotation and a position ({error!s:.80}); expected nine and "
            "three numbers, as tcfit wrote them. Export it again, or remove them."
        ) from error
