"""Stretches of frames that are called the same."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from fitting_core.frame_runs import runs_where


@dataclass(frozen=True, kw_only=True)
class Span:
    """Consecutive frames with a label."""

    frames: range
    """Counted from the clip's first (0)."""
    label: str


def spans_of(labels: Sequence[str]) -> list[Span]:
    """The longest stretches of one label each, in order; frames with an empty label are in none."""
    changes = [t for t in range(1, len(labels)) if labels[t] != labels[t - 1]]
    starts, stops = [0, *changes], [*changes, len(labels)]
    found = (Span(frames=range(a, b), label=labels[a]) for a, b in zip(starts, stops, strict=True) if a < b)
    return [span for span in found if span.label]


def without_short(where: Bool[np.ndarray, "T"], shortest: int) -> Bool[np.ndarray, "T"]:
    """The same without stretches of fewer frames than `shortest`."""
    kept = where.copy()
    for run in runs_where(where):
        if len(run) < shortest:
            kept[run] = False
    return kept
