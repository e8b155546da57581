"""How phases report a running minimisation."""

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import torch

from fitting_core.body.params import BodyParams
from fitting_core.fit.events import mapped
from fitting_core.fit.solvers.solution import Progress, Solution
from fitting_core.fit.stages import N_STAGES
from fitting_core.results.provenance import STARTS, Start


@dataclass(frozen=True)
class Step:
    """One solver iteration inside a phase, or frames that can be looked at."""

    label: str
    share: float
    """How much of the phase is done, 0 to 1."""
    cost: float
    """Mean of the frames that are being fitted."""
    fitted: tuple[range, BodyParams] | None = None
    """Frames with a fit, the first one of phase 1 or the last one of phase 3."""
    terms: Callable[[], dict[str, float]] = dict
    """Evaluates the mean cost of a frame by term; to be called before the phase goes on."""

    def between(self, begin: float, end: float) -> "Step":
        """The same step of what is only a part of the phase, between two shares of it."""
        return replace(self, share=begin + (end - begin) * self.share)


def reported(
    minimisation: Generator[Progress, None, Solution],
    label: str,
    share: tuple[float, float],
    iterations: int,
    *,
    frames: int = 1,
) -> Generator[Step, None, Solution]:
    """Passes a minimisation on as steps that lie between two shares of the phase; its costs are sums over `frames`."""
    begin, end = share

    def step(progress: Progress) -> Step:
        done = min(1.0, progress.iteration / iterations)
        finite = progress.cost[progress.cost.isfinite()]
        cost = float(finite.mean()) / frames if len(finite) else float("inf")
        return Step(label, begin + (end - begin) * done, cost, terms=progress.terms)

    return (yield from mapped(minimisation, step))


TERMS_EVERY = 0.5
"""Seconds between two evaluations of the cost by term."""
_SHARE = 0.03
"""Most of the time that these evaluations may take: of long clips they are rarer."""


class TermSampling:
    """Evaluates the cost by term now and then, by the clock: the fit itself is the same with and without."""

    def __init__(self) -> None:
        self._due = 0.0

    def terms(self, step: Step) -> dict[str, float]:
        """The step's, or empty if the last ones are recent."""
        begin = time.monotonic()
        if begin < self._due:
            return {}
        with torch.no_grad():
            terms = step.terms()
        end = time.monotonic()
        self._due = end + max(TERMS_EVERY, (end - begin) / _SHARE)
        return terms


def stage_label(stage: int) -> str:
    """For the user."""
    return f"stage {stage} of {N_STAGES}"


def mirrored_label(start: Start) -> str:
    """For the user, where a limb is tried that is mirrored in depth."""
    return "trying " + STARTS[start].removeprefix("its own fit with ")
