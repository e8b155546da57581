"""The panel Compare: A and B in figures, and where they lie apart."""

import time
from collections.abc import Iterable
from typing import ClassVar

import numpy as np
import viser
from jaxtyping import Float

from tcfit_app.analysis.curves import peaks
from tcfit_app.analysis.run_metrics import COST, Comparison, Metric, compare
from tcfit_app.fitting.fits import Shown
from tcfit_app.review.gestures.gestures import Gestures
from tcfit_app.review.panels.compare.reference_field import ReferenceField
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    button,
    dot,
    heading,
    joined,
    line,
    paragraph,
    row,
    table,
    text,
    words,
)
from tcfit_app.review.scene.layers import RUN_COLORS, css

SETTLING = 1.0
"""Seconds for which keypoints and fits stay as they are before figures are taken: these need all meshes."""
_MEASURING = "Being measured …"
_NO_FIT = "Two fits are compared here. There is none yet: see the panel Fit."
_SAME = "They are the same: choose another A or B, in the panel View or Runs."
_COSTS = "Mean of a frame. Runs with other weights or keypoints cannot be compared by these."


class ComparePanel:
    """See `Panel`."""

    title: ClassVar[str] = "Compare"
    icon: ClassVar[viser.IconName] = viser.Icon.SCALE

    def __init__(self, gestures: Gestures) -> None:
        self._tab = tab = gestures.tab
        self._settled, self._waiting = 0.0, False
        self._head, self._peaks, self._against, self._figures = (Board(tab) for _ in range(4))
        self._reference = ReferenceField(tab)
        with tab.client.gui.add_folder("Costs", expand_by_default=False):
            self._costs = Board(tab)
        tab.buttons.on("compare.frame", tab.seek, int)

    def draw(self) -> None:
        """See `Panel.draw`."""
        tab, desk = self._tab, self._tab.desk
        a, b = tab.shown.a, tab.shown.b
        if a is None or b is None:
            if tab.sent.differs("compare", None):
                self._head.show(paragraph(_NO_FIT, "dim"))
                for board in (self._peaks, self._against, self._figures, self._costs):
                    board.show()
            self._reference.draw()
            return
        self._reference.draw()
        titles = (a.title, b.title)
        if tab.sent.differs("compare", desk.key(a), desk.key(b), *titles, tab.session.referenced):
            self._settled, self._waiting = time.monotonic() + SETTLING, True
            self._head.show(*_heads(a, b))
            self._figures.show(paragraph(self._reason(a, b), "dim"))
            self._costs.show()
        if self._waiting and time.monotonic() >= self._settled:
            self._draw_figures(a, b)

    def _draw_figures(self, a: Shown, b: Shown) -> None:
        """What is there of the figures, once keypoints and fits have come to rest."""
        desk = self._tab.desk
        one, other, apart = desk.metrics(a), desk.metrics(b), desk.distances(a, b)
        against = desk.reference_metrics(a), desk.reference_metrics(b)
        self._waiting = any(found is None for found in (one, other, apart, *against))
        self._draw_against(a, b, *against)
        self._peaks.show(*([] if apart is None or a == b else self._peak_buttons(apart.values)))
        if one is None or other is None:
            self._figures.show(paragraph(self._reason(a, b), "dim"))
            return
        rows = compare(one, other)
        self._figures.show(
            heading("Figures", "better in green"), _table(r for r in rows if not r.name.startswith(COST))
        )
        self._costs.show(paragraph(_COSTS, "dim"), _table(r for r in rows if r.name.startswith(COST)))

    def _draw_against(
        self, a: Shown, b: Shown, one: tuple[Metric, ...] | None, other: tuple[Metric, ...] | None
    ) -> None:
        """Figures against the project's reference, if it has one."""
        reference = self._tab.session.project.reference
        if reference is None or a.result is None or b.result is None:
            self._against.show()
            return
        head = heading("Against the reference", reference.name)
        if one is None or other is None:
            problem = self._tab.desk.reference_problem(a) or self._tab.desk.reference_problem(b)
            self._against.show(head, paragraph(problem or _MEASURING, "warn" if problem else "dim"))
            self._waiting = self._waiting and not problem
            return
        self._against.show(head, _table(compare(one, other)))

    def _reason(self, a: Shown, b: Shown) -> str:
        """Why there are no figures yet."""
        running = [fit.run.name for fit in (a, b) if fit.result is None]
        if running:
            return f"{running[0]} is still being fitted: it is measured when it is done."
        return self._tab.desk.metrics_problem(a) or self._tab.desk.metrics_problem(b) or _MEASURING

    def _peak_buttons(self, values: Float[np.ndarray, "T"]) -> list[Html]:
        first, frames = self._tab.first_frame, peaks(values)
        if not frames:
            return []
        buttons = (
            button(first + frame, "compare.frame", str(frame), hint=f"Joints lie {values[frame]:.0f} mm apart")
            for frame in frames
        )
        said = ", ".join(f"{values[frame]:.0f}" for frame in frames)
        mean = f"Joints lie {said} mm apart there, over the clip {np.nanmean(values):.1f} mm."
        return [heading("Frames that differ most"), row(*buttons), paragraph(mean, "dim")]


def _heads(a: Shown, b: Shown) -> list[Html]:
    named = zip("AB", RUN_COLORS, (a, b), strict=True)
    rows = [paragraph(joined(dot(css(color)), text(f"{name}: {fit.title}"))) for name, color, fit in named]
    same = (a.run.id, a.phase) == (b.run.id, b.phase)
    return [heading("Fits on show", first=True), *rows, *([paragraph(_SAME, "dim")] if same else [])]


def _table(rows: Iterable[Comparison]) -> Html:
    return table(map(_line, rows), ("", "A", "B", "B − A"), numbers=(1, 2, 3))


def _line(figure: Comparison) -> Html:
    unit = words(f" {figure.unit}", "dim") if figure.unit else Html()
    change = "" if figure.difference is None else _number(figure.difference, sign=True)
    return line(
        joined(text(figure.title), unit),
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
