"""COLMAP's text format: cameras.txt, and images.txt beside it (colmap.github.io/format.html).

cameras.txt has one line per camera: CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]. images.txt has two per image, of which only
the first is used: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, with x_camera = R(q) x_world + t.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from fitting_core.io.cameras.calibration import Calibration, calibration, text_of
from fitting_core.io.cameras.moving import Poses

CAMERAS, IMAGES, BINARY = "cameras.txt", "images.txt", "cameras.bin"
MODELS: dict[str, tuple[int, int]] = {
    "SIMPLE_PINHOLE": (1, 0),
    "PINHOLE": (2, 0),
    "SIMPLE_RADIAL": (1, 1),
    "RADIAL": (1, 2),
    "OPENCV": (2, 4),
    "FULL_OPENCV": (2, 8),
}
"""By the model's name: the count of focal lengths, and of OpenCV's coefficients after the principal point."""


def read_colmap(path: Path) -> list[Calibration]:
    """All cameras of a model: those of images by image name; without images.txt, the cameras by id.

    Args:
        path: The model's folder, or a file in it.

    Raises:
        ValueError: It is not such a model, or has an unsupported camera.
        OSError: A file cannot be read.
    """
    folder = path if path.is_dir() else path.parent
    if not (folder / CAMERAS).exists() and (folder / BINARY).exists():
        raise ValueError(
            "is a COLMAP model in binary files; expected text: colmap model_converter --output_type TXT writes it"
        )
    cameras = {found.name: found for found in _cameras(folder / CAMERAS)}
    if not (folder / IMAGES).exists():
        return list(cameras.values())
    return list(_images(folder / IMAGES, cameras))


def one_that_moves(images: Sequence[Calibration]) -> Calibration | None:
    """The camera that took all of these; None if there were several.

    Args:
        images: From `read_colmap`, each with a pose.
    """
    first = images[0] if images else None
    lenses = {(image.focal, image.center, image.distortion, image.size) for image in images}
    rotations = [image.rotation for image in images if image.rotation is not None]
    translations = [image.translation for image in images if image.translation is not None]
    if first is None or len(lenses) > 1 or len(rotations) != len(images):
        return None
    names = tuple(image.name for image in images)
    poses = Poses(rotation=np.stack(rotations), translation=np.stack(translations), names=names)
    return replace(first, name="", rotation=None, translation=None, poses=poses)


def _cameras(path: Path) -> Iterator[Calibration]:
    for number, line in _lines(path):
        fields = line.split()
        try:
            name, model, width, height, *parameters = fields
            yield _camera(name, model, (float(width), float(height)), [float(p) for p in parameters])
        except ValueError as error:
            raise ValueError(f"{path.name}, line {number}: {_reason(error, fields, 5)}") from error


def _camera(name: str, model: str, size: tuple[float, float], parameters: Sequence[float]) -> Calibration:
    if model not in MODELS:
        raise _Refused(
            f"camera {name} is of the model {model}; expected {', '.join(MODELS)}. COLMAP's image_undistorter makes "
            "pictures and a model without distortion"
        )
    focals, coefficients = MODELS[model]
    if len(parameters) != focals + 2 + coefficients:
        raise _Refused(f"{model} has {len(parameters)} parameters, expected {focals + 2 + coefficients}")
    fx, fy = parameters[0], parameters[focals - 1]
    (cx, cy), bent = parameters[focals : focals + 2], parameters[focals + 2 :]
    distortion = [*bent, *[0.0] * (4 - len(bent))] if bent else None
    found = calibration(name, matrix=[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], distortion=distortion, size=size)
    return replace(found, has_unit=False)


def _images(path: Path, cameras: dict[str, Calibration]) -> Iterator[Calibration]:
    lines = _lines(path, keep_empty=True)
    for number, line in lines:
        if not line.strip():
            continue
        fields = line.split(maxsplit=9)
        try:
            _, *pose, camera, name = fields
            quaternion, translation = np.array(pose[:4], float), np.array(pose[4:], float)
            if camera not in cameras:
                raise _Refused(f"image {name} is of camera {camera}, which is not in {CAMERAS}")
            if len(pose) != 7 or not np.isfinite([*quaternion, *translation]).all() or not quaternion.any():
                raise _Refused("expected a quaternion and a translation of finite numbers")
            turn = Rotation.from_quat(quaternion[[1, 2, 3, 0]]).as_matrix()
            yield replace(cameras[camera], name=name.strip(), rotation=turn, translation=translation)
        except ValueError as error:
            raise ValueError(f"{path.name}, line {number}: {_reason(error, fields, 10)}") from error
        next(lines, None)  # the image's points


class _Refused(ValueError):
    """An error of the file, in words."""


def _reason(error: ValueError, fields: Sequence[str], least: int) -> str:
    """What is wrong with a line: our own words, or that it does not have the form of one."""
    if len(fields) < least:
        return f"has {len(fields)} entries, expected {least} or more, as COLMAP writes them"
    return str(error)


def _lines(path: Path, *, keep_empty: bool = False) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text_of(path).splitlines(), 1):
        if not line.startswith("#") and (keep_empty or line.strip()):
            yield number, line
