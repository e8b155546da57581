"""Measured fits of one or many sequences, and the figures that are taken over several of them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from fitting_core.measure.comparison import Comparison, statistic_of

BASELINE = "SMPLify-X"
"""Every frame on its own, with that method's weights."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """One fit of one sequence, measured."""

    sequence: str
    motion: str
    """"simple", "complex", "signing"; empty for a clip outside the suite."""
    method: str
    """For the user: BASELINE, "tcfit", "tcfit, phase 1"."""
    frames: int
    frame_rate: float
    seconds: float
    """Time of the fit up to this phase."""
    comparison: Comparison

    def curve(self, name: str) -> Float[np.ndarray, "T"] | None:
        """A curve with NaN for missing values; None if it was not measured."""
        values = self.comparison.curves.get(name)
        return None if values is None else np.array([np.nan if v is None else v for v in values])


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Content of a report."""

    title: str
    records: tuple[Record, ...]
    settings: dict[str, str] = field(default_factory=dict)
    """How it came about, for the user."""
    notes: tuple[str, ...] = ()


def methods(records: Iterable[Record]) -> list[str]:
    """The methods, in the order in which they come."""
    return list(dict.fromkeys(record.method for record in records))


def motions(records: Iterable[Record]) -> list[str]:
    """The motions, in the order in which they come."""
    return list(dict.fromkeys(record.motion for record in records))


def sequences(records: Iterable[Record]) -> list[str]:
    """The sequences, in the order in which they come."""
    return list(dict.fromkeys(record.sequence for record in records))


def of(
    records: Iterable[Record], *, method: str | None = None, motion: str | None = None, sequence: str | None = None
) -> list[Record]:
    """Those of one method, motion, sequence."""
    return [
        r
        for r in records
        if (method is None or r.method == method)
        and (motion is None or r.motion == motion)
        and (sequence is None or r.sequence == sequence)
    ]


def pooled(records: Sequence[Record], curve: str, statistic: str = "mean") -> float | None:
    """Mean or standard deviation over all frames of several records, as the paper's table has them."""
    found = [values for r in records if (values := r.curve(curve)) is not None]
    return statistic_of(np.concatenate(found), statistic) if found else None


def overall(records: Sequence[Record], figure: str) -> float | None:
    """A figure of several sequences: over all frames if it is a statistic of a curve, else the mean of theirs."""
    curve, _, statistic = figure.rpartition("_")
    if any(curve in r.comparison.curves for r in records):
        return pooled(records, curve, statistic)
    values = [v for r in records if (v := r.comparison.figures.get(figure)) is not None]
    return float(np.mean(values)) if values else None


def number(value: float | None, digits: int | None = None) -> str:
    """Three significant digits, or a number of digits after the point; a dash if there is no value."""
    if value is None:
        return "–"
    if digits is None:
        digits = 0 if abs(value) >= 100 else 1 if abs(value) >= 10 else 2 if abs(value) >= 0.1 else 3
    return f"{value:.{digits}f}".replace("-", "−")
