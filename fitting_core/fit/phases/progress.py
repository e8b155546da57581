"""How phases report the progress of a minimisation."""

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
class PhaseStep:
    """One solver iteration inside a phase, or frames that can be shown."""

    label: str
    share: float
    """Progress of the phase, 0 to 1."""
    cost: float
    """Mean of the frames being fitted."""
    fitted: tuple[range, BodyParams] | None = None
    """Fitted frames, the first result of phase 1 or the last of phase 3."""
    terms: Callable[[], dict[str, float]] = dict
    """Evaluates the mean cost per frame by term; call it before the phase continues."""

    def between(self, begin: float, end: float) -> "PhaseStep":
        """The same step as part of the phase, from progress `begin` to `end`."""
        return replace(self, share=begin + (end - begin) * self.share)


def reported(
    minimisation: Generator[Progress, None, Solution],
    label: str,
    share: tuple[float, float],
    iterations: int,
    *,
    frames: int = 1,
) -> Generator[PhaseStep, None, Solution]:
    """A minimisation as steps between two progress values of the phase; its costs are sums over `frames`.

    Most converge after a quarter of the maximum number of iterations. Each sixth of the maximum does half of what is
    left.
    """
    begin, end = share

    def step(progress: Progress) -> PhaseStep:
        done = 1 - 0.5 ** (_HALVES * progress.iteration / iterations)
        finite = progress.cost[progress.cost.isfinite()]
        cost = float(finite.mean()) / frames if len(finite) else float("inf")
        return PhaseStep(label, begin + (end - begin) * done, cost, terms=progress.terms)

    return (yield from mapped(minimisation, step))


_HALVES = 6
TERMS_EVERY = 0.5
"""Seconds between two evaluations of the cost by term."""
_SHARE = 0.03
"""Maximum fraction of the time for these evaluations: for long clips they are rarer."""


class TermSampling:
    """Evaluates the cost by term now and then; the fit is the same with and without."""

    def __init__(self) -> None:
        self._due = 0.0

    def terms(self, step: PhaseStep) -> dict[str, float]:
        """The step's costs, or empty if the last evaluation is recent."""
        begin = time.monotonic()
        if begin < self._due:
            return {}
        with torch.no_grad():
            terms = step.terms()
        end = time.monotonic()
        self._due = end + max(TERMS_EVERY, (end - begin) / _SHARE)
        return terms


def stage_label(stage: int) -> str:
    """For users."""
    return f"stage {stage} of {N_STAGES}"


def mirrored_label(start: Start) -> str:
    """For users, while a limb mirrored in depth is tried."""
    return "trying " + STARTS[start].removeprefix("its own fit with ")
