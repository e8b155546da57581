"""Body regions in reviewers' words, and keypoint names in words."""

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
"""Every keypoint is in exactly one region."""
REGION_OF: dict[int, str] = {joint: region for region, joints in REGIONS.items() for joint in joints}
_LIMBS = {
    f"{side} {end}": f"{side} {limb}" for side in ("left", "right") for end, limb in (("hand", "arm"), ("foot", "leg"))
}
LIMB_OF: dict[int, str] = {
    joint: (_LIMBS | {"face": "head"}).get(region, region) for joint, region in REGION_OF.items()
}
"""The same with hands and feet as parts of their limb, and the face as part of the head."""
_KEYPOINT_NAMES = {
    **{f"{side}_collar": f"{side}_shoulder" for side in ("left", "right")},
    **{f"{side}_foot": f"{side}_big_toe" for side in ("left", "right")},
    **{"pelvis": "mid_hip", "spine3": "neck", "head": "nose", "jaw": "nose"},
}
KEYPOINT_OF_JOINT: tuple[int | None, ...] = tuple(kp.INDEX.get(_KEYPOINT_NAMES.get(name, name)) for name in JOINTS)
"""For each SMPL-X joint the keypoint at it, or nearest to it on the same part; None for spine1 and spine2."""


def full_name(joint: int) -> str:
    """A keypoint's unique name in words: "left wrist", "left hand's wrist", "right thumb tip", "face outer lip 3"."""
    name = kp.NAMES[joint]
    if joint in (kp.LEFT_HAND.start, kp.RIGHT_HAND.start):
        return f"{name.partition('_')[0]} hand's wrist"
    if joint < kp.FACE.start:
        name = name.replace("4", "_tip")  # of a finger
    return re.sub(r"(?<=\D)(?=\d)", " ", name).replace("_", " ")


def spoken(joint: int) -> str:
    """The same in a sentence, where a point of the face has no number: "outer lip"."""
    name = full_name(joint)
    return name if joint < kp.FACE.start else name.removeprefix("face ").rstrip(" 0123456789")


def spoken_bone(joint: int) -> str:
    """An SMPL-X joint in words."""
    return re.sub(r"(?<=\D)(?=\d)", " ", JOINTS[joint]).replace("_", " ")
