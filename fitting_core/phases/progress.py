"""How phases report a running minimisation."""

from collections.abc import Generator
from dataclasses import dataclass

from fitting_core.body.params import BodyParams
from fitting_core.solvers.solution import Progress, Solution


@dataclass(frozen=True)
class Step:
    """One solver iteration inside a phase, or frames that became final."""

    label: str
    share: float
    """How much of the phase is done, 0 to 1."""
    cost: float
    final: tuple[range, BodyParams] | None = None


def reported(
    minimisation: Generator[Progress, None, Solution], label: str, share: tuple[float, float], iterations: int
) -> Generator[Step, None, Solution]:
    """Passes a minimisation on as steps that lie between two shares of the phase."""
    begin, end = share
    while True:
        try:
            progress = next(minimisation)
        except StopIteration as stop:
            return stop.value
        done = min(1.0, progress.iteration / iterations)
        finite = progress.cost[progress.cost.isfinite()]
        yield Step(label, begin + (end - begin) * done, float(finite.mean()) if len(finite) else float("inf"))
