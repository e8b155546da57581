"""Malformed results of systems that write each image by itself: SMPLer-X, Multi-HMR and SAM 3D Body."""

import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.io import read_motion
from tests.fitting_core.io.malformed import Bomb, Case, content
from tests.fitting_core.io.motion.learned_files import truth
from tests.fitting_core.io.motion.per_image_files import smplerx

_TRUTH = (truth(), np.arange(5))


def of_smplerx(says: str, break_it: Callable[[Path], Any] = lambda folder: None, **changed: Any) -> Case:
    """SMPLer-X's folder with other values, or with something done to it."""

    def make(folder: Path) -> Path:
        path = smplerx(folder / "walk", {0: _TRUTH}, **changed)
        break_it(path)
        return path

    return Case(make, read_motion, says)


def _with_objects(folder: Path) -> None:
    np.savez(folder / "smplx" / "00001_0.npz", allow_pickle=True, transl=np.array([Bomb()], dtype=object))


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


def of_meshes(says: str, value: float) -> Case:
    """Multi-HMR's meshes of one image, with one number of this value."""

    def make(folder: Path) -> Path:
        meshes = np.ones((1, 10475, 3), np.float32)
        meshes[0, 7, 1] = value
        np.save(folder / "a.npy", meshes)
        return folder / "a.npy"

    return Case(make, read_motion, says)


def _cut_meshes(folder: Path) -> Path:
    np.save(folder / "a.npy", np.ones((1, 10475, 3), np.float32))
    (folder / "a.npy").write_bytes((folder / "a.npy").read_bytes()[:-50])
    return folder / "a.npy"


PER_IMAGE: dict[str, Case] = {
    "smplerx without cameras": of_smplerx(
        "has smplx/00003_0.npz but no meta/00003_0.json", lambda f: (f / "meta" / "00003_0.json").unlink()
    ),
    "smplerx with a cut camera": of_smplerx(
        "is not JSON", lambda f: (f / "meta" / "00002_0.json").write_text('{"focal": [1')
    ),
    "smplerx with a camera of a list": of_smplerx(
        "meta/00002_0.json is a list, expected a dictionary", lambda f: (f / "meta" / "00002_0.json").write_text("[1]")
    ),
    "smplerx asks for code": of_smplerx("smplx/00001_0.npz", _with_objects),
    "smplerx cut off": of_smplerx(
        "smplx/00001_0.npz", lambda f: (f / "smplx" / "00001_0.npz").write_bytes(b"PK\x03\x04abc")
    ),
    "smplerx of 20 joints": of_smplerx(
        r"'body_pose' has the shape \(20, 3\), expected 63", values={"body_pose": np.zeros((20, 3))}
    ),
    "smplerx NaN": of_smplerx("'transl' holds nan", values={"transl": np.full((1, 3), np.nan)}),
    "smplerx behind the camera": of_smplerx("'transl' holds -2", values={"transl": np.array([[0, 0, -2.0]])}),
    "smplerx at no focal length": of_smplerx("'focal' holds 0, expected numbers above 0", meta={"focal": [0, 0]}),
    "smplerx with a text for a centre": of_smplerx("'princpt' ", meta={"princpt": "ab"}),
    "smplerx of nobody": of_smplerx("with nobody in it", lambda f: [file.unlink() for file in (f / "smplx").iterdir()]),
    "multi-hmr NaN": of_meshes("'a' holds nan, expected finite", np.nan),
    "multi-hmr huge": of_meshes("'a' holds .*, expected finite", 1e30),
    "multi-hmr cut off": Case(_cut_meshes, read_motion, "is not a readable result of a fit|cut off|damaged"),
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
