"""The parts of the report below its head: plots, pictures, tables."""

from collections.abc import Sequence
from dataclasses import dataclass

from fitting_core.measure.comparison import figure_titles
from fitting_core.measure.curves import CURVES
from fitting_core.measure.records import BASELINE, PHASE_1, Evaluation, Record, methods, motions, of, overall, sequences
from fitting_core.measure.report.markup import Markup, joined, markup, number, table, tag
from fitting_core.measure.report.plots import Series, bar_plot, legend, line_plot
from fitting_core.measure.report.style import style_of
from fitting_core.measure.report.summary import MOTION_TITLES


@dataclass(frozen=True, kw_only=True)
class View:
    """A picture of one body in one frame."""

    title: str
    picture: str
    """As a data URI."""


@dataclass(frozen=True, kw_only=True)
class WorstFrame:
    """A frame in which some method was far off."""

    title: str
    note: str
    rows: tuple[tuple[View, ...], ...]


def section(title: str, *content: Markup, note: str = "") -> Markup:
    """A part of the page with its heading, and below it what its content is."""
    return joined([tag("h2", title), tag("p", note, class_="dim") if note else Markup(), *content])


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
    return joined([_legend(names), tag("div", *figures, class_="row")]) if figures else Markup()


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
    figures = _all_timed(records, curve, truth, size=(380.0, 200.0))
    names = [name for name in methods(records) if any(r.curve(curve) is not None for r in of(records, method=name))]
    return joined([_legend(names, truth=bool(truth)), tag("div", *figures, class_="grid")]) if figures else Markup()


def together(evaluation: Evaluation, curves: Sequence[tuple[str, str]]) -> Markup:
    """All curves of an evaluation of one sequence; arguments of `over_time` in pairs."""
    records = evaluation.records
    figures = [figure for curve, truth in curves for figure in _all_timed(records, curve, truth, size=(580.0, 210.0))]
    return joined([_legend(methods(records), truth=True), tag("div", *figures, class_="grid pair")])


def _compared(records: Sequence[Record]) -> list[Record]:
    """Where there is a baseline, first phases of other presets would only crowd a plot of many lines."""
    names = methods(records)
    return [r for r in records if BASELINE not in names or not r.method.endswith(PHASE_1)]


def _all_timed(records: Sequence[Record], curve: str, truth: str, *, size: tuple[float, float]) -> list[Markup]:
    groups = [of(records, sequence=sequence) for sequence in sequences(records)]
    return [
        _timed(own, methods(records), curve, truth, size)
        for own in groups
        if any(r.curve(curve) is not None for r in own)
    ]


def _timed(records: Sequence[Record], names: list[str], curve: str, truth: str, size: tuple[float, float]) -> Markup:
    kind, first = CURVES[curve], records[0]
    lines = {r.method: r.comparison.curves[curve] for r in records if curve in r.comparison.curves}
    if truth in first.comparison.curves:
        lines = {"truth": first.comparison.curves[truth]} | lines
    # Between frames that were measured lines go on: surfaces may be measured in every so many alone.
    kept = [i for i in range(first.frames) if any(values[i] is not None for values in lines.values())]
    drawn = [
        Series(
            title=name,
            style="truth" if name == "truth" else style_of(name, names),
            values=[values[i] for i in kept],
        )
        for name, values in lines.items()
    ]
    frames = [first.comparison.first_frame + i for i in kept]
    plot = line_plot(
        frames, drawn, x_title="frame", y_title=f"{kind.title}, {kind.unit}", size=size, from_zero=not truth
    )
    note = tag("span", f" {first.frames} frames")
    return tag("figure", tag("figcaption", first.sequence, note), plot)


def _legend(names: Sequence[str], *, truth: bool = False) -> Markup:
    entries = [(name, style_of(name, list(names))) for name in names]
    return legend([*([("truth", "truth")] if truth else []), *entries])


def worst_frames(frames: Sequence[WorstFrame]) -> Markup:
    """Bodies side by side."""
    figures = []
    for frame in frames:
        rows = (
            tag(
                "div",
                *(tag("div", tag("b", v.title), tag("img", src=v.picture, alt=v.title)) for v in row),
                class_="views",
            )
            for row in frame.rows
        )
        figures.append(tag("figure", tag("figcaption", frame.title, tag("span", f" {frame.note}")), *rows))
    return tag("div", *figures, class_="worst")


def all_figures(evaluation: Evaluation) -> Markup:
    """Every figure of every record, one table for each motion."""
    records, titles = evaluation.records, figure_titles()
    parts = []
    for motion in motions(records):
        some = of(records, motion=motion)
        names = methods(some)
        rows = []
        for figure, (title, unit, better) in titles.items():
            values = [overall(of(some, method=name), figure) for name in names]
            if any(value is not None for value in values):
                known = [v for v in values if v is not None]
                best = number(min(known)) if better and len(known) > 1 else ""
                cells = (tag("td", number(v), class_="n best" if number(v) == best else "n") for v in values)
                rows.append([joined([markup(title), tag("span", f" {unit}", class_="dim")]), *cells])
        parts += [tag("h3", MOTION_TITLES.get(motion, motion)), table(("", *names), rows)]
    return joined(parts)


def provenance(evaluation: Evaluation) -> Markup:
    """How the figures came about."""
    rows = [(key, tag("td", tag("code", value))) for key, value in evaluation.settings.items()]
    return table(("", ""), rows)
