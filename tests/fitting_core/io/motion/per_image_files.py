"""Results as SMPLer-X, Multi-HMR and SAM 3D Body write them, of known poses."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fitting_core import keypoints as kp
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera

CAMERA = Camera(focal=(800.0, 800.0), center=(320.0, 240.0), size=(640, 480))


def smplerx(folder: Path, people: dict[int, tuple[BodyParams, np.ndarray]], **changed: Any) -> Path:
    """smplx/00001_0.npz and meta/00001_0.json; people stand in the list of each image in turn one after the other.

    Crops have another size in each frame. Parameters are for CAMERA.
    """
    for name in ("smplx", "meta"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for t in sorted({int(n) for _, frames in people.values() for n in frames}):
        here = [(params, int(np.flatnonzero(frames == t)[0])) for params, frames in people.values() if t in frames]
        for place, (params, k) in enumerate(here[:: 1 if t % 2 else -1]):
            crop = np.array([300.0 + 5 * t, 400.0])
            center = np.array([310.0 + 3 * t, 250.0])
            focal = np.array([5000 / 192 * crop[0] * 4 / 5, 5000 / 192 * crop[0] * 4 / 5])
            x, y, z = params.camera_translation[k].numpy()
            far = z * focal[0] / CAMERA.focal[0]
            shown = np.array([x, y]) / z * CAMERA.focal + CAMERA.center
            values = {
                "global_orient": params.global_orient[k][None].numpy(),
                "body_pose": params.body_pose[k].view(-1, 3).numpy(),
                "left_hand_pose": params.left_hand_pose[k].view(-1, 3).numpy(),
                "right_hand_pose": params.right_hand_pose[k].view(-1, 3).numpy(),
                "jaw_pose": params.jaw_pose[k][None].numpy(),
                "leye_pose": np.zeros((1, 3)),
                "reye_pose": np.zeros((1, 3)),
                "betas": params.betas[k][None].numpy(),
                "expression": params.expression[k][None].numpy(),
                "transl": np.array([[*((shown - center) * far / focal), far]]),
            } | changed.get("values", {})
            meta = {"focal": focal.tolist(), "princpt": center.tolist(), "bbox_id": place} | changed.get("meta", {})
            np.savez(folder / "smplx" / f"{t:05}_{place}.npz", allow_pickle=False, **values)
            (folder / "meta" / f"{t:05}_{place}.json").write_text(json.dumps(meta))
    return folder


def multi_hmr(folder: Path, body: BodyModel, people: list[BodyParams]) -> Path:
    """An array of meshes for each image."""
    folder.mkdir(exist_ok=True)
    meshes = np.stack([Mesh(body, dtype=torch.float64)(params).numpy() for params in people], 1)
    for t, image in enumerate(meshes):
        np.save(folder / f"image{t + 3}.npy", image.astype(np.float32))
    return folder


SAM_PLACES = {
    "right_elbow": 8, "left_ankle": 13, "right_heel": 20, "right_thumb4": 21, "right_thumb1": 24, "left_index4": 46,
    "left_pinky1": 61, "left_wrist": 62, "neck": 69,
}  # fmt: skip
"""Some of mhr70's places, as its list has them."""


def sam_people(body: BodyModel, params: BodyParams, *, focal: float = 800.0, **changed: Any) -> list[dict[str, Any]]:
    """Of each frame what `process_one_image` gives of this person; MHR's own points are far from what is known."""
    from fitting_core.io.motion.learned.per_image import _SAM_NAMES

    points, _ = keypoints_in_space(body, params)
    found = []
    for t, place in enumerate(params.camera_translation.numpy()):
        own = np.full((70, 3), 5.0)
        for number, name in _SAM_NAMES.items():
            own[number] = points[t, kp.INDEX[name]] - place
        found.append(
            {
                "bbox": np.zeros(4, np.float32),
                "focal_length": np.float32(focal),
                "pred_keypoints_3d": own.astype(np.float32),
                "pred_keypoints_2d": np.zeros((70, 2), np.float32),
                "pred_vertices": np.zeros((18439, 3), np.float32),
                "pred_cam_t": (place * [1, 1, focal / 800]).astype(np.float32),
                "mask": None,
                **changed,
            }
        )
    return found
