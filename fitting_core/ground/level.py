"""How a camera is held: the rotation that levels its space, with the floor or the user's origin at 0."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.camera import World
from fitting_core.ground.grounding import Grounding

_STEEP = 0.95
"""Cosine to gravity above which the camera looks so steeply that the image's upper edge defines ahead."""
_FROM_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""From a world with z up to the axes of a level camera, as AXES of motion.py turn them back."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """From still space to that of a level camera at the same place, or to the user's own world.

    Still space is camera space if the camera does not move (see `CameraPath`).
    """

    turn: Float[np.ndarray, "3 3"]
    """x_level = turn @ x_still; y along gravity, and except in the user's own world x right, z ahead."""
    height: float | None
    """Height in metres of the camera above the floor; None if the floor is not known."""
    text: str
    """Description, for the files that are levelled by it."""
    place: Float[np.ndarray, "3"] | None = None
    """Position of the camera in the user's own world, metres, in these axes; None: above the origin."""


def level_of(grounding: Grounding | None, world: World | None = None) -> Level | None:
    """What is certain enough to level a motion by: the user's world, or gravity to 10 degrees; otherwise None.

    Args:
        grounding: Of the fit.
        world: The camera's pose if the user gave it; ignored if its up axis is not known.
    """
    if world is not None and (up := world.up_in_world) is not None:
        return _of_world(world, up, grounding)
    if grounding is None or not grounding.gravity.sure:
        return None
    gravity, ground = grounding.gravity, grounding.ground
    return Level(turn=upright(gravity.up), height=None if ground is None else ground.offset, text=grounding.text)


def best_grounding(groundings: Sequence[Grounding | None]) -> int | None:
    """Of several people before one camera, the surest floor; without any, the surest gravity; or None.

    Args:
        groundings: Of their fits.
    """

    def doubt(k: int) -> tuple[bool, float]:
        grounding = groundings[k]
        assert grounding is not None
        ground = grounding.ground
        return ground is None, grounding.gravity.deviation if ground is None else ground.deviation

    return min((k for k, one in enumerate(groundings) if one is not None), key=doubt, default=None)


def _of_world(world: World, up: Float[np.ndarray, "3"], grounding: Grounding | None) -> Level:
    """The user's world, rotated by quarter turns so that its up axis is up."""
    quarters = _FROM_Z_UP @ _to_z(up)
    text, height = "The camera stands as its calibration says", None
    if grounding is not None and grounding.ground is not None:
        height = grounding.ground.offset
        text += f"; feet stand at {float(up @ world.place) - height:+.3f} m of its world"
    return Level(turn=quarters @ world.from_camera, height=height, text=text, place=quarters @ world.place)


def _to_z(axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation by quarter turns that makes an axis, or its negative, the third one; identity for z."""
    z = np.array([0.0, 0.0, 1.0])
    about = np.cross(axis, z)
    if not about.any():
        about = (1.0 - axis[2]) * np.array([1.0, 0.0, 0.0])
    return np.round(Rotation.from_rotvec(np.pi / 2 * about).as_matrix())


def upright(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation of camera space by which up becomes -y, and ahead stays ahead."""
    ahead = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < _STEEP else np.array([0.0, np.sign(up[2]), 0.0])
    down = -up / np.linalg.norm(up)
    forward = ahead - (ahead @ down) * down
    forward /= np.linalg.norm(forward)
    return np.stack([np.cross(down, forward), down, forward])
