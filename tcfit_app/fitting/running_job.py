"""A job of the worker as browsers see it."""

from dataclasses import dataclass, field
from typing import Literal

from tcfit_app.fitting.outbox import JobProgress


@dataclass(kw_only=True)
class RunningJob:
    """A job from its submission to its end."""

    number: int
    run: int | None
    """The run that it fits; None: edits are being followed."""
    follows: int | None = None
    """The run whose edits are being followed."""
    title: str
    phases: tuple[int, ...]
    started: bool = False
    phase: int | None = None
    progress: JobProgress | None = None
    losses: list[tuple[float, dict[str, float]]] = field(default_factory=list)
    """Seconds of work, and mean cost of a frame by term, "total" among them; about twice a second."""
    windows: list[range] = field(default_factory=list)
    """Frames that are final."""
    outcome: Literal["", "finished", "cancelled", "failed"] = ""
    """Empty: it has not ended."""
    reason: str = ""
    """Why it failed."""

    def take(self, progress: JobProgress) -> None:
        """It has come further."""
        self.progress = progress
        if progress.terms and (not self.losses or progress.terms is not self.losses[-1][1]):
            self.losses.append((progress.elapsed, progress.terms))
