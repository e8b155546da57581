"""A camera from a calibration file: which one, its image size, the unit of its world, how it moves."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np
from scipy.spatial.transform import Rotation

from fitting_core.camera import Camera, CameraPath, FocalFrom, Lens, PathScale, World, matrix_of, path_of, vector_of
from fitting_core.config.choices import Up
from fitting_core.errors import InputError, some_of
from fitting_core.files.regular import legible
from fitting_core.io.cameras.calibration import Calibration
from fitting_core.io.cameras.camera_npz import read_camera_npz
from fitting_core.io.cameras.colmap import CAMERAS, IMAGES, one_that_moves, read_colmap
from fitting_core.io.cameras.moving import ClipFrames, Poses, in_frames
from fitting_core.io.cameras.tables import TABLES
from fitting_core.lens import share_straightened

_ASPECT = 0.005
"""Allowed difference of aspect ratios: 1280 x 720 becomes 854 x 480."""
ANGLES = (0.5, 170.0)
"""Horizontal field of view in degrees: from a long telephoto lens to the widest without distortion."""
MAX_CENTER = 2.0
"""How far the principal point may be from the image's middle, in image sizes: cropped videos have it outside."""
_MOST_NOWHERE = 0.25
"""Share of a picture that a lens may leave undefined: more means coefficients of another model."""
_FAR = 100.0
"""Distance in metres from the origin beyond which a world's unit is hardly the metre."""
_LISTED = 12
_FORMS: dict[str, Callable[[Path], list[Calibration]]] = {".npz": read_camera_npz, **TABLES}
"""By the file's suffix; COLMAP's texts are recognised by name."""
EXPECTED = (
    "an npz with K, a TOML of Pose2Sim or caliscope, OpenCV's YAML, XML or JSON with a camera_matrix, a "
    f"transforms.json, or COLMAP's {CAMERAS} with {IMAGES} beside it"
)


@dataclass(frozen=True, kw_only=True)
class CameraFile:
    """Which camera of which file, as the user gave it."""

    path: Path
    name: str | None = None
    """Of one among several; may be None if there is one."""
    unit: float | None = None
    """Metres per unit of its world; None: 1."""
    up: Up | None = None
    """The world's axis against gravity; None: as the file or its program's convention has it."""


def read_camera(
    file: CameraFile,
    size: tuple[int, int],
    frames: ClipFrames | None = None,
    *,
    scale_of: Callable[[Camera], PathScale | None] | None = None,
) -> Camera:
    """The camera for images of a size, with notes on how it was read. Raises InputError if the file cannot be read, has
    several cameras but none of that name, was made for images of another shape, or holds no valid camera.

    Args:
        file: Which camera of which file.
        size: Width and height in pixels.
        frames: What a moving camera filmed; None: the images with poses in the file.
        scale_of: Estimates the metres of one unit of a moving camera without a stated unit.
    """
    if file.unit is not None and not 1e-6 <= file.unit <= 1e6:
        raise InputError(
            f"`camera_unit` is {file.unit:g}; expected the metres of one unit, such as 0.001 for millimetres."
        )
    if file.up is not None and file.up not in get_args(Up):
        raise InputError(f"`camera_up` is {file.up!r}; expected one of {', '.join(get_args(Up))}.")
    chosen = _chosen(file, _all(file.path))
    try:
        sized, size_notes = _for_size(chosen, size)
        _check_view(sized, size)
        lens, lens_notes = _lens(sized, size)
        poses, path_notes = _poses(sized, frames)
    except ValueError as error:
        raise InputError(f"{file.path}: {_titled(chosen)}{error}.") from error
    name = f", camera {chosen.name}" if chosen.name else ""
    source = legible(f"camera file {file.path.name}{name}, as given")
    camera = Camera(
        focal=sized.focal, center=sized.center, size=size, focal_from=FocalFrom.FILE, source=source, lens=lens
    )
    world, path, world_notes = _world(file, chosen, poses)
    if path is not None and scale_of is not None and not _has_scale(file, chosen):
        world, path, world_notes = _world(file, chosen, poses, scale_of(replace(camera, path=path)))
    notes = (*chosen.notes, *size_notes, *lens_notes, *path_notes, *world_notes)
    notes = tuple(f"{file.path.name}: {_titled(chosen)}{note}" for note in notes)
    return replace(camera, world=world, path=path, notes=notes)


