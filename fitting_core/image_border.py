"""Keypoints of parts that the image's border cuts off, which detectors place on the border."""

import numpy as np
from jaxtyping import Float, Int

from fitting_core import keypoints as kp
from fitting_core.camera import Camera
from fitting_core.keypoints import SEEN, Keypoints
from fitting_core.lens import filmed

BORDER = 0.015
"""Share of the image height: a detection nearer to the border is one of a part that lies beyond it."""
LONE_HIP = 0.5
"""Confidence that a hip needs where its knee is not seen."""


def seen_confidence(keypoints: Keypoints, camera: Camera) -> Float[np.ndarray, "T 137"]:
    """Confidences, and 0 of what the image cuts off: detectors put it onto the border.

    Args:
        keypoints: the detections.
        camera: of the clip.
    """
    return np.where((cut_off(keypoints, camera) != 0).any(-1), 0.0, keypoints.confidence)


def cut_off(keypoints: Keypoints, camera: Camera) -> Int[np.ndarray, "T 137 2"]:
    """Along which axes a detection says no more than that the part lies at least so far out: -1, 0 or 1 for x and y.

    OpenPose puts parts that the image cuts off onto its border, and the hips of half-body footage near its bottom, at
    confidences of 0.2 to 0.5 (seen on sign-language clips: wrists in the lap at 3 px from the border, hips 40 px too
    high). Taken at their word they pull the body together; left out, the unseen forearm swings at the camera.

    Args:
        keypoints: the detections.
        camera: of the clip. The border is that of its image as it was filmed.

    Returns:
        1: the part lies there or at a larger coordinate; -1: there or at a smaller one; 0: just there.
    """
    last = np.array(camera.size) - 1
    margin = BORDER * camera.size[1]
    xy = keypoints.xy if camera.lens is None else filmed(camera.lens, keypoints.xy)
    side = (xy > last - margin).astype(np.int8) - (xy < margin).astype(np.int8)
    seen = (keypoints.confidence > SEEN) & (side == 0).all(-1)
    hips = [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]
    knees = [kp.INDEX["left_knee"], kp.INDEX["right_knee"]]
    alone = ~seen[:, knees] & (keypoints.confidence[:, hips] < LONE_HIP)
    side[:, hips, 1] = np.where(alone, 1, side[:, hips, 1])
    no_leg = alone.all(1)
    side[no_leg, kp.INDEX["mid_hip"], 1] = 1
    side[(keypoints.confidence == 0) | keypoints.placed] = 0
    return side
