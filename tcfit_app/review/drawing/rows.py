"""The rows of the timeline: curves of A and B, their differences, and the table of everything that can be plotted."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np

from fitting_core.errors import InputError
from tcfit_app.analysis.curves import BETWEEN, CURVES, Curve
from tcfit_app.analysis.levels import LEVELS, LevelSpans
from tcfit_app.fitting.fits import Shown
from tcfit_app.review.browser import page_states as states
from tcfit_app.review.browser.page_states import Color, curve_values
from tcfit_app.review.tab.on_show import SLOT_COLORS, SLOTS, Slot
from tcfit_app.review.tab.tab import Tab

Value = TypeVar("Value", tuple[Curve, ...], LevelSpans)

MOST_ROWS = 6
"""More would make each too low to read."""
_NO_FIT = "Curves appear here once there is a fit."
_MEASURING = "Measuring …"
_NOTHING = "There is nothing to measure in this clip."
_SAME = "The two fits are the same."
_MISSING = "This row compares two fits: choose Compare (2)."
_PARTS: dict[Color, str] = {part: f"reprojection_{part}" for part in ("body", "left_hand", "right_hand", "face")}
"""Curves of the row of reprojection errors, each in the colour of its keypoints."""


@dataclass(frozen=True, kw_only=True)
class Plot:
    """Something a row can show."""

    title: str
    group: str
    """Choices with the same group are listed together."""
    unit: str
    how: Literal["each", "levels", "between"] = "each"
    """A line per fit; levels, of B; the distance between A and B."""


PLOTS: dict[str, Plot] = {
    **{name: Plot(title=kind.title, group=kind.group, unit=kind.unit) for name, kind in CURVES.items()},
    **{name: Plot(title=kind.title, group=kind.group, unit="", how="levels") for name, kind in LEVELS.items()},
    BETWEEN: Plot(title="Distance between the fits", group="Two fits", unit="mm", how="between"),
}
"""By the name that the page requests: one of CURVES or LEVELS, or BETWEEN."""
CHOICES = tuple(
    states.Choice(name=name, title=f"{plot.title} ({plot.unit})" if plot.unit else plot.title, group=plot.group)
    for group in dict.fromkeys(plot.group for plot in PLOTS.values())
    for name, plot in PLOTS.items()
    if plot.group == group
)


def with_plot(plots: tuple[str, ...], name: str, *, shown: bool) -> tuple[str, ...]:
    """The names of the rows with one added or removed; unchanged for a name that is not in PLOTS. Raises InputError if
    there are too many already."""
    if name not in PLOTS or (name in plots) == shown:
        return plots
    if not shown:
        return tuple(other for other in plots if other != name)
    if len(plots) >= MOST_ROWS:
        raise InputError(f"The timeline shows at most {MOST_ROWS} rows: close one first.")
    return (*plots, name)


@dataclass(frozen=True, kw_only=True)
class _Found:
    """The content of a row. Equal to another while nothing has changed: curves are compared by identity."""

    name: str
    curves: tuple[tuple[str, Color, Curve], ...] = ()
    """With their labels and colours."""
    levels: LevelSpans | None = None
    empty: str = ""
    """Why they are missing; empty: they are being computed, or there is no fit yet."""


class Rows:
    """The rows of one tab's timeline."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._last: dict[tuple[str, Slot], tuple[Hashable, Any]] = {}
        """By name and side, with the fit's origin: they stay on show until newer ones are ready."""

    def draw(self) -> None:
        """Send them if they have changed."""
        tab = self._tab
        found = tuple(map(self._find, tab.state.plots))
        rows = tab.once("rows", found, lambda: tuple(map(self._row, found)))
        tab.channel.send("rows", states.Rows(rows=rows))

    @property
    def _fits(self) -> dict[Slot, Shown]:
        """The fits with lines."""
        sides: tuple[Slot, ...] = ("b",) if self._tab.shown.same else SLOTS
        return {side: fit for side in sides if (fit := self._tab.shown.fit(side)) is not None}

    def _find(self, name: str) -> _Found:
        return _WAYS[PLOTS[name].how](self, name)

    def _each(self, name: str) -> _Found:
        fits = self._fits
        curves: list[tuple[str, Color, Curve]]
        if name == "reprojection" and len(fits) == 1:
            curves = [
                (part.replace("_", " "), part, curve)
                for side, fit in fits.items()
                for part, curve in zip(_PARTS, self._curves(name, side, fit, tuple(_PARTS.values())), strict=False)
            ]
            curves = [line for line in curves if np.isfinite(line[2].values).any()] or curves
        else:
            curves = [
                (side.upper() if len(fits) > 1 else "", SLOT_COLORS[side], curve)
                for side, fit in fits.items()
                for curve in self._curves(name, side, fit, (name,))
            ]
        problem = next((why for fit in fits.values() if (why := self._tab.data.problem("metrics", fit))), "")
        return _Found(name=name, curves=tuple(curves), empty="" if curves else problem)

    def _curves(self, name: str, side: Slot, fit: Shown, names: tuple[str, ...]) -> tuple[Curve, ...]:
        return self._latest(name, side, (_origin(fit), names), self._tab.data.curves(names, fit)) or ()

    def _levels(self, name: str) -> _Found:
        shown = self._tab.shown.held
        if shown is None:
            return _Found(name=name)
        return _Found(name=name, levels=self._latest(name, "b", _origin(shown), self._tab.data.levels(name, shown)))

    def _between(self, name: str) -> _Found:
        a, b, same = self._tab.shown.a, self._tab.shown.b, self._tab.shown.same
        if a is None or b is None or same:
            return _Found(name=name, empty=_SAME if same else _MISSING)
        curve = self._tab.data.between(a, b)
        found = self._latest(name, "b", (_origin(a), _origin(b)), None if curve is None else (curve,))
        return _Found(name=name, curves=tuple(("", "beside", one) for one in found or ()))

    def _latest(self, name: str, side: Slot, of: Hashable, found: Value | None) -> Value | None:
        """The value; until it is ready, the last one of the same name and fit."""
        if found is not None:
            self._last[name, side] = (of, found)
        known, last = self._last.get((name, side), (None, None))
        return last if known == of else None

    def _row(self, found: _Found) -> states.Row:
        plot = PLOTS[found.name]
        measured = bool(found.curves) or found.levels is not None
        return states.Row(
            name=found.name,
            title=plot.title,
            unit=plot.unit,
            curves=tuple(_line(*curve) for curve in found.curves),
            levels=None if found.levels is None else _levels(found.name, found.levels),
            empty=found.empty or (_NOTHING if measured else _MEASURING if self._fits else _NO_FIT),
        )


_WAYS: dict[str, Callable[[Rows, str], _Found]] = {
    "each": Rows._each,
    "levels": Rows._levels,
    "between": Rows._between,
}


def _line(label: str, color: Color, curve: Curve) -> states.Curve:
    bars = () if curve.error_bars is None else curve_values(curve.error_bars, digits=3)
    unseen = () if curve.unseen is None else states.spans(np.flatnonzero(curve.unseen))
    return states.Curve(label=label, color=color, values=curve_values(curve.values), error_bars=bars, unseen=unseen)


def _levels(name: str, spans: LevelSpans) -> states.Levels:
    kind = LEVELS[name]
    return states.Levels(parts=kind.parts, words=kind.words, spans=spans)


def _origin(shown: Shown) -> Hashable:
    """The same for a fit and its corrections: its curves stay on show until those of the corrections are ready."""
    run = shown.run
    return run.parent if run.kind == "corrections" and run.parent is not None else run.id, shown.phase
