"""The 12 limb joints beside the true ones: figures without a body or a camera, so that any system's can be taken."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core import metrics

Limbs = Float[np.ndarray, "T 12 3"]
"""`keypoints.LIMBS`, metres, in a space of its own; NaN where a joint is not known."""
HIPS = [kp.LIMBS.index(kp.INDEX[f"{side}_hip"]) for side in ("left", "right")]
_BENT = {"knee": ("hip", "knee", "ankle"), "hip": ("shoulder", "hip", "knee"), "elbow": ("shoulder", "elbow", "wrist")}
"""A joint, and the far ends of its two segments."""


def limb_pa_mpjpe(estimate: Limbs, truth: Limbs) -> Float[np.ndarray, "T"]:
    """Mean joint error after Procrustes alignment of each frame, millimetres; NaN where a joint is not known."""
    both = _known(estimate, truth)
    errors = np.full(len(both), np.nan)
    if both.any():
        errors[both] = metrics.pa_mpjpe(estimate[both], truth[both])
    return errors


def turned(estimate: Limbs, truth: Limbs) -> Limbs:
    """The truth relative to the middle of its hips, after the one rotation of the whole clip that is best.

    For a truth in a laboratory with an unknown camera. NaN without a known frame.
    """
    both, found, true = _known(estimate, truth), metrics.rooted(estimate, HIPS), metrics.rooted(truth, HIPS)
    if not both.any():
        return np.full_like(true, np.nan)
    turn = Rotation.align_vectors(found[both].reshape(-1, 3), true[both].reshape(-1, 3))[0]
    return true @ turn.as_matrix().T


def turned_mpjpe(estimate: Limbs, truth: Limbs) -> float | None:
    """Mean joint error, the middle of the hips aligned, against the turned truth. Millimetres; None without a known
    frame."""
    off = np.linalg.norm(metrics.rooted(estimate, HIPS) - turned(estimate, truth), axis=-1)
    known = off[_known(estimate, truth)]
    return 1e3 * float(known.mean()) if len(known) else None


def limb_flexion(points: Limbs, joint: str) -> Float[np.ndarray, "T 2"]:
    """Degrees by which a joint of _BENT is bent from straight, left and right; the hip between trunk side and thigh."""
    upper, middle, lower = (
        points[:, [kp.LIMBS.index(kp.INDEX[f"{side}_{part}"]) for side in ("left", "right")]] for part in _BENT[joint]
    )
    a, b = middle - upper, lower - middle
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1)))


def _flexion_error(joint: str) -> Callable[[Limbs, Limbs], float | None]:
    def value(estimate: Limbs, truth: Limbs) -> float | None:
        errors = limb_flexion(estimate, joint) - limb_flexion(truth, joint)
        known = errors[np.isfinite(errors)]
        return float(np.sqrt((known**2).mean())) if len(known) else None

    return value


def _known(*limbs: Limbs) -> Bool[np.ndarray, "T"]:
    return np.logical_and.reduce([np.isfinite(points).all((1, 2)) for points in limbs])


@dataclass(frozen=True, kw_only=True)
class LimbFigure:
    """One number for a clip."""

    title: str
    unit: str
    value: Callable[[Limbs, Limbs], float | None]
    """Of the estimated and the true joints."""


LIMB_FIGURES: dict[str, LimbFigure] = {
    "turned_mpjpe": LimbFigure(title="MPJPE after one rotation of the clip", unit="mm", value=turned_mpjpe),
    **{
        f"{joint}_flexion": LimbFigure(
            title=f"{joint.capitalize()} flexion by joint centres, RMS error", unit="°", value=_flexion_error(joint)
        )
        for joint in _BENT
    },
}
"""By name."""


def limb_figures(estimate: Limbs, truth: Limbs) -> dict[str, float | None]:
    """All of LIMB_FIGURES."""
    return {name: figure.value(estimate, truth) for name, figure in LIMB_FIGURES.items()}
