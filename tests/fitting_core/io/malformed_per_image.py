"""Malformed results of SAM 3D Body."""

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.io import read_motion
from tests.fitting_core.io.malformed import Bomb, Case, content


def of_sam(says: str, **changed: Any) -> Case:
    """SAM 3D Body's people of two images with other values."""
    person: dict[str, Any] = {
        "pred_keypoints_3d": np.zeros((70, 3)),
        "pred_cam_t": np.array([0.0, 0, 3]),
        "focal_length": 900.0,
    }
    return Case(content("sam.pkl", pickle.dumps([[person], [person | changed]])), read_motion, says)


def without_focal(name: str, frames: int) -> Case:
    """SAM 3D Body's people as they are published elsewhere: points and place, and no camera."""
    person = {"pred_keypoints_3d": np.zeros((70, 3)), "pred_cam_t": np.array([0.0, 0, 3])}
    if name.endswith(".pkl"):
        make = content(name, pickle.dumps([[person]] * frames))
    else:

        def make(folder: Path) -> Path:
            by_frame = {key: value if frames == 1 else np.stack([value] * frames) for key, value in person.items()}
            np.savez(folder / name, allow_pickle=False, **by_frame)
            return folder / name

    return Case(make, read_motion, "has no 'focal_length' .pixels.* Add it")


def of_json(text: str, says: str) -> Case:
    """A JSON of anything."""
    return Case(content("sam.json", text), read_motion, says)


PER_IMAGE: dict[str, Case] = {
    "sam of 44 points": of_sam(
        r"'pred_keypoints_3d' has the shape \(44, 3\), expected 210", pred_keypoints_3d=np.zeros((44, 3))
    ),
    "sam NaN": of_sam("'pred_keypoints_3d' holds nan", pred_keypoints_3d=np.full((70, 3), np.nan)),
    "sam at no focal length": of_sam("'focal_length' holds 0, expected numbers above 0", focal_length=0.0),
    "sam of one image without a focal length": without_focal("sam.npz", 1),
    "sam of a person without a focal length": without_focal("sam.npz", 2),
    "sam of people without a focal length": without_focal("sam.pkl", 2),
    "sam behind the camera": of_sam("'pred_cam_t' holds -3", pred_cam_t=np.array([0, 0, -3.0])),
    "sam with a text": of_sam("'pred_cam_t' ", pred_cam_t="here"),
    "sam asks for code": of_sam("asks for .*could run code", mask=Bomb()),
    "json cut off": of_json('[[{"pred_cam_t": [0', "is not JSON"),
    "json nested": of_json("[" * 10**5, "is not JSON"),
    "json of another": of_json(json.dumps({"people": [1]}), "holds a dict of people, no result of GVHMR"),
    "json of lists without end": of_json(
        json.dumps([[{"pred_keypoints_3d": [[]] * 70, "pred_cam_t": [[[[1]]]], "focal_length": 1}]]), "pred_"
    ),
}
