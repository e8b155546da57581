"""How far off keypoints are, by who detected them, and what each of them weighs for it.

What was measured (`python -m benchmarks.keypoint_noise` has every figure by clip):

- OpenPose, BODY_25: 100 frames of one man in two calibrated views, 4200 keypoints, against points triangulated from
  its own keypoints in two to four views. These fit it too well, by the three numbers that each point in space has taken
  from those of its views, which is corrected for.
- MediaPipe, heavy body network, image and mirror image averaged: the same two clips where OpenPose is sure as well
  (4160 keypoints), without OpenPose's share in the reference; and joint centres of markers of a phone video, through a
  camera that was found for it (807 frames, 9650 keypoints). Hips are the markers' alone: on the other clips nearly all
  that is off there is the reference's. A second phone video, kept apart, has 16 to 25 mm for all limbs.
- COCO-WholeBody: nothing, since there is neither a model nor data here. It has how far annotators of COCO and
  COCO-WholeBody differ (the sigmas of the published evaluations, means over sides and groups), times the factor that
  brings their median over the limbs to OpenPose's: 189 mm.

Not measured, and taken as OpenPose's: MediaPipe's nose and eyes (17 eyes that both see: 10.0 and 9.7 mm), hands and
face. OpenPose's own nose and eyes are taken as its ears, its hands and face as annotators differ.
"""

import numpy as np
from jaxtyping import Float

from fitting_core.keypoints import FACE, HANDS, NAMES

OPENPOSE, MEDIAPIPE, COCO_WHOLEBODY = "openpose", "mediapipe", "coco-wholebody"
DETECTOR_TITLES = {OPENPOSE: "OpenPose", MEDIAPIPE: "MediaPipe", COCO_WHOLEBODY: "COCO-WholeBody"}
"""Detectors with measured noise, and their titles."""

NOISE: dict[str, dict[str, float]] = {
    OPENPOSE: {
        "nose": 9.0, "eye": 9.0, "ear": 9.0, "neck": 8.0, "shoulder": 10.0, "elbow": 16.0, "wrist": 11.0,
        "mid_hip": 22.0, "hip": 41.0, "knee": 17.0, "ankle": 14.0, "heel": 13.0, "toe": 22.0, "hand": 5.0, "face": 3.2,
    },
    MEDIAPIPE: {
        "nose": 9.0, "eye": 9.0, "ear": 22.0, "neck": 12.0, "shoulder": 16.0, "elbow": 16.0, "wrist": 21.0,
        "mid_hip": 15.0, "hip": 18.0, "knee": 21.0, "ankle": 10.0, "heel": 21.0, "toe": 27.0, "hand": 5.0, "face": 3.2,
    },
    COCO_WHOLEBODY: {
        "nose": 4.9, "eye": 4.7, "ear": 6.6, "neck": 10.6, "shoulder": 14.9, "elbow": 13.6, "wrist": 11.7,
        "mid_hip": 14.3, "hip": 20.2, "knee": 16.4, "ankle": 16.8, "heel": 15.1, "toe": 15.1, "hand": 5.0, "face": 3.2,
    },
}  # fmt: skip
"""Standard deviation along x or y of a confident keypoint as it is on the body, in millimetres, by part."""


def part(keypoint: int) -> str:
    """The row of NOISE that a keypoint belongs to."""
    if keypoint >= FACE.start:
        return "face"
    if keypoint >= HANDS.start:
        return "hand"
    name = NAMES[keypoint]
    return name if name == "mid_hip" else name.rpartition("_")[2]


def noise_deviations(detector: str) -> Float[np.ndarray, "137"]:
    """Standard deviation of each keypoint of a detector, as in NOISE."""
    return np.array([NOISE[detector][part(keypoint)] for keypoint in range(len(NAMES))])


def keypoint_weights(noise: str, detector: str) -> Float[np.ndarray, "137"]:
    """What each keypoint weighs for its noise, against one of OpenPose's that is equally confident.

    It is the square root of how much more exact OpenPose's is, and 1 where that is the noisier one: errors last over
    many frames and are shared by neighbours, which a deviation does not tell, and all other terms were settled with
    OpenPose's at 1.

    Args:
        noise: `FitConfig.keypoint_noise`: whose noise the keypoints have; "auto" for the clip's own detector, "equal"
            for keypoints that all weigh the same.
        detector: `Clip.detector`; counts as OpenPose where it is unknown, or one that was not measured.
    """
    if noise == "equal":
        return np.ones(len(NAMES))
    row = detector if noise == "auto" else noise
    own = noise_deviations(row if row in DETECTOR_TITLES else OPENPOSE)
    return np.sqrt(np.minimum(1.0, noise_deviations(OPENPOSE) / own))
