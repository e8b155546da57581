"""How good and how smooth a fit is, as the field measures it: arithmetic on arrays of points.

What needs whole meshes is in `measure.mesh`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.body.model import JOINT
from fitting_core.keypoints import ERROR_GROUPS

# --- alignment, for metrics that do not count the difference in place, rotation or size ---


@dataclass(frozen=True, kw_only=True, eq=False)
class Similarity:
    """x -> scale * rotation @ x + translation, one for each of T frames."""

    rotation: Float[np.ndarray, "T 3 3"]
    translation: Float[np.ndarray, "T 3"]
    scale: Float[np.ndarray, "T"]

    def __getitem__(self, frames: slice) -> "Similarity":
        return Similarity(**{name: values[frames] for name, values in vars(self).items()})

    def __call__(self, points: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T K 3"]:
        """The points of each frame, moved by that frame's transformation."""
        turned = points @ self.rotation.transpose(0, 2, 1)
        return self.scale[:, None, None] * turned + self.translation[:, None]


def similarity(
    source: Float[np.ndarray, "T K 3"], target: Float[np.ndarray, "T K 3"], *, scaled: bool = True
) -> Similarity:
    """The transformation of each frame that brings `source` nearest to `target`.

    Least squares by singular values; S. Umeyama, PAMI 13(4), 1991.

    Args:
        source: At least three points of each frame, not on one line.
        target: The same points elsewhere.
        scaled: Whether the size may change too; else the motion is rigid.
    """
    mean_source, mean_target = source.mean(1, keepdims=True), target.mean(1, keepdims=True)
    a, b = source - mean_source, target - mean_target
    u, s, vt = np.linalg.svd(np.einsum("tki,tkj->tij", a, b))
    sign = np.ones_like(s)
    sign[:, 2] = np.sign(np.linalg.det(u @ vt))
    rotation = np.einsum("tij,tj,tjk->tki", u, sign, vt)
    scale = (s * sign).sum(1) / (a * a).sum((1, 2)).clip(1e-12) if scaled else np.ones(len(source))
    moved = scale[:, None] * (rotation @ mean_source.transpose(0, 2, 1))[..., 0]
    return Similarity(rotation=rotation, translation=mean_target[:, 0] - moved, scale=scale)


