"""The progress of fits and other work, the same in the terminal, in `--json`, in the list of clips and in the app."""

from collections import deque
from collections.abc import Sequence

from fitting_core.fit.events import FitEvent, Iteration, PhaseFinished, PhaseStarted

KEYPOINTS = 0
"""The detection of keypoints before phase 1, if it belongs to the job."""
PHRASES = {KEYPOINTS: "finding keypoints", 1: "first pass", 2: "one shape", 3: "final fit"}
_WEIGHTS = {KEYPOINTS: 3.0, 1: 0.60, 2: 0.04, 3: 0.36}
"""Relative times: processor time of the demo clip's phases with preset tcfit; detector mediapipe."""
_SHORTEST = 3.0
"""Seconds over which estimates must agree before one is shown."""
_SPAN = 0.2
"""The same as a fraction of the time worked."""
_AGREEMENT, _SLACK = 0.25, 2.0
"""Largest difference of two agreeing estimates: a fraction of the remaining time, and seconds."""


class Progress:
    """One fraction that never decreases, and the remaining time once its estimate is stable."""

    def __init__(self) -> None:
        self.fraction = 0.0
        """0 to 1."""
        self._begun: tuple[float, float] | None = None
        """Seconds and fraction when the fraction first advanced: reading and setting up have another speed."""
        self._ends = deque[tuple[float, float]]()
        """Recent estimates: when each was made, and the time at which the work will end."""
        self._now, self._end = 0.0, float("nan")

    @property
    def remaining(self) -> float | None:
        """Seconds; None while estimates differ. Counts down between estimates."""
        return max(0.0, self._end - self._now) if self._end == self._end else None

    def worked(self, seconds: float) -> None:
        """Set the time worked so far, without pauses."""
        self._now = max(self._now, seconds)

    def advance(self, fraction: float) -> None:
        """So much has been done in the time worked."""
        self.fraction = max(self.fraction, min(1.0, fraction))
        if self._begun is None or self._begun[1] == self.fraction:
            self._begun = self._now, self.fraction
        else:
            self._estimate(*self._begun)

    def _estimate(self, begin: float, from_: float) -> None:
        worked = self._now - begin
        rest = worked * (1 - self.fraction) / (self.fraction - from_)
        self._ends.append((self._now, self._now + rest))
        since = self._now - max(_SHORTEST, _SPAN * worked)
        while len(self._ends) > 1 and self._ends[1][0] <= since:
            self._ends.popleft()
        tolerance = _AGREEMENT * rest + _SLACK
        ends = [end for _, end in self._ends]
        if self._ends[0][0] > since or max(ends) - min(ends) > tolerance:
            self._end = float("nan")
        elif not abs(self._end - ends[-1]) <= tolerance:
            self._end = ends[-1]


class FitProgress(Progress):
    """The progress of a fit.

    Args:
        phases: What the fit runs, in order: phases, after KEYPOINTS if these are detected first.
    """

    def __init__(self, phases: Sequence[int]) -> None:
        super().__init__()
        self._weights = {phase: _WEIGHTS[phase] for phase in phases}
        self.phase = phases[0]

    @property
    def phrase(self) -> str:
        """What is being done."""
        return PHRASES[self.phase]

    def detected(self, share: float, seconds: float) -> None:
        """Update from the detection before the fit: its share, and the time worked so far."""
        self.worked(seconds)
        self._advance(KEYPOINTS, share)

    def take(self, event: FitEvent, seconds: float) -> None:
        """Update from an event.

        Args:
            event: Of the fit.
            seconds: Time worked so far, without pauses.
        """
        self.worked(seconds)
        if isinstance(event, PhaseStarted):
            self.phase = event.phase
        elif isinstance(event, Iteration):
            self._advance(event.phase, event.share)
        elif isinstance(event, PhaseFinished):
            self._advance(event.phase, 1.0)

    def _advance(self, phase: int, share: float) -> None:
        before = sum(weight for p, weight in self._weights.items() if p < phase)
        self.phase = phase
        self.advance((before + share * self._weights.get(phase, 0.0)) / sum(self._weights.values()))


def in_words(phrase: str, remaining: float | None) -> str:
    """What is being done, and the remaining time if it is known."""
    left = time_left(remaining)
    return f"{phrase}, {left}" if left else phrase


def time_left(seconds: float | None) -> str:
    """The remaining time in words, coarse; empty if it is unknown."""
    if seconds is None:
        return ""
    if seconds < 10:
        return "a few seconds left"
    if seconds < 55:
        return f"about {round(seconds, -1):.0f} s left"
    minutes = round(seconds / 60)
    return f"about {minutes} min left" if minutes < 90 else f"about {minutes / 60:.1f} h left"


def duration(seconds: float) -> str:
    """A time in words: "8 s", "2 min 5 s"."""
    whole = round(seconds)
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60} s"
