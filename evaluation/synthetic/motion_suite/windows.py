"""The windows of captured motion that the suite is made of: their file, and a body that moves as they say."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter1d

from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz, write_npz

MOTION_SUITE = Path(__file__).with_name("motion_suite.npz")
"""Sixty windows of captured motion."""
HALVES = ("tuning", "untouched")
"""What methods are settled on, and what is looked at when they are."""
FRAME_RATE = 30.0
_STEP = np.pi / 32767
"""Radians of one step of the stored angles. Half precision would do for poses and not for accelerations: near pi its
steps are 0.002 rad, at 30 frames per second a noise of 1 m/s² at a hand."""
_ANKLES = (JOINT["left_ankle"], JOINT["right_ankle"])
_NAMES = ("name", "clip", "kind", "half")


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionWindow:
    """Two to four seconds of captured motion. World: y up; the person faces +z on average, about x = z = 0."""

    name: str
    """crawl_1: the clip, and which of its windows."""
    clip: str
    kind: str
    """"dance", "sit": what is done."""
    half: str
    """One of HALVES; no clip is in both."""
    pose: Float[np.ndarray, "T 22 3"]
    """Axis-angle of the root in the world and of joints 1 to 21, radians."""
    pelvis: Float[np.ndarray, "T 3"]
    """Where the pelvis was, in lengths of the captured leg."""
    standing: Bool[np.ndarray, "T 2"]
    """Whether the captured left and right foot were at rest."""

    def __len__(self) -> int:
        return len(self.pose)


def write_windows(path: Path, windows: list[MotionWindow]) -> None:
    """Write windows, angles in steps of pi / 32767."""
    names = {name: np.array([getattr(window, name) for window in windows]) for name in _NAMES}
    arrays = {
        "length": np.array([len(window) for window in windows], np.int32),
        "pose": np.round(np.concatenate([window.pose for window in windows]) / _STEP).astype(np.int16),
        "pelvis": np.concatenate([window.pelvis for window in windows]).astype(np.float32),
        "standing": np.concatenate([window.standing for window in windows]),
    }
    write_npz(path, names | arrays)


def read_windows(path: Path = MOTION_SUITE) -> dict[str, MotionWindow]:
    """All windows by name.

    Raises:
        InputError: It is no such file.
    """
    try:
        stored = read_npz(path)
        ends = np.cumsum(stored["length"])[:-1]
        pose, pelvis, standing = (np.split(stored[name], ends) for name in ("pose", "pelvis", "standing"))
        texts = [stored[name].tolist() for name in _NAMES]
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: is no file of motion windows ({error}). Take that of the checkout.") from error
    windows = [
        MotionWindow(
            **dict(zip(_NAMES, text, strict=True)),
            pose=angles * _STEP,
            pelvis=way.astype(np.float64),
            standing=still,
        )
        for *text, angles, way, still in zip(*texts, pose, pelvis, standing, strict=True)
    ]
    return {window.name: window for window in windows}


@lru_cache(maxsize=1)
def shipped_windows() -> dict[str, MotionWindow]:
    """The suite's windows by name."""
    return read_windows()


def acted(window: MotionWindow, body: BodyModel, betas: tuple[float, ...]) -> BodyParams:
    """A body that moves as the window says, in the world; the lowest point of its mesh in the window is at y = 0.

    The captured way is scaled to the body's legs. What these still slide where the captured feet rest, because thighs,
    shanks and hips are of other proportions, the body goes along with.
    """
    shape = replace(BodyParams.neutral(1), betas=torch.as_tensor([betas], dtype=torch.float64))
    rest = joints_in_space(body, shape)[0]
    way = window.pelvis * leg_length(rest)
    neutral = BodyParams.neutral(len(window))
    params = replace(
        neutral,
        betas=shape.betas.expand(len(window), -1).clone(),
        global_orient=torch.as_tensor(window.pose[:, 0]),
        body_pose=torch.as_tensor(window.pose[:, 1:].reshape(len(window), -1)),
        camera_translation=torch.as_tensor(way - rest[JOINT["pelvis"]]),
    )
    params = _moved(params, _held(joints_in_space(body, params)[:, _ANKLES], window.standing))
    floor = float(shared_mesh(body)(params)[..., 1].min())
    return _moved(params, np.array([0.0, -floor, 0.0]))


def leg_length(rest: Float[np.ndarray, "55 3"]) -> float:
    """From hip over knee to ankle, metres, of a rest pose's joints."""
    hip, knee, ankle = (rest[JOINT[f"left_{name}"]] for name in ("hip", "knee", "ankle"))
    return float(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))


def speeds(points: Float[np.ndarray, "T *n 3"], frame_rate: float) -> Float[np.ndarray, "T *n"]:
    """Metres per second, from the frames before and after."""
    return np.linalg.norm(np.gradient(points, axis=0), axis=-1) * frame_rate


_AFTER = 1.0
"""Frames over which the body's own correction is smoothed: feet come to rest and leave within one or two."""


def _held(ankles: Float[np.ndarray, "T 2 3"], standing: Bool[np.ndarray, "T 2"]) -> Float[np.ndarray, "T 3"]:
    """How far the whole body has to go so that feet at rest stay, metres; in the mean over the window nowhere."""
    both: Int[np.ndarray, "T-1 2"] = (standing[1:] & standing[:-1]).astype(int)
    steps = (np.diff(ankles, axis=0) * both[..., None]).sum(1) / np.maximum(both.sum(1), 1)[:, None]
    way = np.concatenate([np.zeros((1, 3)), -np.cumsum(gaussian_filter1d(steps, _AFTER, axis=0), axis=0)])
    return way - way.mean(0)


def _moved(params: BodyParams, way: np.ndarray) -> BodyParams:
    return replace(params, camera_translation=params.camera_translation + torch.as_tensor(way))
