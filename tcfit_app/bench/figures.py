"""Figures with their repetitions: what a run of the bench comes to, as a file and compared with another one."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import msgspec
import numpy as np
from rich.table import Table

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file

FORMAT = "tcfit bench 1"
_SAME, _ENOUGH = 0.01, 3
"""Relative difference under which nothing is said about figures, and repetitions from which on something is."""


class Figure(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that was measured several times. Of all figures less is better."""

    name: str
    """"fit 40 frames, phase 1": the part, what of it, and what is measured."""
    unit: str
    values: tuple[float, ...]
    """In the order in which they were measured."""

    @property
    def median(self) -> float:
        """Of the repetitions."""
        return median(self.values)

    @property
    def high(self) -> float:
        """What 95 % of the repetitions do not exceed."""
        return float(np.percentile(self.values, 95))

    @property
    def range(self) -> tuple[float, float]:
        """From the least to the most."""
        return min(self.values), max(self.values)


class Bench(msgspec.Struct, frozen=True, kw_only=True):
    """A run of the bench, as its file holds it."""

    format: str
    machine: dict[str, str | int | float]
    """What the computer is; not which one."""
    versions: dict[str, str]
    conditions: dict[str, Any]
    """What was fitted and how: two runs with other ones than each other's do not compare."""
    figures: tuple[Figure, ...]


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """One figure twice."""

    before: Figure
    now: Figure

    @property
    def ratio(self) -> float | None:
        """Of the medians, now to before; None where that was 0."""
        return self.now.median / self.before.median if self.before.median else None

    @property
    def verdict(self) -> str:
        """What the repetitions allow to say.

        "clear": no repetition of one is as low as any of the other, in at least three each. Of two things that are the
        same that happens in one of ten comparisons with three repetitions, in one of 126 with five.
        """
        if self.ratio is None:
            return ""
        if abs(self.ratio - 1) < _SAME:
            return "same"
        if min(len(self.before.values), len(self.now.values)) < _ENOUGH:
            return "too few turns"
        (low, high), (now_low, now_high) = self.before.range, self.now.range
        return "clear" if now_low > high or now_high < low else "in the spread"


def write_bench(path: Path, bench: Bench) -> None:
    """Write a run's file, whole or not at all.

    Raises:
        InputError: It cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as draft:
            draft.write_bytes(msgspec.json.format(msgspec.json.encode(bench), indent=2) + b"\n")
    except OSError as error:
        raise InputError(
            f"--json {path}: cannot be written ({error.strerror or error}). Choose another file."
        ) from error


def read_bench(path: Path) -> Bench:
    """Read the file of an earlier run.

    Raises:
        InputError: It is missing, damaged, or no such file.
    """
    try:
        bench = msgspec.json.decode(regular_file(path).read_bytes(), type=Bench)
    except OSError as error:
        raise InputError(
            f"--against {path}: cannot be read ({error.strerror or error}). Name a file of `tcfit bench --json`."
        ) from error
    except msgspec.DecodeError as error:
        raise InputError(
            f"--against {path}: is no file of `tcfit bench --json` ({error}). Name one, or measure again."
        ) from error
    if bench.format != FORMAT:
        raise InputError(f"--against {path}: is {bench.format!r}; expected {FORMAT!r}. Measure again.")
    if wrong := [f.name for f in bench.figures if not f.values]:
        raise InputError(f"--against {path}: has no value for {wrong[0]}; it is damaged. Measure again.")
    return bench


def compared(before: Sequence[Figure], now: Sequence[Figure]) -> list[Comparison]:
    """Figures that both have, in the order of `now`."""
    earlier = {(f.name, f.unit): f for f in before}
    return [Comparison(before=earlier[f.name, f.unit], now=f) for f in now if (f.name, f.unit) in earlier]


def differences(before: Bench, now: Bench) -> list[str]:
    """What else than the code is not the same, in words."""
    old, new = (dict(_flat({"machine": b.machine, "versions": b.versions, **b.conditions})) for b in (before, now))
    absent = "not noted"
    return [
        f"{name} was {old.get(name, absent)}, is {new.get(name, absent)}"
        for name in dict.fromkeys([*old, *new])
        if old.get(name, absent) != new.get(name, absent)
    ]


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Nested values by dotted names, as the file has them."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, msgspec.json.encode(value).decode()


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
            c.now.name,
            f"{number(c.before.median)} ({_range(c.before, '-')})",
            f"{number(c.now.median)} ({_range(c.now, '-')})",
            "-" if c.ratio is None else f"{c.ratio:.2f}",
            c.verdict,
            c.now.unit,
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
