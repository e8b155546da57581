"""How far off keypoints are, by who detected them, and what each of them weighs for it."""

import numpy as np
from jaxtyping import Float

from fitting_core.keypoints import FACE, HANDS, NAMES

OPENPOSE, MEDIAPIPE, COCO_WHOLEBODY = "openpose", "mediapipe", "coco-wholebody"
DETECTORS = {OPENPOSE: "OpenPose", MEDIAPIPE: "MediaPipe", COCO_WHOLEBODY: "COCO-WholeBody"}
"""Whose keypoints are told apart, and how they are called."""

NOISE: dict[str, dict[str, float]] = {
    OPENPOSE: {
        "nose": 8.0, "eye": 8.0, "ear": 8.0, "neck": 8.0, "shoulder": 10.0, "elbow": 14.0, "wrist": 10.0, "hip": 26.0,
        "mid_hip": 20.0, "knee": 15.0, "ankle": 13.0, "heel": 12.0, "big_toe": 18.0, "small_toe": 15.0, "hand": 8.0, "face": 4.0,
    },
    MEDIAPIPE: {
        "nose": 25.0, "eye": 20.0, "ear": 30.0, "neck": 12.0, "shoulder": 16.0, "elbow": 20.0, "wrist": 20.0,
        "hip": 33.0, "mid_hip": 20.0, "knee": 26.0, "ankle": 18.0, "heel": 23.0, "big_toe": 30.0, "small_toe": 26.0,
        "hand": 8.0, "face": 4.0,
    },
    COCO_WHOLEBODY: {},
}  # fmt: skip
NOISE[COCO_WHOLEBODY] = dict(NOISE[OPENPOSE])


def part(keypoint: int) -> str:
    """The row of NOISE that a keypoint belongs to."""
    if keypoint >= FACE.start:
        return "face"
    if keypoint >= HANDS.start:
        return "hand"
    name = NAMES[keypoint]
    return next(known for known in ("mid_hip", "big_toe", "small_toe", name.rpartition("_")[2]) if name.endswith(known))


def deviations(detector: str) -> Float[np.ndarray, "137"]:
    """Standard deviation of each keypoint along x or y, as it is on the body, in millimetres."""
    return np.array([NOISE[detector][part(keypoint)] for keypoint in range(len(NAMES))])


def known_detector(told: str) -> str:
    """The name in DETECTORS that a file or a clip means; OpenPose where it tells none, or one that nobody measured."""
    return told if told in DETECTORS else OPENPOSE


def keypoint_weights(noise: str, detector: str) -> Float[np.ndarray, "137"]:
    """What each keypoint weighs for its noise, against one of OpenPose's that is equally confident.

    Args:
        noise: `FitConfig.keypoint_noise`: whose noise the keypoints have; "auto" for the clip's own detector, "equal"
            for keypoints that all weigh the same.
        detector: `Clip.detector`.
    """
    if noise == "equal":
        return np.ones(len(NAMES))
    return deviations(OPENPOSE) / deviations(known_detector(detector) if noise == "auto" else noise)