def camera_files(path: Path) -> list[Path]:
    """The files that the camera of a path is read from, if they exist."""
    if not _is_colmap(path):
        return [path] if path.is_file() else []
    folder = path if path.is_dir() else path.parent
    return [file for name in (CAMERAS, IMAGES) if (file := folder / name).is_file()]


def _is_colmap(path: Path) -> bool:
    return path.is_dir() or path.name in (CAMERAS, IMAGES)


def _all(path: Path) -> list[Calibration]:
    try:
        if _is_colmap(path):
            return read_colmap(path)
        if (suffix := path.suffix.lower()) in _FORMS and path.exists():
            return _FORMS[suffix](path)
    except FileNotFoundError as error:
        missing = Path(error.filename or path).name
        raise InputError(f"{path}: has no {missing}; expected {EXPECTED}.") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from error
    except ValueError as error:
        raise InputError(f"{path}: {error}.") from error
    what = "is not a known kind of camera file" if path.exists() else "does not exist"
    raise InputError(f"{path}: {what}; expected {EXPECTED}.")


def _chosen(file: CameraFile, cameras: Sequence[Calibration]) -> Calibration:
    names = [camera.name for camera in cameras]
    listed = some_of(names, most=_LISTED)
    if file.name is None:
        if len(cameras) == 1:
            return cameras[0]
        if _is_colmap(file.path) and (moving := one_that_moves(cameras)) is not None:
            return moving
        found = f"has {len(cameras)} cameras ({listed})" if cameras else "has no camera"
        raise InputError(f"{file.path}: {found}; expected one. Say which by `camera_name`.")
    matching = [camera for camera in cameras if camera.name == file.name]
    if len(matching) != 1:
        what = "several cameras" if matching else "no camera"
        raise InputError(
            f"{file.path}: has {what} named {file.name!r}; it has {listed if any(names) else 'cameras without names'}."
        )
    return matching[0]


def _titled(camera: Calibration) -> str:
    return f"camera {camera.name} " if camera.name else ""


def _for_size(camera: Calibration, size: tuple[int, int]) -> tuple[Calibration, tuple[str, ...]]:
    """The calibration scaled to images of another size and the same shape."""
    (width, height) = size
    if camera.size is None:
        return camera, (f"does not state its image size; {width} x {height} is assumed.",)
    if camera.size == size:
        return camera, ()
    x, y = width / camera.size[0], height / camera.size[1]
    of = f"images of {camera.size[0]} x {camera.size[1]} pixels"
    if abs(x / y - 1) > _ASPECT:
        turned = " They are rotated by 90 degrees." if camera.size == (height, width) else ""
        raise ValueError(
            f"was calibrated on {of}, and the clip has {width} x {height}, of another shape; expected the same images, "
            f"or all of them scaled.{turned} Calibrate as you film, without cropping"
        )
    scaled = replace(
        camera, focal=(camera.focal[0] * x, camera.focal[1] * y), center=(camera.center[0] * x, camera.center[1] * y)
    )
    return scaled, (f"was calibrated on {of} and is scaled to the clip's {width} x {height}.",)


def _lens(camera: Calibration, size: tuple[int, int]) -> tuple[Lens | None, tuple[str, ...]]:
    if not camera.distortion:
        return None, ()
    lens = Lens(focal=camera.focal, center=camera.center, distortion=camera.distortion)
    nowhere = 1 - share_straightened(lens, size)
    if nowhere > _MOST_NOWHERE:
        raise ValueError(
            f"has distortion coefficients that fold {nowhere:.0%} of the picture; expected those of OpenCV's model "
            "(k1, k2, p1, p2, k3 ...) for this lens, not a fisheye's"
        )
    if nowhere > 0:
        return lens, (
            f"has distortion coefficients that are undefined for {max(nowhere, 0.01):.0%} of the picture; "
            "keypoints there are ignored.",
        )
    return lens, ()


