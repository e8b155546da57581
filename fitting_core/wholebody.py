"""The 133 points of COCO-WholeBody (Jin et al., ECCV 2020), and how they become our 137 and back."""

import numpy as np
from jaxtyping import Float

from fitting_core.keypoints import COUNT, FACE, HAND_21, INDEX, LEFT_HAND, NAMES, RIGHT_HAND

COCO_17 = (
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow left_wrist "
    "right_wrist left_hip right_hip left_knee right_knee left_ankle right_ankle"
).split()
FEET_6 = "left_big_toe left_small_toe left_heel right_big_toe right_small_toe right_heel".split()
WHOLEBODY_COUNT = 133

BODY_17, FEET, FACE_68 = slice(0, 17), slice(17, 23), slice(23, 91)
LEFT_HAND_21, RIGHT_HAND_21 = slice(91, 112), slice(112, 133)

_FACE = range(FACE.start, FACE.start + 68)
PLACES: tuple[int, ...] = (
    *(INDEX[name] for name in (*COCO_17, *FEET_6)),
    *_FACE,
    *range(LEFT_HAND.start, LEFT_HAND.stop),
    *range(RIGHT_HAND.start, RIGHT_HAND.stop),
)
"""Of each of the 133 points, in their order, its place among our 137.

Face and hands are in the same order in both: 68 points as of iBUG 300-W, the person's right side first; hands wrist
first, then thumb to little finger.
"""
FACE_MESH = (
    127, 234, 132, 58, 172, 150, 149, 148, 152, 377, 378, 379, 397, 288, 361, 454, 356,  # contour
    70, 63, 105, 66, 107, 336, 296, 334, 293, 300,  # brows
    168, 197, 5, 4, 98, 97, 2, 326, 327,  # nose
    33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380,  # lids
    61, 40, 37, 0, 267, 270, 291, 321, 314, 17, 84, 91,  # outer lips
    78, 81, 13, 311, 308, 402, 14, 178,  # inner lips
    468, 473,  # pupils
)  # fmt: skip
"""The nearest of MediaPipe's 478 points for each of our 70 face points; only its refined mesh has pupils.

Chosen by eye on pictures of both; all pairs mirror each other. Contour points, from the person's right, lie on the
mesh's outline, where a 68-point detector sees the jaw.
"""
MEANS: dict[str, tuple[str, str]] = {"neck": ("left_shoulder", "right_shoulder"), "mid_hip": ("left_hip", "right_hip")}
"""Points of BODY_25 that are taken to lie between two others."""
ABSENT = ("face_right_pupil", "face_left_pupil")
"""Points of the 137 that COCO-WholeBody does not have."""
WHOLEBODY_NAMES: tuple[str, ...] = tuple(NAMES[place] for place in PLACES)
"""Of the 133 points, by our names."""

assert len(PLACES) == len(set(PLACES)) == WHOLEBODY_COUNT and len(HAND_21) == 21
assert set(range(COUNT)) - set(PLACES) == {INDEX[name] for name in (*MEANS, *ABSENT)}


def from_wholebody(points: Float[np.ndarray, "*p 133 3"]) -> Float[np.ndarray, "*p 137 3"]:
    """Our 137 points; x, y and confidence, in the unit of the positions.

    Neck and mid-hip are the mean of shoulders and hips with the smaller of both confidences, and are not detected where
    one of both is not. Pupils are never detected. A point of confidence 0 becomes (0, 0, 0).
    """
    found = np.zeros((*points.shape[:-2], COUNT, 3))
    found[..., PLACES, :] = points * (points[..., 2:] > 0)
    return with_means(found)


def to_wholebody(points: Float[np.ndarray, "*p 137 3"]) -> Float[np.ndarray, "*p 133 3"]:
    """The 133 of our 137 points: neck, mid-hip and pupils are left out."""
    return points[..., PLACES, :] * (points[..., PLACES, 2:] > 0)


def with_means(points: Float[np.ndarray, "*p 137 3"]) -> Float[np.ndarray, "*p 137 3"]:
    """The same points, with those of MEANS made of the two beside them."""
    points = points.copy()
    for name, pair in MEANS.items():
        sides = points[..., [INDEX[side] for side in pair], :]
        confidence = sides[..., 2].min(-1)
        mean = np.concatenate([sides[..., :2].mean(-2), confidence[..., None]], -1)
        points[..., INDEX[name], :] = mean * (confidence > 0)[..., None]
    return points
