"""What those who fit a batch's clips tell the one who runs it."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from tcfit_app.batch.manifest import ClipTask
from tcfit_app.batch.records import Record


@dataclass(frozen=True, kw_only=True)
class Underway:
    """A clip is being fitted."""

    index: int
    """Which of the tasks."""
    phase: int = 0
    """0: it has only begun."""
    share: float = 0.0
    """Of the phase."""


@dataclass(frozen=True, kw_only=True)
class Ended:
    """A clip is done, or has failed."""

    index: int
    record: Record


News = Underway | Ended


class Crew(Protocol):
    """Fits clips, several at a time."""

    def run(self, tasks: Sequence[ClipTask], folder: Path) -> Generator[News, None, None]:
        """Fits them all; closing the generator stops at once, and leaves nothing half-done that matters.

        Args:
            tasks: Each ends exactly once.
            folder: The batch's.
        """
        ...
