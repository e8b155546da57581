"""The axes of a plot: round ticks, and numbers turned into places."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from fitting_core.measure.report.markup import Markup, joined, tag

_STEPS = (1, 2, 2.5, 5, 10)


def ticks(low: float, high: float, *, about: int = 5) -> list[float]:
    """Round numbers from at most `low` to at least `high`, about so many."""
    span = high - low if high > low else abs(high) or 1.0
    raw = span / max(1, about - 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in _STEPS if s * power >= raw * (1 - 1e-9))
    first, last = math.floor(low / step + 1e-9), math.ceil((high if high > low else low + span) / step - 1e-9)
    return [step * i for i in range(first, last + 1)]


def decades(low: float, high: float) -> list[float]:
    """Powers of ten around positive numbers."""
    first, last = math.floor(math.log10(low) + 1e-9), math.ceil(math.log10(high) - 1e-9)
    return [10.0**i for i in range(first, max(last, first + 1) + 1)]


def label(value: float, step: float) -> str:
    """A tick's number with as many digits as its step needs."""
    digits = next((d for d in range(9) if abs(step * 10**d - round(step * 10**d)) < 1e-6 * 10**d * abs(step)), 9)
    return f"{value:.{digits}f}".replace("-", "−")


@dataclass(frozen=True, kw_only=True)
class Scale:
    """From numbers to places along an axis."""

    marks: tuple[float, ...]
    """Ticks, lowest first; the ends of the axis."""
    start: float
    stop: float
    """Places of the lowest and the highest tick."""
    logarithmic: bool = False

    def __call__(self, value: float) -> float:
        """The place of a number."""
        low, high = self.marks[0], self.marks[-1]
        if self.logarithmic:
            value, low, high = math.log10(value), math.log10(low), math.log10(high)
        return self.start + (value - low) / (high - low) * (self.stop - self.start)

    def labels(self) -> list[str]:
        """The ticks' numbers."""
        if self.logarithmic:
            return [f"{mark:g}" for mark in self.marks]
        return [label(mark, self.marks[1] - self.marks[0]) for mark in self.marks]


def scale_of(
    values: Iterable[float], start: float, stop: float, *, from_zero: bool = False, logarithmic: bool = False
) -> Scale:
    """A scale that holds some numbers, at least one."""
    known = list(values)
    low, high = min(known), max(known)
    marks = decades(low, high) if logarithmic else ticks(0.0 if from_zero else low, high)
    return Scale(marks=tuple(marks), start=start, stop=stop, logarithmic=logarithmic)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """The rectangle of a plot within its picture, in the picture's own units."""

    width: float
    height: float
    left: float = 46.0
    right: float = 10.0
    top: float = 26.0
    bottom: float = 34.0

    def y_axis(self, scale: Scale, title: str) -> Markup:
        """Lines across the plot with their numbers, and what they mean above them."""
        parts = [tag("text", title, x=0.0, y=12.0, class_="title")]
        for mark, text in zip(scale.marks, scale.labels(), strict=True):
            y = scale(mark)
            parts += [
                tag("line", x1=self.left, x2=self.width - self.right, y1=y, y2=y, class_="grid"),
                tag("text", text, x=self.left - 6, y=y + 3.5, text_anchor="end"),
            ]
        return joined(parts)

    def x_axis(self, places: Sequence[tuple[float, str]], title: str) -> Markup:
        """Numbers or names below the plot, and what they mean at the right."""
        bottom = self.height - self.bottom
        parts = [tag("line", x1=self.left, x2=self.width - self.right, y1=bottom, y2=bottom, class_="axis")]
        parts += [tag("text", text, x=x, y=bottom + 14, text_anchor="middle") for x, text in places]
        right = self.width - self.right
        parts.append(tag("text", title, x=right, y=bottom + 29, text_anchor="end", class_="title"))
        return joined(parts)
