"""The bench's figures as tables on a terminal."""

import math
import re
from collections.abc import Iterator, Sequence

from rich.table import Table

from tcfit_app.bench.figures import Comparison, Figure, compared

_LENGTH = re.compile(r"fit (\d+) frames, (.*)")


def figure_table(figures: Sequence[Figure]) -> Table:
    """Median and range of every figure."""
    table = _table("Measured", "", "median", "range", "unit")
    for figure in figures:
        table.add_row(figure.name, number(figure.median), _range(figure), figure.unit)
    return table


def growth_table(figures: Sequence[Figure]) -> Table | None:
    """What a frame costs in longer clips, as ratios to the shortest: 1 is a cost in proportion to the length.

    None without at least two lengths.
    """
    found = [(int(m[1]), m[2], f) for f in figures if (m := _LENGTH.fullmatch(f.name))]
    lengths = sorted({frames for frames, _, _ in found})
    if len(lengths) < 2:
        return None
    table = _table("Growth with the length, as ratios", "", *(f"{frames} frames" for frames in lengths))
    for what in dict.fromkeys(what for _, what, _ in found if what != "objective"):
        medians = {frames: figure.median for frames, name, figure in found if name == what}
        table.add_row(what, *(_ratio(medians[frames], medians[lengths[0]]) for frames in lengths))
    return table


def comparison_tables(figures: Sequence[Figure]) -> Iterator[Table]:
    """Every variant against the first: figures are named "variant, what"."""
    by_variant: dict[str, list[Figure]] = {}
    for figure in figures:
        variant, _, what = figure.name.partition(", ")
        by_variant.setdefault(variant, []).append(Figure(name=what, unit=figure.unit, values=figure.values))
    first, *others = by_variant
    for other in others:
        yield ratio_table(f"{other} against {first}", first, other, compared(by_variant[first], by_variant[other]))


def ratio_table(title: str, before: str, now: str, comparisons: Sequence[Comparison]) -> Table:
    """Two measurements of the same, and their ratio.

    Args:
        title: Above the table.
        before: What the first is called.
        now: What the second is called.
        comparisons: The rows.
    """
    table = _table(title, "", before, now, "ratio", "", "unit")
    for c in comparisons:
        table.add_row(
            c.name,
            f"{number(c.before.median)} ({_range(c.before, '-')})",
            f"{number(c.now.median)} ({_range(c.now, '-')})",
            "-" if c.ratio is None else f"{c.ratio:.2f}",
            c.verdict,
            c.unit,
        )
    return table


def _table(title: str, *columns: str) -> Table:
    table = Table(*columns, title=title, title_justify="left")
    table.columns[0].no_wrap = True
    for column in table.columns[1:]:
        column.justify = "right"
    return table


def number(value: float) -> str:
    """Three digits that count."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"


def _range(figure: Figure, between: str = " to ") -> str:
    low, high = figure.range
    return f"{number(low)}{between}{number(high)}"


def _ratio(value: float, reference: float) -> str:
    return f"{value / reference:.2f}" if reference else "-"
