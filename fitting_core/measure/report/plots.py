"""Plots as SVG: lines and bars with axes and units. Their colours are classes, so that they follow the page's theme."""

from collections.abc import Sequence
from dataclasses import dataclass

from fitting_core.measure.report.axes import Frame, Scale, scale_of
from fitting_core.measure.report.markup import Markup, joined, tag

Values = Sequence[float | None]
"""None where there is nothing to draw."""


@dataclass(frozen=True, kw_only=True)
class Series:
    """One line of a plot, or one bar of each group."""

    title: str
    style: str
    """Class of its colour and stroke, one of the page's (`style.STYLES`)."""
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
    up = _up(series, frame, from_zero)
    drawn = [frame.y_axis(up, y_title), frame.x_axis(_places(across), x_title)]
    for line in series:
        points = [
            (across(a), up(value)) if value is not None else None for a, value in zip(x, line.values, strict=True)
        ]
        drawn.append(tag("path", tag("title", line.title), d=_path(points), class_=f"line {line.style}"))
        if dots:
            told = [(*p, v) for p, v in zip(points, line.values, strict=True) if p and v is not None]
            drawn += [_dot(px, py, f"{line.title}: {v:.3g}", line.style) for px, py, v in told]
    return _picture(frame, drawn, f"{y_title} over {x_title}")


def bar_plot(
    groups: Sequence[str],
    series: Sequence[Series],
    *,
    y_title: str,
    x_title: str = "",
    size: tuple[float, float] = (780.0, 240.0),
) -> Markup:
    """Bars beside each other, a group for each name.

    Args:
        groups: What stands below them.
        series: Each with a value for every group.
        y_title: What the values are, with their unit.
        x_title: What the groups are.
        size: Of the picture; it scales.
    """
    frame = Frame(width=size[0], height=size[1])
    up = _up(series, frame, True)
    room = (size[0] - frame.left - frame.right) / max(1, len(groups))
    wide = min(26.0, 0.76 * room / max(1, len(series)))
    drawn = [frame.y_axis(up, y_title)]
    middles = [frame.left + (i + 0.5) * room for i in range(len(groups))]
    for k, one in enumerate(series):
        for middle, group, value in zip(middles, groups, one.values, strict=True):
            if value is not None:
                x = middle + (k - len(series) / 2) * wide
                drawn.append(_bar(x, up(value), wide - 1.5, up(0.0), f"{group}, {one.title}: {value:.3g}", one.style))
    drawn.append(frame.x_axis(list(zip(middles, groups, strict=True)), x_title))
    return _picture(frame, drawn, f"{y_title} by {x_title or 'group'}")


def legend(series: Sequence[tuple[str, str]]) -> Markup:
    """What the colours mean: titles and styles."""
    return tag(
        "p",
        *(
            tag(
                "span",
                tag(
                    "svg",
                    tag("path", d="M1 6H23", class_=f"line {style}"),
                    viewBox="0 0 24 12",
                    aria_hidden="true",
                ),
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


def _up(series: Sequence[Series], frame: Frame, from_zero: bool) -> Scale:
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


def _dot(x: float, y: float, title: str, style: str) -> Markup:
    return tag("circle", tag("title", title), cx=x, cy=y, r=3.0, class_=f"fill {style}")


def _bar(x: float, y: float, width: float, bottom: float, title: str, style: str) -> Markup:
    height = max(0.0, bottom - y)
    return tag("rect", tag("title", title), x=x, y=y, width=width, height=height, class_=f"fill {style}")


def _picture(frame: Frame, parts: Sequence[Markup], described: str) -> Markup:
    box = f"0 0 {frame.width:g} {frame.height:g}"
    return tag("svg", joined(parts), viewBox=box, role="img", aria_label=described, class_="plot")
