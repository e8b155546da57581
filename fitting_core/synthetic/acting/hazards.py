"""Where a detector is likely to fail, and how often it does."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting_core.synthetic.acting.script import Failure


@dataclass(frozen=True)
class Hazard:
    """A stretch of a performance that is hard for a detector."""

    kind: str
    """Of the failure, one of FAILURES in fitting_core.synthetic.simulated_detector."""
    start: float
    stop: float
    """Seconds."""
    groups: tuple[str, ...]
    """As of Failure."""
    likely: float = 1.0
    """Of a failure here, against the usual."""


@dataclass(frozen=True, kw_only=True)
class Mishaps:
    """How often hazards turn into failures, and for how long."""

    chance: float
    """That there is a failure in a hazard's stretch."""
    seconds: tuple[float, float]
    """Shortest and longest failure; none outlasts its stretch."""


def failures(hazards: Sequence[Hazard], mishaps: Mishaps, rng: np.random.Generator) -> list[Failure]:
    """Failures by chance. The same source of chance gives at least the failures of lower chances, and longer ones."""
    found = []
    for hazard in hazards:
        happens, length, place = rng.random(3)
        if happens < mishaps.chance * hazard.likely:
            shortest, longest = mishaps.seconds
            seconds = min(shortest + length * (longest - shortest), hazard.stop - hazard.start)
            start = hazard.start + place * (hazard.stop - hazard.start - seconds)
            found.append(Failure(hazard.kind, start, start + seconds, hazard.groups))
    return found
