"""The head of the report: the verdict in large figures, and the paper's table."""

from collections.abc import Sequence

from fitting_core.measure.records import Record, baseline_of, methods, motions, of, pooled, wins
from fitting_core.measure.report.markup import Markup, joined, markup, number, table, tag

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