def _check_view(camera: Calibration, size: tuple[int, int]) -> None:
    degrees = 2 * math.degrees(math.atan(size[0] / 2 / camera.focal[0]))
    if not ANGLES[0] <= degrees <= ANGLES[1]:
        raise ValueError(
            f"sees {degrees:.3g} degrees of an image of {size[0]} x {size[1]} (focal length {camera.focal[0]:g} "
            f"pixels); expected {ANGLES[0]:g} to {ANGLES[1]:g}"
        )
    if any(abs(at - side / 2) > MAX_CENTER * side for at, side in zip(camera.center, size, strict=True)):
        raise ValueError(
            f"has its principal point at ({camera.center[0]:g}, {camera.center[1]:g}); expected pixels of an image of "
            f"{size[0]} x {size[1]}"
        )


def _poses(camera: Calibration, frames: ClipFrames | None) -> tuple[Poses | None, tuple[str, ...]]:
    """For each used frame, at least one; and notes."""
    if camera.poses is None or frames is None:
        return camera.poses, ()
    return in_frames(camera.poses, frames)


def _world(
    file: CameraFile, camera: Calibration, poses: Poses | None, scale: PathScale | None = None
) -> tuple[World | None, CameraPath | None, tuple[str, ...]]:
    """Where the camera stands, or its start and path, in metres."""
    rotation, translation = camera.rotation, camera.translation
    if poses is not None:
        rotation, translation = poses.rotation[0], poses.translation[0]
    if rotation is None or translation is None:
        unused = [f"camera_{name}" for name in ("unit", "up") if getattr(file, name) is not None]
        if unused:
            raise InputError(
                f"{unused[0]} is given, but {file.path} has no camera pose. Leave it out, or give a "
                "file with rotation and translation."
            )
        return None, None, ()
    unit = file.unit or (1.0 if scale is None else scale.metres)
    world = World(rotation=matrix_of(rotation), translation=vector_of(translation * unit), up=file.up or camera.up)
    path = None if poses is None or not poses.move else _path(poses, unit)
    return world, path, tuple(_world_notes(file, camera, world, path, scale))


def _path(poses: Poses, unit: float) -> CameraPath:
    turns = poses.rotation @ poses.rotation[0].T
    return path_of(turns, unit * (poses.translation - turns @ poses.translation[0]))


def _has_scale(file: CameraFile, camera: Calibration) -> bool:
    return file.unit is not None or camera.has_unit


def _world_notes(
    file: CameraFile, camera: Calibration, world: World, path: CameraPath | None, scale: PathScale | None
) -> Iterator[str]:
    scaled = _has_scale(file, camera)
    if path is not None:
        length = float(np.linalg.norm(np.diff(path.places, axis=0), axis=1).sum())
        turned = np.degrees(Rotation.from_matrix(path.to_still).magnitude().max())
        yield f"moves: {length:.2f} m along its path, turned by up to {turned:.0f} degrees from its start."
    if scale is not None:
        yield (
            f"moves in a world without scale; by {scale.by}, one unit is {scale.metres:.3g} m "
            f"(± {scale.deviation:.0%}). If you know better, give `camera_unit` (a length that you know, divided by "
            "what it is in the file's world)."
        )
    elif path is not None and not scaled:
        yield (
            "moves in a world without scale; its unit is assumed to be a metre. If that is wrong, the person slides "
            "and is too fast or too slow: give `camera_unit`, the metres of one unit (a length that you "
            "know, divided by what it is in the file's world)."
        )
    elif not scaled:
        yield "stands in a world without scale; its unit is assumed to be a metre. Give `camera_unit` to scale it."
    elif file.unit is None and (distance := float(np.linalg.norm(world.place))) > _FAR:
        yield f"stands {distance:.0f} m from the origin; if its file is in millimetres, give `camera_unit` 0.001."
    if world.up_in_camera is None:
        yield "stands in a world whose up axis is not known; exports are levelled by estimate. Give `camera_up`."
    elif world.up_in_camera[1] > 0:
        yield f"hangs upside down if {world.up} is up, as assumed; if it is not, give `camera_up`."
