"""The joints of the free bodies along their limbs, and the former free bodies, which had them elsewhere.

Fits of before 2026-11-29 keep the body that they were made with: its shape, joints and keypoints. Only the pose
correctives of the skin about these joints are today's (less than 6 mm in a full turn).
"""

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

from fitting_core.body.files.reading import load_body
from fitting_core.body.model import JOINT, BodyModel, KeypointOffset
from fitting_core.shipped import FREE_FOLDER

_FORMER = {
    "b80a4e1a310670de6a96bd076779535d2b09b128d9b51c5383c9a9b3389d8503": "SMPLX_NEUTRAL.npz",
    "68a33223dd840cc2d45984290aefd7e2fd45f965cc19378e6a72c2266b0fd1d1": "SMPLX_MALE.npz",
    "ac8db1f424c5f2932d82cc867c87097b6205318d72ede735af379e3166e8a885": "SMPLX_FEMALE.npz",
    "6bfc26d914b32304f19b10a61b7f67a31af72169e8efc838dca405c00903ce5a": "SMPLX_CHILD.npz",
}
"""By the SHA-256 of the former file: the one of today."""
_FARTHER = {
    ("elbow", "shoulder"): 0.038,
    ("elbow", "wrist"): 0.072,
    ("hip", "knee"): 0.034,
    ("knee", "ankle"): -0.032,
}
"""By bone: how much farther from the first joint the second one lies than MakeHuman has it, as a share of the length.

There keypoints that were triangulated from four cameras lie, and there fits agree best with joint centres of markers
(evaluation/RESULTS/real_clips.md). Proportions become those of public skeletons of the SMPL family (thigh over shank
0.94, upper arm over forearm 1.04): 0.97 and 1.08, where MakeHuman's are 0.88 and 1.11.
"""
_KEYPOINTS = {
    ("collar", "shoulder"): (-0.010, 0.005, -0.003),
    ("elbow", "wrist"): (0.017, 0.0, 0.0),
    ("hip", "knee"): (-0.001, -0.013, -0.005),
    ("knee", "ankle"): (0.0, 0.014, 0.0),
}
"""By the joint that moves it and the former joint: from there to the keypoint on the left side, metres."""


def is_former(digest: str) -> bool:
    """Whether a former free body's file had this SHA-256."""
    return digest in _FORMER


def same_shapes(one: str, other: str) -> bool:
    """Whether betas mean the same shape on the bodies of these SHA-256: a free body and its former one share shapes."""
    return one == other or _free(one) == _free(other) != ""


def _free(digest: str) -> str:
    """The file name of a free body, former or of today; empty for others."""
    today = (name for name in _FORMER.values() if _digest(name) == digest)
    return _FORMER.get(digest) or next(today, "")


@lru_cache
def _digest(name: str) -> str:
    return hashlib.sha256((FREE_FOLDER / name).read_bytes()).hexdigest()


@lru_cache(maxsize=1)
def former_body(digest: str) -> BodyModel | None:
    """The body whose file had this SHA-256; None if it is not a former free one."""
    if digest not in _FORMER:
        return None
    body = load_body(FREE_FOLDER / _FORMER[digest])
    regressor = body.joint_regressor.copy()
    for start, end, share in bones_lengthened():  # a knee before the ankle below it
        regressor[end] = (regressor[end] + share * regressor[start]) / (1 + share)
    return replace(body, joint_regressor=regressor, keypoint_offsets=_offsets(), hash=digest)


def bones_lengthened() -> Iterator[tuple[int, int, float]]:
    """First and second joint, and how much farther the second one lies than MakeHuman has it, as a share."""
    for (start, end), share in _FARTHER.items():
        for side in ("left", "right"):
            yield JOINT[f"{side}_{start}"], JOINT[f"{side}_{end}"], share


def _offsets() -> dict[str, KeypointOffset]:
    return {
        f"{side}_{end}": KeypointOffset(joint=f"{side}_{end}", bone=f"{side}_{start}", offset=(sign * x, y, z))
        for (start, end), (x, y, z) in _KEYPOINTS.items()
        for side, sign in (("left", 1.0), ("right", -1.0))
    }
