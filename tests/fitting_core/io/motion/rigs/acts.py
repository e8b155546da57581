"""What is done on a rig: a person who walks on a spot and shifts weight, and hands that come to touch."""

from dataclasses import replace

import numpy as np
import torch
from scipy.optimize import brentq

from fitting_core.animation.retargeting.touch import touches
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.ground.contacts import Contacts
from fitting_core.motion import Motion
from tests.fitting_core.io.motion.motions import CAMERA


def _motion(body: BodyModel, params: BodyParams, **more: object) -> Motion:
    return Motion(body=body, params=params, camera=CAMERA, frame_rate=30.0, name="act", axes="y-up", **more)  # pyright: ignore


def _posed(frames: int, **angles: np.ndarray) -> BodyParams:
    """Axis-angle by joint, (3,) or (T, 3); the rest as in the rest pose."""
    pose = np.zeros((frames, 21, 3))
    for joint, value in angles.items():
        pose[:, JOINT[joint] - 1] = value
    return replace(BodyParams.neutral(frames), body_pose=torch.as_tensor(pose.reshape(frames, 63)))


def _arms(frames: int, closed: np.ndarray | float) -> dict[str, np.ndarray]:
    """Both hands before the chest, nearer to each other the more the elbows are closed (radians)."""
    closed = np.broadcast_to(closed, frames)
    found = {}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        found[f"{side}_shoulder"] = np.array([0.0, -0.9 * sign, -0.7 * sign])
        found[f"{side}_elbow"] = np.stack([0 * closed, -sign * closed, 0 * closed], 1)
    return found


def touching_hands(body: BodyModel, frames: int = 30) -> Motion:
    """Hands that come together before the chest, stay together for the middle third, and part."""

    def apart(angle: float) -> float:
        return float(touches(_motion(body, _posed(1, **_arms(1, angle))))["left"].distance[0]) - 0.006

    closed = float(brentq(apart, 0.6, 1.6, xtol=1e-3))  # pyright: ignore[reportArgumentType]
    way = np.interp(np.arange(frames) / (frames - 1), [0, 1 / 3, 2 / 3, 1], [0.5, closed, closed, 0.5])
    return _motion(body, _posed(frames, **_arms(frames, way)))


def weight_shifting(body: BodyModel, frames: int = 40) -> Motion:
    """A person who sways from foot to foot, knees bent and stretched, while both feet stand; they slide by millimetres.

    The left foot stands all the time, the right one is lifted in the last quarter.
    """
    t = np.linspace(0, 2 * np.pi, frames)[:, None]
    bend, up = 0.35 * (1 - np.cos(t)), np.zeros((frames, 1))
    up[3 * frames // 4 :] = np.linspace(0, 0.8, frames - 3 * frames // 4)[:, None]
    x, z = np.array([[1.0, 0, 0]]), np.array([[0, 0, 1.0]])
    params = _posed(
        frames,
        left_hip=-bend * x + 0.02 * np.sin(t) * z,
        left_knee=2 * bend * x,
        left_ankle=-bend * x - 0.02 * np.sin(t) * z,
        right_hip=-(bend + up) * x,
        right_knee=2 * (bend + up) * x,
        right_ankle=-(bend + up) * x,
    )
    still = _motion(body, params)
    foot = still.joints()[:, JOINT["left_foot"]]
    slide = 0.003 * np.sin(3 * t) * np.array([[1.0, 0, 0.5]])
    move = foot[:1] * (0, 1, 0) - foot + slide  # the left toes stay, but for the slide
    params = replace(params, camera_translation=torch.as_tensor(move))
    standing = np.ones((frames, 2), bool)
    standing[3 * frames // 4 :, 1] = False
    return _motion(
        body, params, contacts=Contacts(probability=standing * 0.9, standing=standing, let_go=np.zeros_like(standing))
    )
