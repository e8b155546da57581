"""Results as SAM 3D Body gives them, of known poses."""

from typing import Any

import numpy as np

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera

CAMERA = Camera(focal=(800.0, 800.0), center=(320.0, 240.0), size=(640, 480))


SAM_PLACES = {
    "right_elbow": 8, "left_ankle": 13, "right_heel": 20, "right_thumb4": 21, "right_thumb1": 24, "left_index4": 46,
    "left_pinky1": 61, "left_wrist": 62, "neck": 69,
}  # fmt: skip
"""Some of mhr70's places, as its list has them."""


def sam_people(body: BodyModel, params: BodyParams, *, focal: float = 800.0, **changed: Any) -> list[dict[str, Any]]:
    """Of each frame what `process_one_image` gives of this person; MHR's own points are far from what is known."""
    from fitting_core.io.motion.learned.per_image import _NAMES

    points, _ = keypoints_in_space(body, params)
    found = []
    for t, place in enumerate(params.camera_translation.numpy()):
        own = np.full((70, 3), 5.0)
        for number, name in _NAMES.items():
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
