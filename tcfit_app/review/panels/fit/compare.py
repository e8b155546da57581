"""What the Fit panel shows while two fits are compared: which they are, and their figures."""

from collections.abc import Iterable
from functools import partial

from tcfit_app.analysis.run_metrics import ComparedMetric, compare
from tcfit_app.fitting.fits import FitChoice, Shown, pass_of, passes_of
from tcfit_app.project.storage.run_record import by_name
from tcfit_app.review.panels.elements.field import Dropdown
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    button,
    heading,
    joined,
    line,
    paragraph,
    row,
    table,
    text,
    words,
)
from tcfit_app.review.tab.on_show import SLOTS, Slot
from tcfit_app.review.tab.tab import Tab

_MEASURING = "Measuring …"
_BETTER = "better in green"
_SAME = "A and B are the same fit: choose another."
_HINTS: dict[Slot, str] = {"a": "Left, and what Blink shows", "b": "Right; corrections go to it"}


class Compared:
    """A part of the Fit panel, shown while two fits are."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._choices: dict[str, FitChoice] = {"": FitChoice()}
        """By their names in the dropdowns."""
        self._head, self._fits = Board(tab), [self._dropdown(side) for side in SLOTS]
        self._against, self._figures = Board(tab), Board(tab)

    def _dropdown(self, side: Slot) -> Dropdown:
        handle = self._tab.client.gui.add_dropdown(side.upper(), ("",), hint=_HINTS[side])
        choose, read = partial(self._choose, side), partial(self._read, side)
        on = lambda: self._tab.state.comparing  # noqa: E731
        return Dropdown(self._tab, handle, choose, read, options=lambda: tuple(self._choices), when=on)

    def _choose(self, side: Slot, name: str) -> None:
        if name in self._choices:
            self._tab.set(**{side: self._choices[name]})

    def _read(self, side: Slot) -> str:
        fit = self._tab.shown.fit(side)
        now = None if fit is None else FitChoice(run=fit.run.id, phase=None if fit.last else fit.phase)
        return next((name for name, choice in self._choices.items() if choice == now), next(iter(self._choices)))

    def _offered(self) -> dict[str, FitChoice]:
        """All fits, each followed by its own earlier passes, the newest first."""
        found: dict[str, FitChoice] = {}
        for name, run in by_name([*reversed(self._tab.session.fits.showable())]).items():
            found[name] = FitChoice(run=run.id)
            found |= {f"{name} · {pass_of(run, n)}": FitChoice(run=run.id, phase=n) for n in passes_of(run)}
        return found or self._choices

    def _stop(self) -> None:
        self._tab.set(mode="edit" if self._tab.state.mode == "ab" else self._tab.state.mode, blinked=False)
        self._tab.set(difference=False, ghost=False)

    def draw(self) -> None:
        """Send what changed."""
        tab, on = self._tab, self._tab.state.comparing
        self._choices = self._offered() if on else self._choices
        for dropdown in self._fits:
            dropdown.draw()
        a, b, same = tab.shown.a, tab.shown.b, tab.shown.same
        stop = row(button("Stop comparing", "compare.stop", do=self._stop))
        self._head.show(*([heading("Compared"), stop, *([paragraph(_SAME, "dim")] if same else [])] if on else []))
        if a is None or b is None or same:
            self._against.show()
            self._figures.show()
        elif tab.session.edit_follower.lags:  # figures take all meshes, so not of fits that are about to change
            self._figures.show(paragraph(_MEASURING, "dim"))
        else:
            self._draw_figures(a, b)

    def _draw_figures(self, a: Shown, b: Shown) -> None:
        """The figures available so far."""
        data = self._tab.data
        self._draw_against(a, b)
        one, other = data.metrics(a), data.metrics(b)
        if one is None or other is None:
            self._figures.show(paragraph(self._reason(a, b), "dim"))
            return
        self._figures.show(heading("Whole clip", _BETTER), _table(compare(one, other)))

    def _draw_against(self, a: Shown, b: Shown) -> None:
        """Figures against the project's reference, if any."""
        data, reference = self._tab.data, self._tab.session.project.reference
        if reference is None or a.result is None or b.result is None:
            self._against.show()
            return
        head = heading("Against the reference", _BETTER)
        one, other = data.reference_metrics(a), data.reference_metrics(b)
        if one is None or other is None:
            problem = data.problem("reference", a) or data.problem("reference", b)
            self._against.show(*([head, paragraph(problem, "warn")] if problem else []))
            return
        self._against.show(head, _table(compare(one, other)))

    def _reason(self, a: Shown, b: Shown) -> str:
        """Why there are no figures yet."""
        running = [fit.run.name for fit in (a, b) if fit.result is None]
        if running:
            return f"{running[0]} is still being fitted; its figures follow when it is done."
        return self._tab.data.problem("metrics", a) or self._tab.data.problem("metrics", b) or _MEASURING


def _table(rows: Iterable[ComparedMetric]) -> Html:
    return table(map(_line, rows), ("", "A", "B", "B − A"), numbers=(1, 2, 3))


def _line(figure: ComparedMetric) -> Html:
    unit = words(f" {figure.of.unit}", "dim") if figure.of.unit else Html()
    change = "" if figure.difference is None else _number(figure.difference, sign=True)
    return line(
        joined(text(figure.of.title), unit),
        _marked(_number(figure.a), "good" if figure.better == "a" else ""),
        _marked(_number(figure.b), "good" if figure.better == "b" else ""),
        _marked(change, {"a": "bad", "b": "good"}.get(figure.better or "", "")),
        numbers=(1, 2, 3),
    )


def _marked(content: str, kind: str) -> Html:
    return words(content, kind) if kind else text(content)


def _number(value: float | None, *, sign: bool = False) -> str:
    """Three significant digits, without an exponent."""
    if value is None:
        return "–"
    digits = 0 if abs(value) >= 100 else 1 if abs(value) >= 10 else 2 if abs(value) >= 1 else 3
    text = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    return text.replace("-", "−")
