"""A camera as arrays, for npz files.

| key | shape | |
|---|---|---|
| camera_focal, camera_center, image_size | (2,), (2,), (2,) | pixels, of straightened pictures |
| camera_focal_from, camera_source | (), () | where the focal length comes from: a `FocalFrom`, and in words |
| camera_focal_deviation | () | only of an estimated focal length: standard deviation of its logarithm |
| vertical_up, vertical_deviation | (3,), () | only where the pictures tell it: a unit vector against gravity in \
camera space, and its standard deviation in degrees |
| lens_focal, lens_center, lens_distortion | (2,), (2,), (n,) | only of a lens that bends: its calibration |
| world_rotation, world_translation, world_up | (3, 3), (3,), () | only where it is known where the camera stands: \
x_camera = world_rotation @ x_world + world_translation, metres; up is an axis such as z, or empty |
| path_rotation, path_translation | (N, 3, 3), (N, 3) | only of a camera that moves, by frame: \
x_camera = path_rotation @ x_still + path_translation, metres; world_* is then of still space, in which \
the camera stands where it stood in the first frame |
"""

from typing import Any, get_args

import numpy as np

from fitting_core.camera import (
    Camera,
    CameraPath,
    FocalFrom,
    Lens,
    Vertical,
    World,
    focal_from_words,
    is_possible,
    matrix_of,
    path_of,
    vector_of,
)
from fitting_core.config.choices import Up


def camera_arrays(camera: Camera) -> dict[str, np.ndarray]:
    """The arrays of the table above."""
    found: dict[str, Any] = {
        "camera_focal": camera.focal,
        "camera_center": camera.center,
        "camera_focal_from": camera.focal_from,
        "camera_source": camera.source,
        "image_size": camera.size,
    }
    if camera.focal_deviation is not None:
        found["camera_focal_deviation"] = camera.focal_deviation
    if (vertical := camera.vertical) is not None:
        found |= {"vertical_up": vertical.up, "vertical_deviation": vertical.deviation}
    if (lens := camera.lens) is not None:
        found |= {"lens_focal": lens.focal, "lens_center": lens.center, "lens_distortion": lens.distortion}
    if (world := camera.world) is not None:
        found |= {"world_rotation": world.rotation, "world_translation": world.translation, "world_up": world.up or ""}
    if (path := camera.path) is not None:
        found |= {"path_rotation": path.rotation, "path_translation": path.translation}
    return {name: np.asarray(value) for name, value in found.items()}


def camera_from(arrays: dict[str, np.ndarray]) -> Camera:
    """The camera that `camera_arrays` wrote; files of earlier versions may lack lens and world.

    Raises:
        KeyError: An array is missing.
        ValueError: They do not make a camera.
        TypeError: They do not make a camera.
    """
    (fx, fy), (cx, cy), (width, height) = (
        arrays[name].tolist() for name in ("camera_focal", "camera_center", "image_size")
    )
    camera = Camera(
        focal=(fx, fy),
        center=(cx, cy),
        size=(width, height),
        focal_from=focal_from_arrays(arrays),
        source=str(arrays["camera_source"]),
        focal_deviation=float(arrays["camera_focal_deviation"]) if "camera_focal_deviation" in arrays else None,
        vertical=_vertical(arrays) if "vertical_up" in arrays else None,
        lens=_lens(arrays) if "lens_focal" in arrays else None,
        world=_world(arrays) if "world_rotation" in arrays else None,
        path=_path(arrays) if "path_rotation" in arrays else None,
    )
    if not is_possible(camera):
        raise ValueError("its camera is invalid")
    return camera


def focal_from_arrays(arrays: dict[str, np.ndarray]) -> FocalFrom:
    """Where the focal length of `camera_arrays` comes from. Raises ValueError if the value is unknown."""
    if "camera_focal_from" in arrays:
        return FocalFrom(str(arrays["camera_focal_from"]))
    return focal_from_words(str(arrays.get("camera_source", "")))


def _vertical(arrays: dict[str, np.ndarray]) -> Vertical:
    return Vertical(up=vector_of(arrays["vertical_up"]), deviation=float(arrays["vertical_deviation"]))


def _lens(arrays: dict[str, np.ndarray]) -> Lens:
    (fx, fy), (cx, cy) = (arrays[name].tolist() for name in ("lens_focal", "lens_center"))
    return Lens(focal=(fx, fy), center=(cx, cy), distortion=tuple(arrays["lens_distortion"].tolist()))


def _path(arrays: dict[str, np.ndarray]) -> CameraPath:
    rotation, translation = arrays["path_rotation"], arrays["path_translation"]
    if rotation.shape[1:] != (3, 3) or translation.shape != (len(rotation), 3):
        raise ValueError(f"its camera moves by {rotation.shape} and {translation.shape}, expected (N, 3, 3) and (N, 3)")
    return path_of(rotation, translation)


def _world(arrays: dict[str, np.ndarray]) -> World:
    rotation, translation = matrix_of(arrays["world_rotation"]), vector_of(arrays["world_translation"])
    up = next((axis for axis in get_args(Up) if axis == str(arrays["world_up"])), None)
    return World(rotation=rotation, translation=translation, up=up)
