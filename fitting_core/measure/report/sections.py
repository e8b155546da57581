"""The parts of the report: the verdict in large figures, the paper's table, plots, pictures, tables."""

from collections.abc import Sequence
from dataclasses import dataclass

from fitting_core.measure.comparison import figure_titles
from fitting_core.measure.curves import CURVES
from fitting_core.measure.records import (
    Evaluation,
    Record,
    baseline_of,
    methods,
    motions,
    of,
    overall,
    pooled,
    sequences,
    wins,
)
from fitting_core.measure.report.markup import Markup, joined, markup, number, table, tag
from fitting_core.measure.report.plots import Series, legend, line_plot, style_of

SURFACE, VOLUME = "vertex_to_surface", "volume_error"
MOTION_TITLES = {"simple": "Simple Motion", "complex": "Complex Motion", "signing": "Signing", "": "This clip"}
PAPER: dict[str, dict[str, tuple[float, float]]] = {
    "simple": {"SMPLify-X": (3.36, 0.91), "paper": (2.59, 0.81)},
    "complex": {"SMPLify-X": (7.83, 6.62), "paper": (5.04, 2.52)},
}
"""What the paper reports for its own sequences (its table of vertex-to-surface errors): mean and deviation, cm."""
_CARD_CURVES = ((SURFACE, "vertex-to-surface error", "cm"), (VOLUME, "volume error", "dm³"))
_WITHOUT_SURFACE = (("pa_mpjpe", "PA-MPJPE", "mm"), ("mpjpe", "MPJPE", "mm"))


def verdict(records: Sequence[Record]) -> Markup:
    """Cards: the last method against the baseline, by motion."""
    base, best = baseline_of(records), methods(records)[-1]
    if base == best:
        return Markup()
    curves = _CARD_CURVES if any(r.curve(SURFACE) is not None for r in records) else _WITHOUT_SURFACE
    cards = [
        _card(of(records, motion=motion), base, best, curve, f"{MOTION_TITLES.get(motion, motion)}, {title}", unit)
        for motion in motions(records)
        for curve, title, unit in curves
    ]
    won = wins(records, best, base, f"{curves[0][0]}_mean")
    if won and won[1] > 1:
        said = tag("b", f"{won[0]} of {won[1]}"), tag("span", f"sequences on which {best} is better than {base}")
        cards.insert(0, tag("div", *said, class_="card"))
    return tag("div", joined(cards), class_="cards")


def _card(records: Sequence[Record], base: str, best: str, curve: str, title: str, unit: str) -> Markup:
    before, after = (pooled(of(records, method=name), curve) for name in (base, best))
    if before is None or after is None:
        return Markup()
    change = 100 * (after / before - 1) if before else 0.0
    marked = tag("em", f"{change:+.0f}\u202f%".replace("-", "−"), class_="worse" if change > 0 else None)
    shown = tag("b", f"{number(before, 2)} → {number(after, 2)} ", tag("i", unit), marked)
    return tag("div", shown, tag("span", f"{title}: {base} → {best}"), class_="card")


def paper_table(records: Sequence[Record]) -> Markup:
    """The paper's table: for each motion and method mean and deviation over all frames, and who wins."""
    base = baseline_of(records)
    head = ("", "vertex-to-surface, cm", "std", "volume error, dm³", "PA-MPJPE, mm", "MPJPE, mm", "better on")
    rows: list[list[object]] = []
    for motion in motions(records):
        some = of(records, motion=motion)
        rows.append([Markup(f'<td class="head" colspan="7">{markup(MOTION_TITLES.get(motion, motion))}</td>')])
        found = {name: _row(of(some, method=name)) for name in methods(some)}
        best = [min((v for row in found.values() if (v := row[i]) is not None), default=None) for i in range(5)]
        for name, values in found.items():
            won = wins(some, name, base, f"{SURFACE}_mean") or wins(some, name, base, "pa_mpjpe_mean")
            told = "" if name == base or won is None else f"{won[0]} of {won[1]}"
            rows.append([name, *(_best(v, v == b and len(found) > 1) for v, b in zip(values, best, strict=True)), told])
        for name, (mean, deviation) in PAPER.get(motion, {}).items():
            cells = (f"{name} in the paper, on MoVi", f"{mean:.2f}", f"{deviation:.2f}", "", "", "", "")
            rows.append([tag("td", cells[0], class_="dim"), *(tag("td", c, class_="n dim") for c in cells[1:])])
    return table(head, rows)


def _row(records: Sequence[Record]) -> list[float | None]:
    surface = [pooled(records, SURFACE, statistic) for statistic in ("mean", "std")]
    return [*surface, *(pooled(records, curve) for curve in (VOLUME, "pa_mpjpe", "mpjpe"))]


def _best(value: float | None, best: bool) -> Markup:
    digits = None if value is None else 2 if abs(value) < 10 else 1
    return tag("td", number(value, digits), class_="n best" if best and value is not None else "n")


@dataclass(frozen=True, kw_only=True)
class BodyPicture:
    """A picture of one body in one frame."""

    title: str
    picture: str
    """As a data URI."""


@dataclass(frozen=True, kw_only=True)
class WorstFrame:
    """A frame in which some method was far off."""

    title: str
    note: str
    rows: tuple[tuple[BodyPicture, ...], ...]


def section(title: str, *content: Markup, note: str = "") -> Markup:
    """A part of the page with its heading, and below it what its content is."""
    return joined([tag("h2", title), tag("p", note, class_="dim") if note else Markup(), *content])


def together(evaluation: Evaluation, curves: Sequence[tuple[str, str]]) -> Markup:
    """All curves of an evaluation of one sequence; arguments of `timed` in pairs."""
    records = evaluation.records
    figures = [figure for curve, truth in curves for figure in timed(records, curve, truth, size=(580.0, 210.0))]
    return joined([legend_of(methods(records), truth=True), tag("div", *figures, class_="grid pair")])


def timed(records: Sequence[Record], curve: str, truth: str, *, size: tuple[float, float]) -> list[Markup]:
    """A curve over the frames, a plot for each sequence.

    Args:
        records: Of all sequences.
        curve: One of CURVES.
        truth: Another of CURVES, which is the truth's own and is drawn once; empty: none.
        size: Of each plot.
    """
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
            title=name, style="truth" if name == "truth" else style_of(name, names), values=[values[i] for i in kept]
        )
        for name, values in lines.items()
    ]
    frames = [first.comparison.first_frame + i for i in kept]
    plot = line_plot(
        frames, drawn, x_title="frame", y_title=f"{kind.title}, {kind.unit}", size=size, from_zero=not truth
    )
    note = tag("span", f" {first.frames} frames")
    return tag("figure", tag("figcaption", first.sequence, note), plot)


def legend_of(names: Sequence[str], *, truth: bool = False) -> Markup:
    """What the methods' colours are."""
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
