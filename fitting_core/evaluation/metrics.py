"""How good and how smooth a fit is, as the field measures it."""

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.body.model import JOINT


def procrustes(source: Float[np.ndarray, "T K 3"], target: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T K 3"]:
    """`source` moved by the similarity (rotation, scale, translation) of each frame that is nearest to `target`.

    Least squares by singular values; S. Umeyama, PAMI 13(4), 1991.
    """
    mean_source, mean_target = source.mean(1, keepdims=True), target.mean(1, keepdims=True)
    a, b = source - mean_source, target - mean_target
    u, s, vt = np.linalg.svd(np.einsum("tki,tkj->tij", a, b))
    sign = np.ones_like(s)
    sign[:, 2] = np.sign(np.linalg.det(u @ vt))
    rotation = np.einsum("tij,tj,tjk->tik", u, sign, vt)
    scale = (s * sign).sum(1) / (a * a).sum((1, 2)).clip(1e-12)
    return scale[:, None, None] * (a @ rotation) + mean_target


def pa_mpjpe(estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T"]:
    """Mean joint error of each frame after Procrustes alignment, in millimetres (points in metres)."""
    return 1e3 * np.linalg.norm(procrustes(estimate, truth) - truth, axis=-1).mean(1)


def mpjpe(
    estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"], roots: list[int]
) -> Float[np.ndarray, "T"]:
    """Mean joint error of each frame with the mean of `roots` aligned, in millimetres (points in metres)."""
    difference = estimate - truth
    difference = difference - difference[:, roots].mean(1, keepdims=True)
    return 1e3 * np.linalg.norm(difference, axis=-1).mean(1)


def jitter(points: Float[np.ndarray, "T K 3"]) -> float:
    """Mean length of the second difference in time, in millimetres per frame^2 (points in metres)."""
    if len(points) < 3:
        return 0.0
    return float(1e3 * np.linalg.norm(np.diff(points, 2, axis=0), axis=-1).mean())


def reprojection_errors(
    projected: Float[np.ndarray, "T K 2"],
    detected: Float[np.ndarray, "T K 2"],
    counted: Bool[np.ndarray, "T K"],
) -> Float[np.ndarray, "N"]:
    """Distances in pixels between projected and detected keypoints, of those that count."""
    return np.linalg.norm(projected - detected, axis=-1)[counted]


def lean(up: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T"]:
    """Angle between a body's up axis and the image's vertical (y down), in degrees."""
    cosine = -up[:, 1] / np.linalg.norm(up, axis=-1)
    return np.degrees(np.arccos(cosine.clip(-1, 1)))


def torso_lean(joints: Float[np.ndarray, "T 55 3"]) -> Float[np.ndarray, "T"]:
    """Angle in degrees between the line from the middle of the hip joints to the neck joint and the image's vertical.

    Not the root's axis: a root may lean where the spine bends it back, and a straight root under a bent spine is no
    upright person.

    Args:
        joints: SMPL-X's joints in camera space (y down).
    """
    hips = joints[:, [JOINT["left_hip"], JOINT["right_hip"]]].mean(1)
    return lean(joints[:, JOINT["neck"]] - hips)


def wrists_in_front(joints: Float[np.ndarray, "T 55 3"]) -> Bool[np.ndarray, "T 2"]:
    """Whether the left and the right wrist are nearer to the camera than the chest (joint spine3).

    For people who face the camera and sign: hands inside or behind the trunk show a depth that the image did not hold.

    Args:
        joints: SMPL-X's joints in camera space (z away from the camera).
    """
    wrists = joints[:, [JOINT["left_wrist"], JOINT["right_wrist"]], 2]
    return wrists < joints[:, JOINT["spine3"], 2, None]


def depth_error(estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T"]:
    """Difference of the points' mean distance along the camera's z axis, in millimetres (points in metres).

    Positive: the estimate is too far away.
    """
    return 1e3 * (estimate - truth)[..., 2].mean(1)
