"""The real clips that the benchmarks fit, and the truth of those that have one."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from fitting_core.clip import Clip
from fitting_core.clips.options import CameraOptions
from fitting_core.clips.reading import read_clip
from fitting_core.errors import InputError

Focal = Literal["true", "auto", "diagonal"]
ENVIRONMENT = "TCFIT_SHARED_DATA"
"""Names the folder of the development data where it is not beside the repository."""


@dataclass(frozen=True, kw_only=True)
class Sample:
    """A clip, and what is known about it."""

    clip: Clip
    truth: Float[np.ndarray, "T 25 3"] | None = None
    """BODY_25 in camera space, metres: triangulated from four calibrated views, good to 2-3 cm."""

    def __len__(self) -> int:
        return len(self.clip)


def data_folder() -> Path:
    """The folder of the development data.

    Raises:
        InputError: it is not there.
    """
    beside = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get(ENVIRONMENT, beside)).resolve()
    if not folder.is_dir():
        raise InputError(
            f"The benchmarks run on development data that is not part of the project, and {folder} is no folder. "
            f"Set {ENVIRONMENT} to the folder that holds `balancing` and `signs`."
        )
    return folder


def _balancing(name: str, focal: Focal, detected: bool) -> Sample:
    """A man balancing on a treadmill, filmed by a calibrated camera; no hands, no face."""
    folder = data_folder() / "balancing"
    with np.load(folder / name / "camera.npz", allow_pickle=False) as camera:
        intrinsics, rotation, shift = camera["K"], camera["R"], camera["t"].reshape(3)
    with np.load(folder / "reference_3d.npz", allow_pickle=False) as reference:
        truth = reference["points"] @ rotation.T + shift
    video, keypoints = folder / name / "video.mp4", None if detected else folder / name / "keypoints"
    if focal != "true":
        return Sample(clip=read_clip(video, keypoints, camera=CameraOptions(focal_length=focal)), truth=truth)
    length = float(intrinsics[0, 0] + intrinsics[1, 1]) / 2
    center = (float(intrinsics[0, 2]), float(intrinsics[1, 2]))
    camera = CameraOptions(focal_length=length, center=center)
    return Sample(clip=read_clip(video, keypoints, camera=camera), truth=truth)


def _signs(name: str, focal: Focal, detected: bool) -> Sample:
    """A signer's upper body with hands and face; the camera is not known, so its focal length is always the default."""
    folder = data_folder() / "signs" / name
    keypoints = None if detected else folder / "keypoints"
    return Sample(clip=read_clip(folder / "video.mp4", keypoints, camera=CameraOptions(focal_length="diagonal")))


CLIPS: dict[str, Callable[[str, Focal, bool], Sample]] = {
    "cam03": _balancing,
    "cam04": _balancing,
    "gebaerden": _signs,
    "psychologie": _signs,
}
"""By name: how to read the clip, given that name, which focal length, and whether to detect its keypoints."""


def read(name: str, *, focal: Focal = "true", detected: bool = False) -> Sample:
    """A clip by its name in CLIPS.

    Args:
        name: one of CLIPS.
        focal: the calibrated one where it is known, or what a user gets who knows none, in the image's centre.
        detected: keypoints of tcfit's own detector in place of OpenPose's.

    Raises:
        InputError: there is no such clip, or the development data is not there.
    """
    if name not in CLIPS:
        raise InputError(f"There is no clip {name}; expected one of {', '.join(CLIPS)}.")
    return CLIPS[name](name, focal, detected)
