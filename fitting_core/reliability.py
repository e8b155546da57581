"""Which detections to trust: what detectors are known to make up where a person is cut off by the image."""

import numpy as np
from jaxtyping import Bool, Float

from fitting_core import keypoints as kp
from fitting_core.keypoints import Keypoints

BORDER = 0.015
"""Share of the image height: a detection nearer to the border is one of a part that lies beyond it."""
LONE_HIP = 0.5
"""Confidence that a hip needs where its knee is not seen."""
SEEN = 0.2
"""Confidence from which a keypoint counts as seen, where a yes or no is needed."""


def trusted_confidence(keypoints: Keypoints, size: tuple[int, int]) -> Float[np.ndarray, "T 137"]:
    """The confidences, with 0 where a detection is known to be none.

    OpenPose puts parts that the image cuts off onto its border, and hips of half-body footage near its bottom, at
    confidences of 0.2 to 0.5 (seen on sign-language clips: wrists in the lap at 3 px from the border, hips 40 px too
    high). They pull the body together, and no robust function sees them as outliers.

    Args:
        keypoints: the detections.
        size: image width and height in pixels.
    """
    width, height = size
    margin = BORDER * height
    x, y = keypoints.xy[..., 0], keypoints.xy[..., 1]
    beyond = (x < margin) | (x > width - 1 - margin) | (y < margin) | (y > height - 1 - margin)
    confidence = np.where(beyond, 0.0, keypoints.confidence)
    for side in ("left", "right"):
        hip, knee = kp.INDEX[f"{side}_hip"], kp.INDEX[f"{side}_knee"]
        alone = (confidence[:, knee] <= SEEN) & (confidence[:, hip] < LONE_HIP)
        confidence[alone, hip] = 0.0
    no_hip = (confidence[:, [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]] == 0).all(1)
    confidence[no_hip, kp.INDEX["mid_hip"]] = 0.0
    return confidence


def distrusted(keypoints: Keypoints, size: tuple[int, int]) -> Bool[np.ndarray, "T 137"]:
    """Detections that `trusted_confidence` switches off."""
    return (keypoints.confidence > 0) & (trusted_confidence(keypoints, size) == 0)