def procrustes(source: Float[np.ndarray, "T K 3"], target: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T K 3"]:
    """`source` moved by the similarity (rotation, scale, translation) of each frame that is nearest to `target`."""
    return similarity(source, target)(source)


def rooted(points: Float[np.ndarray, "T K 3"], roots: list[int]) -> Float[np.ndarray, "T K 3"]:
    """Points counted from the middle of some of them, such as the pelvis."""
    return points - points[:, roots].mean(1, keepdims=True)


# --- errors of points in space ---


def point_error(estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T"]:
    """Mean distance of each frame's points as they stand, in millimetres (points in metres)."""
    return 1e3 * np.linalg.norm(estimate - truth, axis=-1).mean(1)


def pa_mpjpe(estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T"]:
    """Mean joint error of each frame after Procrustes alignment, in millimetres (points in metres)."""
    return point_error(procrustes(estimate, truth), truth)


def mpjpe(
    estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"], roots: list[int]
) -> Float[np.ndarray, "T"]:
    """Mean joint error of each frame with the mean of `roots` aligned, in millimetres (points in metres)."""
    return point_error(rooted(estimate, roots), rooted(truth, roots))


def depth_error(estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T"]:
    """Difference of the points' mean distance along the camera's z axis, in millimetres (points in metres).

    Positive: the estimate is too far away.
    """
    return 1e3 * (estimate - truth)[..., 2].mean(1)


# --- reprojection errors ---


def reprojection_errors(
    projected: Float[np.ndarray, "T K 2"], detected: Float[np.ndarray, "T K 2"], counted: Bool[np.ndarray, "T K"]
) -> Float[np.ndarray, "N"]:
    """Distances in pixels between projected and detected keypoints, of those that count."""
    return np.linalg.norm(projected - detected, axis=-1)[counted]


def error_figures(errors: Float[np.ndarray, "T 137"]) -> dict[str, float | None]:
    """Median and 95th percentile of reprojection errors over all keypoints ("median", "p95") and by ERROR_GROUPS
    ("body_median", "body_p95", ...); None without any. NaN does not count."""
    groups: dict[str, slice | list[int]] = {"": slice(None)}
    groups |= {f"{name}_": list(columns) for name, columns in ERROR_GROUPS.items()}
    found: dict[str, float | None] = {}
    for name, columns in groups.items():
        known = errors[:, columns]
        known = known[np.isfinite(known)]
        median, p95 = np.percentile(known, [50, 95]).tolist() if len(known) else (None, None)
        found |= {f"{name}median": median, f"{name}p95": p95}
    return found


def heights_in_image(points: Float[np.ndarray, "T K 2"], counted: Bool[np.ndarray, "T K"]) -> Float[np.ndarray, "T"]:
    """How long the person is in each image: the longer side of the box around the points that count, pixels.

    NaN where fewer than two count. Not the height alone: who sits or lies down comes no nearer to the camera.
    """
    low = np.where(counted[..., None], points, np.inf).min(1)
    high = np.where(counted[..., None], points, -np.inf).max(1)
    return np.where(counted.sum(1) > 1, (high - low).max(1), np.nan)


def frame_means(
    projected: Float[np.ndarray, "T K 2"], seen: Float[np.ndarray, "T K 2"], counted: Bool[np.ndarray, "T K"]
) -> Float[np.ndarray, "T"]:
    """Mean reprojection error of each frame in pixels; NaN where no point counts."""
    errors = np.where(counted, np.linalg.norm(np.where(counted[..., None], projected - seen, 0), axis=-1), 0)
    number = counted.sum(1)
    return np.where(number > 0, errors.sum(1) / np.maximum(number, 1), np.nan)


# --- smoothness, by differences in time; 0 with too few frames ---


def jitter(points: Float[np.ndarray, "T K 3"]) -> float:
    """Mean length of the second difference in time, in millimetres per frame^2 (points in metres)."""
    return 1e3 * _mean_length(points, 2)


def jerk(points: Float[np.ndarray, "T K 3"], frame_rate: float) -> float:
    """Jitter: mean length of the third derivative, m/s^3 (points in metres, frames per second)."""
    return _mean_length(points, 3) * frame_rate**3


def acceleration_error(
    estimate: Float[np.ndarray, "T K 3"], truth: Float[np.ndarray, "T K 3"], frame_rate: float
) -> Float[np.ndarray, "T"]:
    """Mean distance between estimated and true acceleration, m/s^2; NaN for the first and the last frame.

    A. Kanazawa et al., Learning 3D Human Dynamics from Video, CVPR 2019, section 4.
    """
    errors = np.full(len(estimate), np.nan)
    if len(estimate) > 2:
        errors[1:-1] = np.linalg.norm(np.diff(estimate - truth, 2, axis=0), axis=-1).mean(1) * frame_rate**2
    return errors


def depth_jitter(
    points: Float[np.ndarray, "T K 3"], frame_rate: float, *, view: Float[np.ndarray, "T 3"] | None = None
) -> float:
    """Mean size of the points' common acceleration along the camera's line of sight, m/s^2.

    Args:
        points: Metres.
        frame_rate: Frames per second.
        view: Where the camera looks in each frame, unit vectors in the points' space; None: along its z axis.
    """
    if len(points) < 3:
        return 0.0
    change = np.diff(points.mean(1), 2, axis=0)
    along = change[:, 2] if view is None else (change * view[1:-1]).sum(1)
    return float(abs(along).mean()) * frame_rate**2


def _mean_length(points: np.ndarray, order: int) -> float:
    if len(points) <= order:
        return 0.0
    return float(np.linalg.norm(np.diff(points, order, axis=0), axis=-1).mean())


# --- variation of quantities that are constant over a clip ---


def bone_length_variation(points: Float[np.ndarray, "T K 3"], bones: Sequence[tuple[int, int]]) -> float:
    """Standard deviation of the bones' lengths over the frames as a share of their mean lengths, mean of the bones.

    Args:
        points: Metres.
        bones: Pairs of points; those of no length do not count.
    """
    ends = np.array(bones)
    lengths = np.linalg.norm(points[:, ends[:, 0]] - points[:, ends[:, 1]], axis=-1)
    means = lengths.mean(0)
    long = means > 1e-6
    return float((lengths.std(0)[long] / means[long]).mean()) if long.any() else 0.0


def shape_variation(betas: Float[np.ndarray, "T 10"]) -> float:
    """Standard deviation of the shape coefficients over the frames, mean of the coefficients."""
    return float(betas.std(0).mean())


# --- posture of people who are known to be upright ---


def torso_lean(joints: Float[np.ndarray, "T 55 3"]) -> Float[np.ndarray, "T"]:
    """Angle in degrees between the line from the middle of the hip joints to the neck joint and the image's vertical.

    Not the root's axis: a root may lean where the spine bends it back, and a straight root under a bent spine is no
    upright person.

    Args:
        joints: SMPL-X's joints in camera space (y down).
    """
    hips = joints[:, [JOINT["left_hip"], JOINT["right_hip"]]].mean(1)
    up = joints[:, JOINT["neck"]] - hips
    cosine = -up[:, 1] / np.linalg.norm(up, axis=-1)
    return np.degrees(np.arccos(cosine.clip(-1, 1)))
