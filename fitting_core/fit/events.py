"""Events of the fitting generator, detached copies on the CPU; and helpers for generators that return a value."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any, TypeVar

from fitting_core.body.params import BodyParams
from fitting_core.results.fit_result import FitResult, PhaseResult


@dataclass(frozen=True, kw_only=True)
class PhaseStarted:
    """A phase begins."""

    phase: int
    title: str


@dataclass(frozen=True, kw_only=True)
class Iteration:
    """A solver made a step."""

    phase: int
    label: str
    """Which part of the phase, for the user: "placing the body", "stage 3 of 5", "window 12 of 90, stage 5 of 5"."""
    share: float
    """Estimated finished fraction of the phase, 0 to 1."""
    cost: float
    """Mean cost of the frames that are being fitted."""
    terms: dict[str, float] = field(default_factory=dict)
    """Mean cost of a frame by term; usually empty (`phases.progress.TermSampling`)."""


@dataclass(frozen=True, kw_only=True)
class FramesFitted:
    """Frames have a fit to show: a first one in phase 1, the last one in a sliding window's phase 3."""

    phase: int
    frames: range
    params: BodyParams
    """Of these frames."""


@dataclass(frozen=True, kw_only=True)
class PhaseFinished:
    """A phase has its result; it stays valid if the fit is cancelled after it."""

    phase: int
    result: PhaseResult
    so_far: FitResult
    """The fit with all phases finished so far."""


@dataclass(frozen=True, kw_only=True)
class Finished:
    """The whole fit has its result."""

    result: FitResult


FitEvent = PhaseStarted | Iteration | FramesFitted | PhaseFinished | Finished


Value = TypeVar("Value")
Other = TypeVar("Other")
Returned = TypeVar("Returned")


def drained(generator: Generator[Any, None, Returned]) -> Returned:
    """Run a generator to its end and return its value."""
    while True:
        try:
            next(generator)
        except StopIteration as stop:
            return stop.value


def mapped(
    generator: Generator[Value, None, Returned], change: Callable[[Value], Other]
) -> Generator[Other, None, Returned]:
    """The generator with `change` applied to each of its values; closing it closes the original."""
    try:
        while True:
            try:
                value = next(generator)
            except StopIteration as stop:
                return stop.value
            yield change(value)
    finally:
        generator.close()
