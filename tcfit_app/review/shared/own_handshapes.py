"""The user's own handshapes, for all projects: a file in the user's data folder."""

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
import platformdirs
from jaxtyping import Float

from fitting_core.body.handshapes import HANDSHAPES
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file

_MOST_BYTES = 2**20
_MOST_SHAPES = 200
LONGEST = 30
"""Characters of a name."""
_Angle = Annotated[float, msgspec.Meta(ge=-7.0, le=7.0)]
_Hand = Annotated[list[tuple[_Angle, _Angle, _Angle]], msgspec.Meta(min_length=15, max_length=15)]
_Name = Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST, pattern=r"^\S(.*\S)?$")]


class _Stored(msgspec.Struct, forbid_unknown_fields=True):
    format: Literal["tcfit handshapes 1"] = "tcfit handshapes 1"
    shapes: Annotated[dict[_Name, _Hand], msgspec.Meta(max_length=_MOST_SHAPES)] = msgspec.field(default_factory=dict)
    """Axis-angle in radians of a left hand's 15 finger joints in SMPL-X's order, by name."""


def own_handshapes_file() -> Path:
    """Where they are; it may not exist yet."""
    return platformdirs.user_data_path("tcfit", appauthor=False) / "handshapes.json"


def own_handshapes() -> dict[str, Float[np.ndarray, "15 3"]]:
    """By name, as angles of a left hand.

    Raises:
        InputError: The file cannot be read, or is not such a file.
    """
    path = own_handshapes_file()
    try:
        known = path.stat()
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise _unreadable(path, error) from error
    return {name: np.array(hand) for name, hand in _read(path, known.st_mtime_ns, known.st_size).shapes.items()}


def keep_handshape(name: str, angles: Float[np.ndarray, "15 3"] | None) -> None:
    """Add a shape of a left hand, or replace the one of this name; None deletes it.

    Raises:
        InputError: The name cannot be used, there is no such shape to delete, there are too many, or the file cannot be
            read or written, which leaves it as it is.
    """
    path, shapes = own_handshapes_file(), own_handshapes()
    if angles is None:
        if name not in shapes:
            raise InputError(f"There is no shape of yours named {name!r}.")
        del shapes[name]
    else:
        if name in HANDSHAPES:
            raise InputError(f"{name!r} is one of tcfit's shapes. Choose another name.")
        shapes[name] = angles
    stored = {each: np.round(hand, 5).tolist() for each, hand in shapes.items()}
    try:
        content = msgspec.convert({"format": _Stored().format, "shapes": stored}, _Stored)
    except msgspec.ValidationError as error:
        raise InputError(
            f"{name!r} cannot be kept: a name has 1 to {LONGEST} characters, without spaces around them, and there are "
            f"at most {_MOST_SHAPES} shapes ({error})."
        ) from error
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as draft:
            draft.write_bytes(msgspec.json.format(msgspec.json.encode(content)))
    except OSError as error:
        raise InputError(f"{path}: your handshapes cannot be written ({error}). Nothing was changed.") from error


@lru_cache(maxsize=1)  # a panel asks each time it is drawn
def _read(path: Path, changed: int, size: int) -> _Stored:
    try:
        return msgspec.json.decode(regular_file(path, most=_MOST_BYTES).read_bytes(), type=_Stored)
    except (OSError, InputError, msgspec.MsgspecError) as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError(
        f"{path}: your handshapes cannot be read ({error}). Mend the file, or move it away to begin a new one; until "
        "then none is saved."
    )
