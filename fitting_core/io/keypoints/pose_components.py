"""Which of our 137 keypoints the points of `.pose` files are: OpenPose, MediaPipe Holistic, COCO-WholeBody."""

from collections.abc import Sequence

from fitting_core.io.keypoints.coco_wholebody_layout import COCO_17, FEET_6
from fitting_core.io.keypoints.pose_binary import Component
from fitting_core.keypoints import BODY_25, BONES, FACE, GROUPS, INDEX, LEFT_HAND, RIGHT_HAND

_SHORT = {"right_": "R", "left_": "L"}


def _camel(name: str) -> str:
    """OpenPose's own way to write a name: left_big_toe is LBigToe."""
    for side, letter in _SHORT.items():
        if name.startswith(side):
            return letter + _camel(name.removeprefix(side))
    return "".join(word.capitalize() for word in name.split("_"))


_OPENPOSE_BODY = tuple(_camel(name) for name in BODY_25)
_OPENPOSE_HAND = (
    "BASE T_STT T_BCMC T_MCP T_IP I_CMC I_MCP I_PIP I_DIP M_CMC M_MCP M_PIP M_DIP R_CMC R_MCP R_PIP R_DIP "
    "P_CMC P_MCP P_PIP P_DIP"
).split()
"""pose-format's names of OpenPose's points; whatever they say, the last of each finger is its tip."""
_OPENPOSE_FACE = (
    [f"FB_{i}" for i in range(17)]
    + [f"FEB_{i}" for i in range(17, 27)]
    + [f"FN_{i}" for i in range(27, 36)]
    + [f"FE_{i}" for i in range(36, 48)]
    + [f"FLO_{i}" for i in range(48, 60)]
    + [f"FLI_{i}" for i in range(60, 68)]
    + ["FP_68", "FP_69"]
)
_FINGERS = {"INDEX_FINGER": "index", "MIDDLE_FINGER": "middle", "RING_FINGER": "ring", "PINKY": "pinky"}
_MEDIAPIPE_HAND = [
    "WRIST",
    *(f"THUMB_{part}" for part in ("CMC", "MCP", "IP", "TIP")),
    *(f"{finger}_{part}" for finger in _FINGERS for part in ("MCP", "PIP", "DIP", "TIP")),
]
# fmt: off
_MEDIAPIPE_BODY = {
    "NOSE": "nose",
    **{f"{side}_{part}": f"{side}_{part}".lower()
       for side in ("LEFT", "RIGHT")
       for part in ("EYE", "EAR", "SHOULDER", "ELBOW", "WRIST", "HIP", "KNEE", "ANKLE", "HEEL")},
    "LEFT_FOOT_INDEX": "left_big_toe", "RIGHT_FOOT_INDEX": "right_big_toe",
}
"""The others (corners of eyes and mouth, fingers of the body's model) have no place among ours, or a better one."""
_FACE_MESH = (
    127, 234, 132, 58, 172, 150, 149, 148, 152, 377, 378, 379, 397, 288, 361, 454, 356,
    70, 63, 105, 66, 107, 336, 296, 334, 293, 300,
    168, 197, 5, 4, 98, 97, 2, 326, 327,
    33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380,
    61, 40, 37, 0, 267, 270, 291, 321, 314, 17, 84, 91,
    78, 81, 13, 311, 308, 402, 14, 178,
    468, 473,
)
"""Of each of our 70 points of the face, the nearest of MediaPipe's 478; the pupils are of its refined mesh only.

All pairs mirror each other. The contour's lie on the mesh's outline, where a detector of 68 points sees the jaw.
"""
# fmt: on
_FACE_70 = range(FACE.start, FACE.stop)


def _hand(side: slice, names: Sequence[str]) -> dict[str, int]:
    return dict(zip(names, range(side.start, side.stop), strict=True))


_COCO_HAND = [f"hand_{i}" for i in range(21)]

COMPONENTS: dict[str, dict[str, int]] = {
    "pose_keypoints_2d": {name: i for i, name in enumerate(_OPENPOSE_BODY)},
    "face_keypoints_2d": dict(zip(_OPENPOSE_FACE, _FACE_70, strict=True)),
    "hand_left_keypoints_2d": _hand(LEFT_HAND, _OPENPOSE_HAND),
    "hand_right_keypoints_2d": _hand(RIGHT_HAND, _OPENPOSE_HAND),
    "POSE_LANDMARKS": {name: INDEX[ours] for name, ours in _MEDIAPIPE_BODY.items()},
    "FACE_LANDMARKS": {str(point): place for point, place in zip(_FACE_MESH, _FACE_70, strict=True)},
    "LEFT_HAND_LANDMARKS": _hand(LEFT_HAND, _MEDIAPIPE_HAND),
    "RIGHT_HAND_LANDMARKS": _hand(RIGHT_HAND, _MEDIAPIPE_HAND),
    "BODY": {name: INDEX[name] for name in (*COCO_17, *FEET_6)},
    "FACE": {f"face-{i}": FACE.start + i for i in range(68)},
    "LEFT_HAND": _hand(LEFT_HAND, _COCO_HAND),
    "RIGHT_HAND": _hand(RIGHT_HAND, _COCO_HAND),
}
"""By a component's name: our place of each of its points, by the point's name."""
BODIES = {
    "pose_keypoints_2d": "OpenPose",
    "POSE_LANDMARKS": "MediaPipe Holistic",
    "BODY": "COCO-WholeBody",
}
"""By the body's component: whose points the file has."""
WITH_MEANS = ("POSE_LANDMARKS", "BODY")
"""Bodies without neck and mid-hip, which are made of shoulders and hips."""

_WRITTEN = {
    "pose_keypoints_2d": ("body", (255, 0, 0)),
    "face_keypoints_2d": ("face", (128, 0, 0)),
    "hand_left_keypoints_2d": ("left_hand", (0, 128, 0)),
    "hand_right_keypoints_2d": ("right_hand", (0, 0, 192)),
}


def openpose_components() -> tuple[tuple[Component, ...], tuple[int, ...]]:
    """The four components that pose-format has for OpenPose, and our place of each of their points, in order."""
    components, places = [], []
    for name, (group, color) in _WRITTEN.items():
        part, points = GROUPS[group], COMPONENTS[name]
        inside = range(part.start, part.stop)
        assert list(points.values()) == list(inside)
        limbs = tuple((a - part.start, b - part.start) for a, b in BONES if a in inside and b in inside)
        components.append(Component(name=name, points=tuple(points), limbs=limbs, colors=(color,)))
        places += inside
    return tuple(components), tuple(places)
