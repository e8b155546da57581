"""The panel Compare: A and B in figures, and where they lie apart."""

import time
from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import viser
from jaxtyping import Float

import tcfit_app.panels.markup as markup
from tcfit_app.fits import Shown as ShownFit
from tcfit_app.panels.fields import Shown, on_choice
from tcfit_app.run_metrics import COST, Comparison, compare

if TYPE_CHECKING:
    from tcfit_app.page import Page

PEAKS = 5
"""Frames that are offered."""
_APART = 20
"""So many of them fit into a clip: neighbours of one peak are not peaks of their own."""
SETTLING = 1.0
"""Seconds for which keypoints and fits stay as they are before figures are taken: these need all meshes."""
_MEASURING = "being measured ..."


class ComparePanel:
    """See `Panel`."""

    title: ClassVar[str] = "Compare"
    icon: ClassVar[viser.IconName] = viser.Icon.SCALE

    def __init__(self, page: "Page") -> None:
        self._page, gui = page, page.client.gui
        self._settled, self._waiting = 0.0, False
        self._head = Shown(gui.add_html(""))
        self._frames = Shown(gui.add_button_group("Differ most", ("-",), hint="Frames; click to go there"))
        self._frames.handle.visible = False
        on_choice(page, self._frames.handle, self._go)
        self._peaks = Shown(gui.add_html("", visible=False))
        self._figures = Shown(gui.add_html(""))
        self._folder = Shown(gui.add_folder("Costs", expand_by_default=False))
        with self._folder.handle:
            note = "Mean of a frame. Runs with other weights or keypoints cannot be compared by these."
            gui.add_html(markup.panel(markup.muted(note)))
            self._costs = Shown(gui.add_html(""))

    def draw(self) -> None:
        """See `Panel.draw`."""
        page, desk = self._page, self._page.desk
        a, b = page.fit(page.state.a), page.fit(page.state.b)
        if a is None or b is None:
            if page.changes.of("compare", None):
                self._say(markup.muted("Two fits are compared here. There is none yet: see the panel Fit."))
            return
        self._head.show(content=markup.panel(_heads(a, b)))
        if page.changes.of("compare", desk.key(a), desk.key(b)):
            self._settled, self._waiting = time.monotonic() + SETTLING, True
            self._folder.show(visible=True)
            self._figures.show(content=markup.panel(markup.muted(self._reason(a, b))))
            self._costs.show(content="")
        if self._waiting and time.monotonic() >= self._settled:
            self._draw_figures(a, b)

    def _draw_figures(self, a: ShownFit, b: ShownFit) -> None:
        """What is there of the figures, once keypoints and fits have come to rest."""
        desk = self._page.desk
        one, other, apart = desk.metrics(a), desk.metrics(b), desk.distances(a, b)
        self._waiting = one is None or other is None or apart is None
        self._draw_peaks(apart.values if apart is not None else None, same=a == b)
        if one is None or other is None:
            self._figures.show(content=markup.panel(markup.muted(self._reason(a, b))))
            return
        rows = compare(one, other)
        self._figures.show(content=markup.panel(_table(r for r in rows if not r.name.startswith(COST))))
        self._costs.show(content=markup.panel(_table(r for r in rows if r.name.startswith(COST))))

    def _say(self, content: str) -> None:
        self._folder.show(visible=False)
        self._head.show(content=markup.panel(content))
        self._frames.show(visible=False)
        self._peaks.show(visible=False)
        self._figures.show(content="")
        self._costs.show(content="")

    def _reason(self, a: ShownFit, b: ShownFit) -> str:
        """Why there are no figures yet."""
        running = [fit.run.name for fit in (a, b) if fit.result is None]
        if running:
            return f"{running[0]} is still being fitted: it is measured when it is done."
        return self._page.desk.metrics_problem(a) or self._page.desk.metrics_problem(b) or _MEASURING

    def _go(self, frame: str) -> None:
        if frame.isdigit():
            self._page.pause()
            self._page.seek(int(frame) - self._page.first_frame)

    def _draw_peaks(self, values: Float[np.ndarray, "T"] | None, *, same: bool) -> None:
        frames = peaks(values) if values is not None and not same else []
        self._frames.show(visible=bool(frames))
        self._peaks.show(visible=bool(frames))
        if not frames:
            return
        assert values is not None
        self._frames.show(options=tuple(str(self._page.first_frame + frame) for frame in frames))
        said = ", ".join(f"{values[frame]:.0f}" for frame in frames)
        mean = f"mean over the clip {np.nanmean(values):.1f}"
        self._peaks.show(content=markup.panel(markup.muted(f"Joints lie {said} mm apart there; {mean} mm")))


def peaks(values: Float[np.ndarray, "T"]) -> list[int]:
    """The frames of the largest values, largest first, none close to another; only those above zero."""
    left = np.nan_to_num(np.array(values, float))
    reach = max(1, len(left) // _APART)
    found: list[int] = []
    while len(found) < PEAKS and len(left) and left.max() > 0:
        frame = int(left.argmax())
        found.append(frame)
        left[max(0, frame - reach) : frame + reach + 1] = 0
    return found


def _heads(a: ShownFit, b: ShownFit) -> str:
    rows = [
        (markup.colored("<b>A</b>", "#5aa0ff"), markup.text(a.title)),
        (markup.colored("<b>B</b>", "#ff963c"), markup.text(b.title)),
    ]
    same = markup.muted("They are the same: choose another A or B, in the panels View or Runs.")
    table = "".join(f"<div>{mark}&ensp;{title}</div>" for mark, title in rows)
    return table + (same if (a.run.id, a.phase) == (b.run.id, b.phase) else "")


def _table(rows: Iterable[Comparison]) -> str:
    return markup.table([_row(r) for r in rows], head=("", "A", "B", "B − A"), numbers=3, dense=True)


def _row(figure: Comparison) -> tuple[str, str, str, str]:
    unit = f" {markup.muted(figure.unit)}" if figure.unit else ""
    a, b = _number(figure.a), _number(figure.b)
    change = "" if figure.difference is None else _number(figure.difference, sign=True)
    if figure.better:
        change = markup.colored(change, markup.GOOD if figure.better == "b" else markup.BAD)
    return (
        markup.text(figure.title) + unit,
        markup.colored(a, markup.GOOD) if figure.better == "a" else a,
        markup.colored(b, markup.GOOD) if figure.better == "b" else b,
        change,
    )


def _number(value: float | None, *, sign: bool = False) -> str:
    """Three significant digits, without an exponent."""
    if value is None:
        return "–"
    digits = 0 if abs(value) >= 100 else 1 if abs(value) >= 10 else 2 if abs(value) >= 1 else 3
    text = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    return text.replace("-", "−")
