"""Which parts of the body the keypoints of a frame show. Unseen parts are drawn faded in every view."""

import numpy as np
from jaxtyping import Bool, Float, UInt8

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINTS
from fitting_core.keypoints import SIDES
from tcfit_app.analysis.body_regions import REGIONS

FAINT = 0.4
"""Opacity of what is not seen, relative to what is."""
_TRUNK = tuple(kp.INDEX[f"{side}_{end}"] for side in SIDES for end in ("shoulder", "hip"))
_HEAD = (*REGIONS["head"], *REGIONS["face"])
_ENDS = {"collar": "shoulder", "shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle"}
"""By joint of a limb, the keypoint at the other end of what the joint moves."""


def _shown_by(joint: str) -> tuple[int, ...]:
    """The keypoints any of which shows where that is which a joint moves."""
    side, _, part = joint.rpartition("_")
    if part in _ENDS:
        return (kp.INDEX[f"{side}_{_ENDS[part]}"],)
    if part in ("ankle", "foot"):
        return REGIONS[f"{side} foot"]
    if joint in ("neck", "head", "jaw") or part == "eye":
        return _HEAD
    return REGIONS[f"{side} hand"] if side else _TRUNK


_SHOWN_BY = np.zeros((len(JOINTS), kp.COUNT), np.float32)
for _i, _joint in enumerate(JOINTS):
    _SHOWN_BY[_i, list(_shown_by(_joint))] = 1


def evident(keypoints: kp.Keypoints) -> Bool[np.ndarray, "T 137"]:
    """Which keypoints show their part of the body: those that count, and those of hands with a given shape."""
    return (keypoints.confidence > 0) | keypoints.overruled


def seen_joints(present: Bool[np.ndarray, "*T 137"]) -> Bool[np.ndarray, "*T 55"]:
    """Whether what each joint of the body model moves is seen: the forearm, for an elbow.

    Args:
        present: See `evident`.
    """
    return present.astype(np.float32) @ _SHOWN_BY.T > 0


def unseen_keypoints(present: Bool[np.ndarray, "137"]) -> tuple[int, ...]:
    """The BODY_25 keypoints that are not seen. Neck and mid hip, which many detectors lack, go with the trunk."""
    seen = present[kp.BODY].copy()
    seen[[kp.INDEX["neck"], kp.INDEX["mid_hip"]]] |= present[list(_TRUNK)].any()
    return tuple(np.flatnonzero(~seen).tolist())


def opacities(weights: Float[np.ndarray, "V 55"], seen: Bool[np.ndarray, "55"]) -> UInt8[np.ndarray, "V"]:
    """The opacity of each vertex by its skinning weights, relative to that of what is seen: 0 to 255."""
    return np.round(255 * (FAINT + (1 - FAINT) * np.clip(weights @ seen, 0, 1))).astype(np.uint8)
