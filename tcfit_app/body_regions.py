"""Parts of the body as a reviewer calls them, and the names of keypoints in words."""

import re

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINTS

_BODY_REGIONS = {
    **{f"{side} arm": [f"{side}_{n}" for n in ("shoulder", "elbow", "wrist")] for side in ("left", "right")},
    **{f"{side} leg": [f"{side}_{n}" for n in ("hip", "knee", "ankle")] for side in ("left", "right")},
    **{f"{side} foot": [f"{side}_{n}" for n in ("big_toe", "small_toe", "heel")] for side in ("left", "right")},
    "head": [name for name in kp.BODY_25 if name.partition("_")[2] in ("eye", "ear")] + ["nose"],
    "torso": ["neck", "mid_hip"],
}
REGIONS: dict[str, tuple[int, ...]] = {
    **{region: tuple(kp.INDEX[name] for name in names) for region, names in _BODY_REGIONS.items()},
    "left hand": tuple(range(kp.COUNT)[kp.LEFT_HAND]),
    "right hand": tuple(range(kp.COUNT)[kp.RIGHT_HAND]),
    "face": tuple(range(kp.COUNT)[kp.FACE]),
}
"""Every keypoint in one region."""
REGION_OF: dict[int, str] = {joint: region for region, joints in REGIONS.items() for joint in joints}
_KEYPOINT_NAMES = {"pelvis": "mid_hip", "head": "nose", "jaw": "nose", "left_collar": "left_shoulder"} | {
    "right_collar": "right_shoulder",
    "left_foot": "left_big_toe",
    "right_foot": "right_big_toe",
    "spine3": "neck",
}
KEYPOINT_OF_JOINT: tuple[int | None, ...] = tuple(kp.INDEX.get(_KEYPOINT_NAMES.get(name, name)) for name in JOINTS)
"""For each of SMPL-X's joints the keypoint at it or nearest to it on the same part; None for spine1 and spine2."""


def spoken(joint: int) -> str:
    """A keypoint in words: "left wrist", "left hand's wrist", "right index 2", "outer lip"."""
    name = kp.NAMES[joint].removeprefix("face_")
    if joint in (kp.LEFT_HAND.start, kp.RIGHT_HAND.start):
        return f"{name.partition('_')[0]} hand's wrist"
    pattern = r"\d+$" if joint >= kp.FACE.start else r"(?<=\D)(?=\d)"
    return re.sub(pattern, "" if joint >= kp.FACE.start else " ", name).replace("_", " ")


def spoken_bone(joint: int) -> str:
    """One of SMPL-X's joints in words."""
    return re.sub(r"(?<=\D)(?=\d)", " ", JOINTS[joint]).replace("_", " ")
