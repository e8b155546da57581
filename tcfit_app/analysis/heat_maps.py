"""Values by part of the body over the frames of a clip: the timeline's heat maps by name."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.body.geometry import SIDES
from fitting_core.ground.contacts import FOOT_POINTS
from fitting_core.measure.hands.phases import HOLD, MOVEMENT, REST, hand_phases
from tcfit_app.analysis.body_regions import REGIONS
from tcfit_app.analysis.curves import weighted_mean
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.seen import told

_TOP = 99.0
"""Percentile of the values at the top of the colour scale: a single outlier would leave the rest dark."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeatMap:
    """A number for each part of the body in each frame of a clip."""

    name: str
    parts: tuple[str, ...]
    values: Float[np.ndarray, "T R"]
    """NaN where missing."""
    top: float
    """The top of the colour scale, which starts at 0."""


PARTS: dict[str, tuple[int, ...]] = {
    part: REGIONS[part]
    for part in (
        *("head", "face", "torso"),
        *(f"{side} {part}" for part in ("arm", "hand", "leg", "foot") for side in ("left", "right")),
    )
}
"""The regions from top to bottom."""
assert set(PARTS) == set(REGIONS)


@dataclass(frozen=True, kw_only=True)
class HeatKind:
    """How a heat map is computed."""

    title: str
    unit: str
    worse: Literal["high", "low"]
    """Which values need attention."""
    values: Callable[[PosedFit], Float[np.ndarray, "T 137"]]
    """For each keypoint; NaN where missing."""
    top: float | None = None
    """The top of the colour scale; None: from the values."""
    parts: Mapping[str, tuple[int, ...]] = field(default_factory=lambda: PARTS)
    weighted: bool = False
    """By the detections' confidence."""
    words: tuple[str, ...] = ()
    """What the values 0, 1 and so on mean, if they are categories."""


def _errors(fit: PosedFit) -> Float[np.ndarray, "T 137"]:
    errors = fit.errors.copy()
    errors[:, kp.INDEX["neck"]] = np.nan  # no preset fits it: see the reprojection error's curve
    return errors


def _confidences(fit: PosedFit) -> Float[np.ndarray, "T 137"]:
    return np.where(fit.tracked, fit.clip.keypoints.confidence, np.nan)


_LEVELS = (REST, HOLD, MOVEMENT)
"""Of the hands' phases, the brightest last."""
_HANDS = {side: tuple(range(kp.COUNT)[kp.GROUPS[f"{side}_hand"]]) for side in SIDES}


def _phases(fit: PosedFit) -> Float[np.ndarray, "T 137"]:
    levels = np.full((len(fit), kp.COUNT), np.nan)
    seen = told(fit.clip.keypoints)
    for side in SIDES:
        hand = kp.GROUPS[f"{side}_hand"]
        for span in hand_phases(fit.joints, side, fit.clip.frame_rate):
            levels[span.frames.start : span.frames.stop, hand] = _LEVELS.index(span.label)
        levels[~seen[:, kp.INDEX[f"{side}_wrist"]], hand] = np.nan
    return levels


_FEET = {f"{side} foot": tuple(points) for side, points in zip(SIDES, FOOT_POINTS.tolist(), strict=True)}


def _contacts(fit: PosedFit) -> Float[np.ndarray, "T 137"]:
    levels = np.full((len(fit), kp.COUNT), np.nan)
    if fit.grounding is not None:
        contacts = fit.grounding.contacts
        found = np.where(contacts.seen, contacts.let_go + 2.0 * contacts.standing, np.nan)
        levels[:, FOOT_POINTS] = found[..., None]
    return levels


HEAT_MAPS: dict[str, HeatKind] = {
    "error_by_part": HeatKind(title="Error by part, B", unit="px", worse="high", values=_errors, weighted=True),
    "confidence_by_part": HeatKind(title="Confidence by part", unit="", worse="low", values=_confidences, top=1.0),
    "hand_phases": HeatKind(
        title="Hand phases, B", unit="", worse="high", values=_phases, top=2.0, parts=_HANDS, words=_LEVELS
    ),
    "contacts": HeatKind(
        title="Feet on the floor, B",
        unit="",
        worse="high",
        values=_contacts,
        top=2.0,
        parts=_FEET,
        words=("in the air", "seems to stand, but slides", "stands"),
    ),
}
"""By name. A part's value is the mean over its keypoints; errors are weighted by the detections' confidence."""


def heat_map(name: str, fit: PosedFit) -> HeatMap:
    """A whole heat map by its name in HEAT_MAPS, over all frames of a clip."""
    kind = HEAT_MAPS[name]
    values = kind.values(fit)
    weights = fit.clip.keypoints.confidence if kind.weighted else np.ones_like(values)
    by_part = np.stack([weighted_mean(values[:, part], weights[:, part]) for part in map(list, kind.parts.values())], 1)
    known = by_part[np.isfinite(by_part)]
    top = kind.top or (float(np.percentile(known, _TOP)) if len(known) else 0.0)
    return HeatMap(name=name, parts=tuple(kind.parts), values=by_part, top=top or 1.0)
