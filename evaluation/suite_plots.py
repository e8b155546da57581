"""The plots of a report on many sequences: bars by sequence, and curves over the frames of each."""

from collections.abc import Sequence

from fitting_core.measure.curves import CURVES
from fitting_core.measure.records import BASELINE, PHASE_1, Evaluation, Record, methods, motions, of, sequences
from fitting_core.measure.report.markup import Markup, joined, tag
from fitting_core.measure.report.page import OVER_TIME
from fitting_core.measure.report.plots import Frame, Series, picture, style_of, y_scale
from fitting_core.measure.report.sections import MOTION_TITLES, SURFACE, VOLUME, legend_of, section, timed


def plots(evaluation: Evaluation) -> list[Markup]:
    """All sections."""
    shown = [
        (title, bars(evaluation, curve))
        for curve, title in ((SURFACE, "Error by sequence"), (VOLUME, "Volume error by sequence"))
    ]
    if len(sequences(evaluation.records)) > 1:
        shown += [(title, over_time(evaluation, curve, truth=truth)) for curve, truth, title in OVER_TIME]
    return [section(title, content) for title, content in shown if content]


def bars(evaluation: Evaluation, curve: str) -> Markup:
    """Means by sequence, one plot for each motion."""
    records = evaluation.records
    if len(sequences(records)) < 2:
        return Markup()
    names, kind = methods(records), CURVES[curve]
    figures = []
    for motion in motions(records):
        some = of(records, motion=motion)
        groups = sequences(some)
        drawn = [
            Series(
                title=name, style=style_of(name, names), values=[_mean(some, name, group, curve) for group in groups]
            )
            for name in names
        ]
        if any(value is not None for series in drawn for value in series.values):
            title = f"Mean {kind.title.lower()}, {kind.unit}"
            caption = tag("figcaption", MOTION_TITLES.get(motion, motion))
            width = 96.0 + len(groups) * max(40, 17 * len(names) + 22)
            plot = bar_plot(groups, drawn, y_title=title, size=(max(width, 380.0), 230.0))
            figures.append(tag("figure", caption, plot, style=f"flex: 0 1 {max(width, 380.0):.0f}px"))
    return joined([legend_of(names), tag("div", *figures, class_="row")]) if figures else Markup()


def _mean(records: Sequence[Record], method: str, sequence: str, curve: str) -> float | None:
    found = of(records, method=method, sequence=sequence)
    return found[0].comparison.figures.get(f"{curve}_mean") if found else None


def over_time(evaluation: Evaluation, curve: str, *, truth: str = "") -> Markup:
    """A curve over the frames of every sequence.

    Args:
        evaluation: Of which.
        curve: One of CURVES.
        truth: Another of CURVES, which is the truth's own and is drawn once.
    """
    records = _compared(evaluation.records)
    figures = timed(records, curve, truth, size=(380.0, 200.0))
    names = [name for name in methods(records) if any(r.curve(curve) is not None for r in of(records, method=name))]
    return joined([legend_of(names, truth=bool(truth)), tag("div", *figures, class_="grid")]) if figures else Markup()


def _compared(records: Sequence[Record]) -> list[Record]:
    """Where there is a baseline, first phases of other presets would only crowd a plot of many lines."""
    names = methods(records)
    return [r for r in records if BASELINE not in names or not r.method.endswith(PHASE_1)]


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
    up = y_scale(series, frame, True)
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
    return picture(frame, drawn, f"{y_title} by {x_title or 'group'}")


def _bar(x: float, y: float, width: float, bottom: float, title: str, style: str) -> Markup:
    height = max(0.0, bottom - y)
    return tag("rect", tag("title", title), x=x, y=y, width=width, height=height, class_=f"fill {style}")
