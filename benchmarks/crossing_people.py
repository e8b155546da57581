"""Tracking of people who cross, hide each other, leave and return: identities, and exchanges that are named.

People of the motion suite on generated ways, as the measured detector finds them; who is who is known.
"""

from dataclasses import dataclass, field

import numpy as np
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, report, start
from tests.samples.company.filmed import film
from tests.samples.company.scenes import SCENES
from tests.samples.company.telling_apart import Told, told_apart


@dataclass(frozen=True, kw_only=True)
class CrossingPeople:
    """What to measure."""

    seeds: tuple[int, int] = (0, 20)
    """From the first on, up to before the second: 0 to 59 were tuned on, 200 to 219 were not."""
    every: int = 1
    """Step between the frames that are kept, of 30 per second."""
    scenes: tuple[str, ...] = tuple(SCENES)
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def rows(options: CrossingPeople) -> list[Row]:
    """A line for each scene."""
    found = []
    seeds = range(*options.seeds)
    for scene in options.scenes:
        progress(scene)
        found.append(row(scene, [told_apart(film(scene, seed, every=options.every)) for seed in seeds]))
    return found


def row(scene: str, results: list[Told]) -> Row:
    """The tracking of a scene, over several seeds."""
    return {
        "scene": scene,
        "right": f"{np.mean([one.right for one in results]):.1%}",
        "exchanges": str(sum(one.exchanges for one in results)),
        "named": str(sum(one.named for one in results)),
        "too many": str(sum(max(one.found - one.there, 0) for one in results)),
        "too few": str(sum(max(one.there - one.found, 0) for one in results)),
        "frames named": f"{np.mean([one.uncertain for one in results]):.1%}",
    }


def run(options: CrossingPeople) -> None:
    """Makes the scenes, follows everybody, and reports."""
    report(options, {f"Who is who, {30 / options.every:g} frames per second": rows(options)})


if __name__ == "__main__":
    start(CrossingPeople, run)
