"""Cameras in a world: where one stands and looks, and how points and bodies get into its space."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.body.params import BodyParams
from fitting_core.camera import World
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz


@dataclass(frozen=True, kw_only=True, eq=False)
class WorldCamera:
    """Where a camera stands: x_camera = rotation @ x_world + translation, metres."""

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]

    @classmethod
    def of(cls, world: World) -> Self:
        """A camera that stands where a calibration says."""
        return cls(rotation=np.array(world.rotation, float), translation=np.array(world.translation, float))

    def __call__(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points of the world in the camera's space."""
        return points @ self.rotation.T + self.translation


_EXPECTED = "R (3, 3) and t (3,), with x_camera = R x_world + t in metres"


def in_camera(params: BodyParams, rest_root: Float[np.ndarray, "*T 3"], camera: WorldCamera) -> BodyParams:
    """The same bodies in camera space.

    A body turns about its root joint, which rests at `rest_root` and not at the origin.
    """
    orient = Rotation.from_matrix(camera.rotation) * Rotation.from_rotvec(params.global_orient.numpy())
    root = camera(params.camera_translation.numpy() + rest_root)
    return replace(
        params, global_orient=torch.as_tensor(orient.as_rotvec()), camera_translation=torch.as_tensor(root - rest_root)
    )


def read_world_camera(path: Path) -> WorldCamera:
    """Read the arrays R and t of an npz file; K and others in it are left alone. Raises InputError if there is no such
    file, or what it holds is no rotation and translation."""
    try:
        archive = read_npz(path, ("R", "t"))
        rotation, translation = (np.asarray(archive[name], np.float64) for name in ("R", "t"))
    except FileNotFoundError as error:
        raise InputError(f"{path}: does not exist; expected an npz with {_EXPECTED}. Correct --camera.") from error
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: is no camera ({error}); expected an npz with {_EXPECTED}.") from error
    if rotation.shape != (3, 3) or translation.size != 3:
        raise InputError(f"{path}: has R {rotation.shape} and t {translation.shape}; expected {_EXPECTED}.")
    if not np.isfinite(translation).all() or abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3:
        raise InputError(f"{path}: its R is no rotation (R R^T is not the identity); expected {_EXPECTED}.")
    if np.linalg.det(rotation) < 0:
        raise InputError(f"{path}: its R mirrors (determinant -1); expected a rotation. Turn one of its axes round.")
    return WorldCamera(rotation=rotation, translation=translation.reshape(3))
