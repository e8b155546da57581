"""Which detections to take at their word: what detectors make up where a person is cut off by the image."""

import numpy as np
from jaxtyping import Int

from fitting_core import keypoints as kp
from fitting_core.keypoints import Keypoints

BORDER = 0.015
"""Share of the image height: a detection nearer to the border is one of a part that lies beyond it."""
LONE_HIP = 0.5
"""Confidence that a hip needs where its knee is not seen."""
SEEN = 0.2
"""Confidence from which a keypoint counts as seen, where a yes or no is needed."""


def cut_off(keypoints: Keypoints, size: tuple[int, int]) -> Int[np.ndarray, "T 137 2"]:
    """Along which axes a detection says no more than that the part lies at least so far out: -1, 0 or 1 for x and y.

    OpenPose puts parts that the image cuts off onto its border, and the hips of half-body footage near its bottom, at
    confidences of 0.2 to 0.5 (seen on sign-language clips: wrists in the lap at 3 px from the border, hips 40 px too
    high). Taken at their word they pull the body together; left out, the unseen forearm swings at the camera.

    Args:
        keypoints: the detections.
        size: image width and height in pixels.

    Returns:
        1: the part lies there or at a larger coordinate; -1: there or at a smaller one; 0: just there.
    """
    last = np.array(size) - 1
    margin = BORDER * size[1]
    side = (keypoints.xy > last - margin).astype(np.int8) - (keypoints.xy < margin).astype(np.int8)
    seen = (keypoints.confidence > SEEN) & (side == 0).all(-1)
    hips = [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]
    knees = [kp.INDEX["left_knee"], kp.INDEX["right_knee"]]
    alone = ~seen[:, knees] & (keypoints.confidence[:, hips] < LONE_HIP)
    side[:, hips, 1] = np.where(alone, 1, side[:, hips, 1])
    no_leg = alone.all(1)
    side[no_leg, kp.INDEX["mid_hip"], 1] = 1
    side[keypoints.confidence == 0] = 0
    return side
