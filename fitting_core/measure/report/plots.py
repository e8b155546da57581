"""Plots as SVG: lines with axes, round ticks and units, in the page's colours.

Colours are classes: one set for light and one for dark, both readable with red-green blindness (report.css).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fitting_core.measure.report.markup import Markup, joined, tag

STYLES = {
    "SMPLify-X": "red",
    "paper, phase 1": "violet dashed",
    "paper": "violet",
    "tcfit, phase 1": "blue dashed",
    "tcfit": "blue",
    "phase 1": "red",
    "final": "blue",
    "truth": "truth",
}
"""Classes of methods' colours and strokes; the truth stands beside them."""
_MORE = ("teal", "amber", "pink", "grey")


def style_of(method: str, methods: list[str]) -> str:
    """The class of a method; those without a colour of their own take the next free one."""
    if method in STYLES:
        return STYLES[method]
    others = [name for name in methods if name not in STYLES]
    return _MORE[others.index(method) % len(_MORE)]


CSS = Path(__file__).with_name("report.css").read_text(encoding="utf-8")


_STEPS = (1, 2, 2.5, 5, 10)


def ticks(low: float, high: float) -> list[float]:
    """About five round numbers, from at most `low` to at least `high`."""
    span = high - low if high > low else abs(high) or 1.0
    raw = span / 4
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


Values = Sequence[float | None]
"""None where there is nothing to draw."""


@dataclass(frozen=True, kw_only=True)
class Series:
    """One line of a plot."""

    title: str
    style: str
    """Class of its colour and stroke, one of STYLES or the page's other ones."""
    values: Values


def line_plot(
    x: Sequence[float],
    series: Sequence[Series],
    *,
    x_title: str,
    y_title: str,
    size: tuple[float, float] = (380.0, 200.0),
    from_zero: bool = False,
    logarithmic: bool = False,
    dots: bool = False,
) -> Markup:
    """Numbers over a common axis.

    Args:
        x: Place of each value; above 0 where the axis is logarithmic.
        series: Each with as many values.
        x_title: What x is, with its unit.
        y_title: What the values are, with their unit.
        size: Of the picture; it scales.
        from_zero: Whether the y axis must show 0.
        logarithmic: Whether the x axis is.
        dots: Mark every value, for few of them.
    """
    frame = Frame(width=size[0], height=size[1])
    across = _across(x, frame, logarithmic, every=dots)
    up = y_scale(series, frame, from_zero)
    drawn = [frame.y_axis(up, y_title), frame.x_axis(_places(across), x_title)]
    for line in series:
        points = [
            (across(a), up(value)) if value is not None else None for a, value in zip(x, line.values, strict=True)
        ]
        drawn.append(tag("path", tag("title", line.title), d=_path(points), class_=f"line {line.style}"))
        if dots:
            drawn += [
                tag(
                    "circle",
                    tag("title", f"{line.title}: {v:.3g}"),
                    cx=p[0],
                    cy=p[1],
                    r=3.0,
                    class_=f"fill {line.style}",
                )
                for p, v in zip(points, line.values, strict=True)
                if p is not None
            ]
    return picture(frame, drawn, f"{y_title} over {x_title}")


def legend(series: Sequence[tuple[str, str]]) -> Markup:
    """What the colours mean: titles and styles."""
    return tag(
        "p",
        *(
            tag(
                "span",
                tag("svg", tag("path", d="M1 6H23", class_=f"line {style}"), viewBox="0 0 24 12", aria_hidden="true"),
                title,
            )
            for title, style in series
        ),
        class_="legend",
    )


def _across(x: Sequence[float], frame: Frame, logarithmic: bool, *, every: bool) -> Scale:
    """Ticks at every value, or at round ones."""
    start, stop = frame.left, frame.width - frame.right
    if every and len(set(x)) > 1:
        return Scale(marks=tuple(sorted(set(x))), start=start, stop=stop, logarithmic=logarithmic)
    if logarithmic:
        return scale_of(x, start, stop, logarithmic=True)
    # A time axis ends where its frames do; its round numbers stand within.
    inner = scale_of(x, start, stop)
    low, high = min(x), max(x)
    marks = (low, *(mark for mark in inner.marks if low < mark < high), high)
    return Scale(marks=marks if high > low else inner.marks, start=start, stop=stop)


def _places(scale: Scale) -> list[tuple[float, str]]:
    """Ticks with numbers, without those that would run into the last one."""
    told = [(scale(mark), f"{mark:g}") for mark in scale.marks]
    return [place for place in told[:-1] if told[-1][0] - place[0] > 28] + told[-1:]


def y_scale(series: Sequence[Series], frame: Frame, from_zero: bool) -> Scale:
    """Upwards in a plot, with room for all values."""
    values = [value for one in series for value in one.values if value is not None]
    return scale_of(values or [0.0, 1.0], frame.height - frame.bottom, frame.top, from_zero=from_zero)


def _path(points: Sequence[tuple[float, float] | None]) -> str:
    """Lines through the points, broken where there is none."""
    pieces: list[str] = []
    pen_down = False
    for point in points:
        if point is not None:
            pieces.append(f"{'L' if pen_down else 'M'}{point[0]:.1f} {point[1]:.1f}")
        pen_down = point is not None
    return "".join(pieces)


def picture(frame: Frame, parts: Sequence[Markup], described: str) -> Markup:
    """A plot of its parts; who does not see it is told what it is."""
    box = f"0 0 {frame.width:g} {frame.height:g}"
    return tag("svg", joined(parts), viewBox=box, role="img", aria_label=described, class_="plot")
