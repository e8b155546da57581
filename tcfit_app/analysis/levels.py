"""What a part of the body does in each frame, as one of a few levels: rows of the timeline."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.frame_runs import runs_where
from fitting_core.keypoints import SIDES
from fitting_core.measure.hands.phases import HOLD, MOVEMENT, REST, hand_phases
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.seen import evident

LevelSpans = tuple[tuple[tuple[tuple[int, int], ...], ...], ...]
"""For each part and each level, the first and last frames of the spans that have it."""


@dataclass(frozen=True, kw_only=True)
class LevelKind:
    """How the levels of some parts of the body are computed."""

    title: str
    group: Literal["Motion", "Height and depth"]
    """Its place in menus, among the curves."""
    parts: tuple[str, ...]
    words: tuple[str, ...]
    """The meaning of the levels 0, 1 and so on, which are drawn ever stronger."""
    values: Callable[[PosedFit], Float[np.ndarray, "T P"]]
    """The level of each part in each frame; NaN if unknown."""


_PHASES = (REST, HOLD, MOVEMENT)


def _hand_phases(fit: PosedFit) -> Float[np.ndarray, "T 2"]:
    levels = np.full((len(fit), len(SIDES)), np.nan)
    seen = evident(fit.clip.keypoints)
    for i, side in enumerate(SIDES):
        for span in hand_phases(fit.joints, side, fit.clip.frame_rate):
            levels[span.frames.start : span.frames.stop, i] = _PHASES.index(span.label)
        levels[~seen[:, kp.INDEX[f"{side}_wrist"]], i] = np.nan
    return levels


def _contacts(fit: PosedFit) -> Float[np.ndarray, "T 2"]:
    if fit.grounding is None:
        return np.full((len(fit), len(SIDES)), np.nan)
    contacts = fit.grounding.contacts
    return np.where(contacts.seen, contacts.let_go + 2.0 * contacts.standing, np.nan)


LEVELS: dict[str, LevelKind] = {
    "hand_phases": LevelKind(
        title="Hand phases",
        group="Motion",
        parts=tuple(f"{side} hand" for side in SIDES),
        words=_PHASES,
        values=_hand_phases,
    ),
    "contacts": LevelKind(
        title="Feet on the floor",
        group="Height and depth",
        parts=tuple(f"{side} foot" for side in SIDES),
        words=("in the air", "seems to stand, but slides", "stands"),
        values=_contacts,
    ),
}
"""By name."""


def level_spans(name: str, fit: PosedFit) -> LevelSpans:
    """One of LEVELS over all frames of a clip."""
    kind = LEVELS[name]
    return tuple(
        tuple(tuple((run[0], run[-1]) for run in runs_where(part == level)) for level in range(len(kind.words)))
        for part in kind.values(fit).T
    )
