"""People who gesture and are carried: on something that glides, on a turntable, or by a camera that pans.

Their feet seem to stand, and do not: what holds feet must let them go.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.keypoints import Keypoints

RATE = 25.0
"""Frames per second."""
CAMERA = Camera(focal=(1000.0, 1000.0), center=(640.0, 360.0), size=(1280, 720), source="given")
_PLACE = (0.0, 0.1, 4.5)
"""Metres in camera space, in the middle of the clip."""
_POINTS = 25
"""BODY_25 alone are seen."""


@dataclass(frozen=True, kw_only=True)
class Carried:
    """How somebody is carried."""

    glide: float = 0.0
    """Metres per second, to the right and away."""
    pan: float = 0.0
    """Degrees per second, of the camera."""
    turn: float = 0.0
    """Degrees per second, of a turntable."""


CARRIED: Mapping[str, Carried] = {
    "standing": Carried(),
    **{f"glides by {speed} m/s": Carried(glide=speed) for speed in (0.1, 0.2, 0.3)},
    **{f"camera pans by {speed} degrees/s": Carried(pan=float(speed)) for speed in (1, 2, 4)},
    "on a turntable": Carried(turn=125.0),
}
"""By name."""


def gesturing(way: Carried, *, frames: int) -> BodyParams:
    """Somebody who stands and moves the arms, 4.5 m away, and is carried."""
    neutral = BodyParams.neutral(frames)
    seconds = (np.arange(frames) - frames / 2) / RATE
    pose, t = neutral.body_pose.clone(), torch.as_tensor(seconds)
    pose[:, 15 * 3 + 2], pose[:, 16 * 3 + 2] = -1.0 + 0.25 * torch.sin(2 * t), 1.0 + 0.3 * torch.sin(1.3 * t)
    pose[:, 17 * 3 + 1], pose[:, 18 * 3 + 1] = -0.5 - 0.4 * torch.sin(1.7 * t), 0.6 + 0.4 * torch.sin(2.3 * t)
    camera = Rotation.from_rotvec(np.radians(way.pan) * seconds[:, None] * [0, 1, 0])
    yaw = Rotation.from_rotvec(np.radians(30 + way.turn * seconds)[:, None] * [0, 1, 0])
    place = np.outer(seconds * way.glide, [0.8, 0, 0.6]) + _PLACE
    return replace(
        neutral,
        body_pose=pose,
        global_orient=torch.as_tensor((camera * Rotation.from_euler("x", 180, degrees=True) * yaw).as_rotvec()),
        camera_translation=torch.as_tensor(camera.apply(place)),
    )


def carried_clip(body: BodyModel, params: BodyParams) -> Clip:
    """The body's keypoints, found to a pixel."""
    points, exists = keypoints_in_space(body, params)
    points[:, ~exists, 2] = 1
    xy = project(CAMERA, torch.as_tensor(points)).numpy()
    xy += np.random.default_rng(3).normal(0, 1, xy.shape)
    confidence = np.tile(np.where(exists & (np.arange(len(exists)) < _POINTS), 0.9, 0.0), (len(params), 1))
    return Clip(keypoints=Keypoints(xy=xy, confidence=confidence), camera=CAMERA, frame_rate=RATE, name="carried")


def pixel_errors(body: BodyModel, params: BodyParams, clip: Clip) -> Float[np.ndarray, "N"]:
    """Distances in pixels of a fit's keypoints from the detected ones."""
    points, _ = keypoints_in_space(body, params)
    seen = clip.keypoints.confidence > 0
    seen[:, _POINTS:] = False
    points[..., 2][~seen] = 1.0
    return np.linalg.norm(project(clip.camera, torch.as_tensor(points)).numpy() - clip.keypoints.xy, axis=-1)[seen]
