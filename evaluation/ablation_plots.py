"""One setting varied, all others held: error and seconds over it."""

from collections.abc import Sequence
from dataclasses import dataclass

from evaluation.suite_plots import bar_plot
from fitting_core.measure.report.markup import Markup, joined, number, table, tag
from fitting_core.measure.report.plots import Series, legend, line_plot

_SIZE = (580.0, 190.0)
"""Of a plot, CSS pixels: two of them stand side by side."""
_COLORS = ("blue", "amber", "teal", "pink", "violet")


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One value of the setting."""

    label: str
    """The value, in words."""
    place: float | None
    """Where it stands on the axis; None: values that are names."""
    variant: str
    """Which line of the plot it belongs to; empty where there is one only."""
    errors: dict[str, float | None]
    """By figure's title with its unit."""


@dataclass(frozen=True, kw_only=True)
class Ablation:
    """A setting and its values."""

    title: str
    x_title: str
    note: str
    logarithmic: bool = False
    trials: tuple[Trial, ...]


def ablation_plots(ablations: Sequence[Ablation]) -> Markup:
    """For each setting its plots and, below them, their numbers."""
    return joined(map(_one, ablations))


def _one(ablation: Ablation) -> Markup:
    names = list(dict.fromkeys(name for trial in ablation.trials for name in trial.errors))
    variants = list(dict.fromkeys(trial.variant for trial in ablation.trials))
    figures = [tag("figure", _plot(ablation, name, variants)) for name in names]
    styles = [(variant, _COLORS[i % len(_COLORS)]) for i, variant in enumerate(variants)]
    rows = [
        (f"{t.variant}, {t.label}" if t.variant else t.label, *(number(t.errors.get(name)) for name in names))
        for t in ablation.trials
    ]
    return joined(
        [
            tag("h3", ablation.title),
            tag("p", ablation.note, class_="dim"),
            legend(styles) if len(variants) > 1 else Markup(),
            tag("div", *figures, class_="grid pair"),
            tag("details", tag("summary", "Numbers"), table((ablation.x_title, *names), rows)),
        ]
    )


def _plot(ablation: Ablation, name: str, variants: list[str]) -> Markup:
    labels = list(dict.fromkeys(trial.label for trial in ablation.trials))
    found = {(t.variant, t.label): t.errors.get(name) for t in ablation.trials}
    series = [
        Series(title=variant or name, style=_COLORS[i % len(_COLORS)], values=[found.get((variant, x)) for x in labels])
        for i, variant in enumerate(variants)
    ]
    places = [next(t.place for t in ablation.trials if t.label == label) for label in labels]
    if any(place is None for place in places):
        return bar_plot(labels, series, y_title=name, x_title=ablation.x_title, size=_SIZE)
    return line_plot(
        [float(place or 0) for place in places],
        series,
        x_title=ablation.x_title,
        y_title=name,
        from_zero=True,
        logarithmic=ablation.logarithmic,
        dots=True,
        size=_SIZE,
    )
