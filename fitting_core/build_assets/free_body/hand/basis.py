"""The basis of hand poses of a body: the learnt hand space (hand_space.py) about the axes of the body's own fingers."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from assets import HAND_SPACE
from fitting_core.body.geometry import MIRROR_ROTATION
from fitting_core.body.hand_skeleton import axis_angle_of, finger_axes


@dataclass(frozen=True, kw_only=True, eq=False)
class HandSpace:
    """Hand poses: mean + coefficients @ components, in anatomical angles (radians, see hand_skeleton.py)."""

    mean: Float[np.ndarray, "45"]
    components: Float[np.ndarray, "45 45"]
    """Orthonormal rows. The first 12 carry hands best, ordered by their variance; then the others, likewise."""


def read_hand_space(path: Path = HAND_SPACE) -> HandSpace:
    """The space that ships with the project, or another."""
    with np.load(path, allow_pickle=False) as file:
        return HandSpace(**{key: file[key].astype(float) for key in ("mean", "components")})


@dataclass(frozen=True, kw_only=True, eq=False)
class HandBasis:
    """Hand poses: mean + coefficients @ components, as axis-angle of the 15 finger joints in SMPL-X's order."""

    components: Float[np.ndarray, "45 45"]
    """Orthonormal rows; the first 12 span what hands do most."""
    mean: Float[np.ndarray, "45"]
    """A hand at ease, relative to the rest pose's flat one: the mean of recorded hands and postures."""

    def mirrored(self) -> "HandBasis":
        """The basis of the other hand."""
        return HandBasis(components=_mirror(self.components), mean=_mirror(self.mean))


def left_hand_basis(joints: Float[np.ndarray, "55 3"], space: HandSpace) -> HandBasis:
    """The left hand's basis, from the joints of a typical body in the rest pose (metres)."""
    axes = finger_axes(joints)
    return HandBasis(components=axis_angle_of(space.components, axes), mean=axis_angle_of(space.mean, axes))


def _mirror(vectors: Float[np.ndarray, "*n 45"]) -> Float[np.ndarray, "*n 45"]:
    return (vectors.reshape(*vectors.shape[:-1], -1, 3) * MIRROR_ROTATION).reshape(vectors.shape)
