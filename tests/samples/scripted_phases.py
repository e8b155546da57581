"""What hands do as the script of a generated motion has it, and how far phases that were found agree with that."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from evaluation.synthetic.acting.script import ArmKey
from fitting_core.measure.hands.phases import HOLD, MOVEMENT, REST
from fitting_core.measure.hands.spans import Span, spans_of

_SAME_PLACE = 0.03
"""Metres between two keys of a stop."""
_STOP = 0.1
"""Seconds: what is shorter belongs to the movements around it, as the phases have it."""
_HANGING = -0.4
"""Metres: a scripted wrist that is lower than this from the shoulders hangs down."""
_REACH = 0.25
"""Seconds between a boundary and where it is found."""


def scripted_phases(keys: Sequence[ArmKey], times: Float[np.ndarray, "T"]) -> list[str]:
    """What an arm does at some times: between two keys it stays or goes.

    Args:
        keys: Of an arm whose wrist is told from the chest.
        times: Seconds, ascending.
    """
    stretches: list[tuple[float, str]] = []  # until when, and what
    for a, b in pairwise(keys):
        stays = np.linalg.norm(np.subtract(a.wrist, b.wrist)) <= _SAME_PLACE
        label = MOVEMENT if not stays else REST if a.wrist[1] < _HANGING else HOLD
        if stretches and stretches[-1][1] == label:
            stretches.pop()
        stretches.append((b.time, label))
    stops = [stop for stop, _ in stretches]
    lasting = np.diff([keys[0].time, *stops])
    labels = [MOVEMENT if seconds < _STOP else label for seconds, (_, label) in zip(lasting, stretches, strict=True)]
    at = np.searchsorted(stops, times + 1e-9)
    return [labels[i] if i < len(labels) else REST for i in at]


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Of one hand in one sequence."""

    same: float
    """Share of the frames."""
    off: tuple[float, ...]
    """Milliseconds by which boundaries that are found lie late."""
    missed: int
    extra: int


def agreement(truth: Sequence[str], spans: Sequence[Span], frame_rate: float) -> Agreement:
    """Phases that were found against those of the script."""
    found = [span.label for span in spans for _ in span.frames]
    left, off, missed = _boundaries(found), list[float](), 0
    for frame, begins in _boundaries(truth):
        near = [b for b in left if b[1] == begins and abs(b[0] - frame) <= _REACH * frame_rate]
        if not near:
            missed += 1
            continue
        nearest = min(near, key=lambda b: abs(b[0] - frame))
        left.remove(nearest)
        off.append(1000 * (nearest[0] - frame) / frame_rate)
    same = float(np.mean([a == b for a, b in zip(truth, found, strict=True)]))
    return Agreement(same=same, off=tuple(off), missed=missed, extra=len(left))


def _boundaries(labels: Sequence[str]) -> list[tuple[int, bool]]:
    """Frames in which movement begins (True) or ends."""
    spans = spans_of([MOVEMENT if label == MOVEMENT else HOLD for label in labels])
    return [(span.frames.start, span.label == MOVEMENT) for span in spans[1:]]
