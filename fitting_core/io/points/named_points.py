"""Points with names that move: what files of motion capture hold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError

MOST_POINTS = 2000
"""That a file may have."""


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
    notes: tuple[str, ...] = ()
    """What a user should know of how they were read."""

    def __post_init__(self) -> None:
        assert self.places.shape[1:] == (len(self.names), 3)

    def __len__(self) -> int:
        return len(self.places)


def without_subject(names: Sequence[str]) -> tuple[str, ...]:
    """LASI for Anna:LASI, where all names that have a subject before them have the same."""
    subjects = {name.rpartition(":")[0] for name in names} - {""}
    return tuple(name.rpartition(":")[2] for name in names) if len(subjects) == 1 else tuple(names)


def check_names(path: object, names: tuple[str, ...]) -> None:
    """Raises InputError if two points have the same name."""
    if len(set(names)) < len(names):
        twice = next(name for i, name in enumerate(names) if name in names[:i])
        raise InputError(f"{path}: has two points {twice[:40]!r}; expected each name once. Rename one of them.")
