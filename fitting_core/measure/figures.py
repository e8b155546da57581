"""Single numbers that tell how good a fit is, and that are no mean of a curve: the FIGURES table."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fitting_core import metrics
from fitting_core.measure.pairing import BODY_JOINTS, Pair


@dataclass(frozen=True, kw_only=True)
class FigureKind:
    """One number for a fit."""

    title: str
    unit: str
    value: Callable[[Pair], float | None]
    better: Literal["lower", ""] = "lower"


def _of_truth(figure: Callable[[np.ndarray, float], float]) -> Callable[[Pair], float | None]:
    """A figure of the reference's own movement, at the fit's frames."""

    def value(pair: Pair) -> float | None:
        if pair.reference is None or pair.reference.joints is None or not pair.even or (pair.frames < 0).any():
            return None
        return figure(pair.reference.joints[pair.frames][:, BODY_JOINTS], pair.estimate.frame_rate)

    return value


def _of_fit(figure: Callable[[np.ndarray, float], float]) -> Callable[[Pair], float | None]:
    return lambda pair: figure(pair.estimate.joints[:, BODY_JOINTS], pair.estimate.frame_rate)


def _bones(pair: Pair) -> float:
    parents = pair.estimate.body.parents
    return 100 * metrics.bone_length_variation(pair.estimate.joints, [(int(parents[j]), j) for j in BODY_JOINTS[1:]])


FIGURES: dict[str, FigureKind] = {
    "jitter": FigureKind(title="Jitter", unit="mm/frame²", value=_of_fit(lambda j, rate: metrics.jitter(j))),
    "jitter_truth": FigureKind(
        title="Jitter of the truth", unit="mm/frame²", value=_of_truth(lambda j, rate: metrics.jitter(j)), better=""
    ),
    "jerk": FigureKind(title="Jitter, third difference", unit="m/s³", value=_of_fit(metrics.jerk)),
    "jerk_truth": FigureKind(
        title="Jitter of the truth, third difference", unit="m/s³", value=_of_truth(metrics.jerk), better=""
    ),
    "depth_jitter": FigureKind(title="Depth jitter", unit="m/s²", value=_of_fit(metrics.depth_jitter)),
    "bone_length_variation": FigureKind(title="Bone length variation", unit="%", value=_bones),
    "shape_variation": FigureKind(
        title="Shape variation", unit="", value=lambda p: metrics.shape_variation(p.estimate.params.betas.numpy())
    ),
}
"""Those that are no mean of a curve."""
