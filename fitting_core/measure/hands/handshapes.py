"""Which named handshape a hand is nearest to, and how near: by the directions of its finger bones."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from jaxtyping import Float

from fitting_core.body.geometry import unit
from fitting_core.body.handshapes import HANDSHAPES, Handshape, finger_angles
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.errors import InputError
from fitting_core.files.regular import parsed_toml, regular_file
from fitting_core.keypoints import GROUPS, Side

FARTHEST = 30.0
"""Degrees: a hand that is farther from all of the set has none of its shapes. Shapes of the set are 10 to 32 degrees
from their nearest one, and fits to noisy detections put fists 24 degrees from a fist: nearer limits refuse these."""
_WRIST, _KNUCKLES = 0, (5, 9, 13, 17)
_BONES = [(4 * f + k, 4 * f + k + 1) for f in range(5) for k in (1, 2, 3)]
_MOST_BYTES = 2**20


@dataclass(frozen=True, kw_only=True)
class Nearest:
    """The named handshape that a hand is nearest to."""

    name: str
    degrees: float
    """Mean angle between the hand's finger bones and those of the named shape."""

    @property
    def near(self) -> bool:
        """Near enough to be called so."""
        return self.degrees <= FARTHEST


def finger_bones(points: Float[np.ndarray, "T 137 3"], side: Side) -> Float[np.ndarray, "T 15 3"]:
    """Directions of the three bones of thumb, index, middle, ring and little finger, seen from the palm.

    The axes are those of a left hand: x from the wrist to the knuckles, y out of the back, z to the thumb's side; right
    hands are mirrored.

    Args:
        points: Keypoints in any space, metres; NaN where the body has none.
        side: Of the hand.
    """
    hand = points[:, GROUPS[f"{side}_hand"]]
    knuckles = hand[:, list(_KNUCKLES)]
    along = unit(knuckles.mean(1) - hand[:, _WRIST])
    across = knuckles[:, 0] - knuckles[:, -1]
    across = unit(across - (across * along).sum(1, keepdims=True) * along)
    back = np.cross(across, along) * (1.0 if side == "left" else -1.0)
    axes = np.stack([along, back, across], 1)
    a, b = zip(*_BONES, strict=True)
    return np.einsum("tad,tbd->tba", axes, unit(hand[:, list(b)] - hand[:, list(a)]))


def degrees_between(one: Float[np.ndarray, "*n 15 3"], other: Float[np.ndarray, "*n 15 3"]) -> Float[np.ndarray, "*n"]:
    """Mean angle of two hands' finger bones, degrees."""
    cosine = np.clip((one * other).sum(-1), -1.0, 1.0)
    return np.degrees(np.arccos(cosine)).mean(-1)


class HandshapeSet:
    """Named handshapes, posed on one body.

    Args:
        body: Whose fingers they are: SMPL-X's, or another with hands.
        shapes: By name.
    """

    def __init__(self, body: BodyModel, shapes: Mapping[str, Handshape] = HANDSHAPES) -> None:
        self.names = tuple(shapes)
        self.bones = _posed(body, tuple(shapes.items()))

    def nearest(self, bones: Float[np.ndarray, "T 15 3"]) -> Nearest | None:
        """The nearest to the mean of some frames of `finger_bones`; None if nothing is known of the fingers."""
        known = bones[np.isfinite(bones).all((1, 2))]
        if not len(known):
            return None
        degrees = degrees_between(unit(known.mean(0)), self.bones)
        best = int(degrees.argmin())
        return Nearest(name=self.names[best], degrees=float(degrees[best]))


@lru_cache(maxsize=4)
def _posed(body: BodyModel, shapes: tuple[tuple[str, Handshape], ...]) -> Float[np.ndarray, "N 15 3"]:
    hand = np.stack([finger_angles(shape, "left").reshape(45) for _, shape in shapes]) - body.hand_mean[0]
    neutral = BodyParams.neutral(len(shapes), hand_components=45)
    points, exists = keypoints_in_space(body, replace(neutral, left_hand_pose=torch.as_tensor(hand)))
    return finger_bones(np.where(exists[:, None], points, np.nan), "left")


# --- the user's own ---


class _Written(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """A handshape in a file: another one, and what is different. See `Handshape`."""

    like: str
    index: tuple[float, float, float] | None = None
    middle: tuple[float, float, float] | None = None
    ring: tuple[float, float, float] | None = None
    pinky: tuple[float, float, float] | None = None
    spread: float | None = None
    thumb_like: str | None = None


def read_handshapes(path: Path) -> dict[str, Handshape]:
    """The user's own set of named handshapes. Raises InputError if it cannot be read, or says something else.

    Args:
        path: TOML: a table for each shape, `like` one of HANDSHAPES or of those above it, with the angles that differ.
    """
    try:
        table = parsed_toml(regular_file(path, most=_MOST_BYTES).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is not readable TOML ({error}). docs/linguists.md shows one.") from error
    found: dict[str, Handshape] = {}
    for name, written in table.items():
        found[name] = _handshape(written, HANDSHAPES | found, origin=f"{path.name}: [{name}]")
    if not found:
        raise InputError(f'{path}: has no handshapes; expected tables such as [B] with a line like = "flat".')
    return found


def _handshape(written: Any, known: Mapping[str, Handshape], *, origin: str) -> Handshape:
    try:
        said = msgspec.convert(written, _Written)
        like = known[said.like]
        thumb = (like if said.thumb_like is None else known[said.thumb_like]).thumb
    except msgspec.ValidationError as error:
        raise InputError(f"{origin}: {error}. docs/linguists.md says what a handshape has.") from error
    except KeyError as error:
        raise InputError(f"{origin}: there is no handshape {error}; expected one of {', '.join(known)}.") from error
    names = ("index", "middle", "ring", "pinky", "spread")
    changes = {field: value for field in names if (value := getattr(said, field)) is not None}
    return replace(like, thumb=thumb, **changes)
