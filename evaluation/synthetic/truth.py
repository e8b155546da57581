"""The ground truth of a generated clip, from its body and its camera, and writing it."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import torch

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.files.npz import write_npz
from fitting_core.io.truth import CAMERA_KEYS, Truth

_PLAIN = ("joints", "keypoints", "visible", "exists", "frame_rate", "body_hash")


def truth_of(body: BodyModel, params: BodyParams, camera: Camera, frame_rate: float) -> Truth:
    """Ground truth of a moving body before a camera, with nothing visible yet."""
    points, exists = keypoints_in_space(body, params)
    pixels = np.zeros((*points.shape[:2], 2))
    pixels[:, exists] = project(camera, torch.as_tensor(points[:, exists])).numpy()
    return Truth(
        params=params,
        joints=joints_in_space(body, params),
        keypoints=pixels,
        visible=np.zeros(points.shape[:2], bool),
        exists=exists,
        camera=camera,
        frame_rate=frame_rate,
        body_hash=body.hash,
    )


def write_truth(path: Path, truth: Truth) -> None:
    """Write a truth as npz.

    Arrays are stored under the names of Truth's fields; those of params under their own, those of camera with a prefix.
    """
    params = {f.name: getattr(truth.params, f.name).numpy() for f in fields(BodyParams)}
    camera = {f"camera_{name}": np.array(getattr(truth.camera, name)) for name in CAMERA_KEYS}
    rest = {name: np.array(getattr(truth, name)) for name in _PLAIN}
    write_npz(path, {**params, **camera, **rest})
