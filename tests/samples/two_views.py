"""Captured motion seen by two cameras, with noisy keypoints."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from evaluation.synthetic.motion_suite.windows import FRAME_RATE, acted, shipped_windows
from evaluation.synthetic.suite import SUBJECTS, subject_body
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.keypoints import Keypoints
from fitting_core.world_camera import WorldCamera

CAMERA = Camera(focal=(1500.0, 1500.0), center=(540.0, 960.0), size=(1080, 1920))
WINDOW = "05_02_1"
_NOISE = 0.012
"""Metres at the body, half of it lasting."""


@lru_cache(maxsize=4)
def motion(window: str = WINDOW) -> Float[np.ndarray, "T 137 3"]:
    """Keypoints in the world, metres, y up."""
    subject = SUBJECTS[0]
    body = subject_body(subject)
    points, exists = keypoints_in_space(body, acted(shipped_windows()[window], body, subject.betas))
    return np.where(np.broadcast_to(np.asarray(exists)[..., None], points.shape), np.nan_to_num(points), 0.0)


def camera_at(azimuth: float, *, distance: float = 4.5, height: float = 1.3) -> WorldCamera:
    """One that looks at the person from an azimuth in degrees, 0 in front."""
    turn = Rotation.from_euler("y", azimuth, degrees=True)
    place = turn.apply([0.0, height, distance])
    axes = np.array([turn.apply([1.0, 0, 0]), [0, -1.0, 0], turn.apply([0, 0, -1.0])])
    return WorldCamera(rotation=axes, translation=-axes @ place)


def seen_from(
    azimuth: float,
    *,
    frames: slice = slice(None),
    window: str = WINDOW,
    seed: int = 0,
    points: slice = slice(0, 25),
    noise: float = _NOISE,
) -> Clip:
    """A clip by a camera of `camera_at`; `frames` of the motion, with a step for lower frame rates."""
    world = motion(window)
    camera, rng = camera_at(azimuth), np.random.default_rng([seed, round(azimuth) % 360])
    inside = camera(world)
    drawn = rng.normal(size=(*inside.shape[:2], 2))
    errors = 0.5 * gaussian_filter1d(rng.normal(size=drawn.shape), 4, axis=0) * np.sqrt(8 * np.sqrt(np.pi)) + drawn
    xy = (inside[..., :2] + noise * errors / np.sqrt(1.25)) / inside[..., 2:] * CAMERA.focal + CAMERA.center
    confidence = np.zeros(inside.shape[:2])
    confidence[:, points] = 0.8
    keypoints = Keypoints(xy=xy, confidence=confidence * np.any(world, axis=-1))
    return Clip(
        keypoints=keypoints[frames], camera=CAMERA, frame_rate=FRAME_RATE / (frames.step or 1), name=f"from {azimuth:g}"
    )


def without(clip: Clip, frames: slice, points: slice) -> Clip:
    """The clip with keypoints that are not found in some frames."""
    confidence = clip.keypoints.confidence.copy()
    confidence[frames, points] = 0.0
    return replace(clip, keypoints=replace(clip.keypoints, confidence=confidence))
