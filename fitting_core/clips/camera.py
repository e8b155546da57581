"""The camera as a user describes it: a calibration file, or a focal length given in one of several ways."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import get_args

from fitting_core.camera import (
    DEFAULT_FOCAL,
    Camera,
    FocalFrom,
    PathScale,
    default_focal,
    focal_from_35mm,
    focal_from_fov,
)
from fitting_core.clips.options import CameraOptions
from fitting_core.config.choices import DEFAULT_RULE, FocalRule
from fitting_core.errors import InputError
from fitting_core.io.cameras.moving import ClipFrames
from fitting_core.io.cameras.reading import ANGLES, MAX_CENTER, CameraFile, read_camera

_FOCAL_OPTIONS: dict[str, tuple[Callable[[float, tuple[int, int]], float], str]] = {
    "focal_length": (lambda pixels, size: pixels, "focal length of {:g} pixels"),
    "fov": (lambda degrees, size: focal_from_fov(degrees, size[0]), "horizontal field of view of {:g} degrees"),
    "focal_length_35mm": (focal_from_35mm, "35 mm equivalent focal length of {:g} mm"),
}
"""By option name: its value and the image size -> focal length in pixels; and its source in words."""


@dataclass(frozen=True, kw_only=True)
class CameraGiven:
    """The user's options of the camera, checked."""

    file: CameraFile | None
    focal: tuple[str, float] | None
    center: tuple[float, float] | None
    automatic: bool
    """Whether the focal length comes from photographs or is estimated."""

    @classmethod
    def of(cls, options: CameraOptions) -> "CameraGiven":
        """Raises InputError if these contradict each other."""
        focal, file = _focal_option(options), _camera_file(options)
        rule = options.focal_length or DEFAULT_RULE
        return cls(file=file, focal=focal, center=options.center, automatic=not (file or focal) and rule == "auto")

    def camera(
        self, size: tuple[int, int], frames: ClipFrames, scale_of: Callable[[Camera], PathScale | None] | None = None
    ) -> Camera:
        """The camera from its calibration or the other options; `scale_of` as in `read_camera`."""
        if self.file is None:
            return _camera_of(size, self.center, self.focal)
        return read_camera(self.file, size, frames, scale_of=scale_of)


def _focal_option(options: CameraOptions) -> tuple[str, float] | None:
    """The one option of _FOCAL_OPTIONS that is given, and its value; None for none, or for a rule. Raises InputError if
    more than one is given, or it is not a focal length."""
    rules = get_args(FocalRule)
    given = {name: value for name in _FOCAL_OPTIONS if (value := getattr(options, name)) is not None}
    if len(given) > 1:
        listed = " and ".join(f"`{n}` {v if isinstance(v, str) else format(v, 'g')}" for n, v in given.items())
        raise InputError(f"The focal length is given {len(given)} times: {listed}. Give only one of them.")
    name, value = next(iter(given.items()), ("", None))
    if value is None or (name == "focal_length" and value in rules):
        return None
    if isinstance(value, str):
        more = f", {' or '.join(rules)}" if name == "focal_length" else ""
        raise InputError(f"`{name}` is {value!r}; expected a number{more}.")
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"`{name}` is {value:g}; expected a positive number.")
    if name == "fov" and value > ANGLES[1]:
        raise InputError(f"`fov` is {value:g}; expected degrees from left to right, up to {ANGLES[1]:g}.")
    return name, value


def _camera_file(options: CameraOptions) -> CameraFile | None:
    """The calibration that a user gave. Raises InputError if the camera is given twice, or options for a file that is
    not given."""
    path = options.camera
    if path is None:
        told = (name for name in ("camera_name", "camera_unit", "camera_up") if getattr(options, name) is not None)
        if name := next(told, None):
            raise InputError(f"`{name}` is given without a camera file. Give the file, or leave it out.")
        return None
    if options.focal_length or options.fov or options.focal_length_35mm or options.center:
        raise InputError(
            f"The camera is given twice: by {path}, and by a focal length or a principal point. Give only one of them."
        )
    return CameraFile(path=path, name=options.camera_name, unit=options.camera_unit, up=options.camera_up)


def _camera_of(size: tuple[int, int], center: tuple[float, float] | None, focal: tuple[str, float] | None) -> Camera:
    """The camera of an image of this size; without a focal length, that of the image diagonal. Raises InputError if its
    field of view is implausible, or its principal point is far from the image."""
    if focal is None:
        pixels, origin, source = default_focal(size), FocalFrom.DIAGONAL, DEFAULT_FOCAL
    else:
        to_focal, words = _FOCAL_OPTIONS[focal[0]]
        pixels, origin, source = to_focal(focal[1], size), FocalFrom.GIVEN, f"{words.format(focal[1])}, as given"
        _check_angle(pixels, size, words.format(focal[1]))
    middle = (size[0] / 2, size[1] / 2)
    if center is not None and not all(
        abs(given - m) <= MAX_CENTER * side for given, m, side in zip(center, middle, size, strict=True)
    ):
        raise InputError(
            f"`center` is ({center[0]:g}, {center[1]:g}); expected the principal point in pixels of an image of "
            f"{size[0]} x {size[1]}, usually near ({middle[0]:g}, {middle[1]:g})."
        )
    return Camera(focal=(pixels, pixels), center=center or middle, size=size, focal_from=origin, source=source)


def _check_angle(focal: float, size: tuple[int, int], words: str) -> None:
    degrees = 2 * math.degrees(math.atan(size[0] / 2 / focal))
    if not ANGLES[0] <= degrees <= ANGLES[1]:
        raise InputError(
            f"A camera with a {words} sees {degrees:.3g} degrees of an image of "
            f"{size[0]} x {size[1]}; expected {ANGLES[0]:g} to {ANGLES[1]:g}. `focal_length` is in pixels, not "
            "in millimetres (`focal_length_35mm`) or degrees (`fov`)."
        )
