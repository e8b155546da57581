"""The report of an evaluation: one HTML page of tables and plots that needs no network.

The only import of plotly, which is an extra: pip install tcfit[report].
"""

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from fitting_core.errors import InputError
from fitting_core.measure.comparison import figure_titles
from fitting_core.measure.curves import CURVES
from fitting_core.measure.records import Evaluation, Record, methods, motions, number, of, overall, sequences

MISSING = "plotly is not installed. Install it with `pip install tcfit[report]`."
MOTION_TITLES = {"simple": "Simple motion", "complex": "Complex motion", "signing": "Signing", "": "This clip"}
_BY_SEQUENCE = ("vertex_to_surface", "volume_error", "pa_mpjpe")
_OVER_TIME = ("vertex_to_surface", "volume", "pa_mpjpe", "joint_error", "reprojection")
_TRUE = {"volume": "true_volume"}
"""Curves of the truth itself, drawn beside those of the methods."""
_SIZE = {"height": 320, "margin": {"l": 60, "r": 20, "t": 40, "b": 40}}
_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 1100px; margin: 2rem auto; padding: 0 1rem; color: #1b1f24 }
table { border-collapse: collapse } td, th { padding: .2rem .8rem .2rem 0; text-align: right; font-weight: normal }
td:first-child, th:first-child { text-align: left } th { border-bottom: 1px solid #888 } .best { font-weight: 600 }
"""


def report_page(evaluation: Evaluation) -> str:
    """The page. Raises InputError if plotly is missing."""
    figures, to_html = _plots(evaluation)
    parts = [f"<h1>{escape(evaluation.title)}</h1>", *(f"<p>{escape(note)}</p>" for note in evaluation.notes)]
    for motion in motions(evaluation.records):
        parts.append(f"<h2>{escape(MOTION_TITLES.get(motion, motion))}</h2>")
        parts.append(_figures(of(evaluation.records, motion=motion)))
    for i, figure in enumerate(figures):
        parts.append(to_html(figure, full_html=False, include_plotlyjs=i == 0, div_id=f"plot-{i}"))
    parts.append("<h2>How this was measured</h2>")
    parts.append(_table(("", ""), [[escape(key), escape(value)] for key, value in evaluation.settings.items()]))
    head = f'<meta charset="utf-8"><title>{escape(evaluation.title)}</title><style>{_STYLE}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{"".join(parts)}</body></html>\n'


def _plots(evaluation: Evaluation) -> tuple[list[Any], Any]:
    """Plotly's figures, and its function that makes HTML of one."""
    try:
        import plotly.graph_objects as go
        from plotly.io import to_html
    except ImportError as error:
        raise InputError(MISSING) from error
    records = evaluation.records
    if len(sequences(records)) > 1:
        drawn = [(curve, of(records, motion=motion)) for curve in _BY_SEQUENCE for motion in motions(records)]
        found = [_bars(go, curve, some) for curve, some in drawn]
    else:
        found = [_lines(go, curve, records) for curve in _OVER_TIME]
    return [figure for figure in found if figure.data], to_html


def _bars(go: Any, curve: str, records: Sequence[Record]) -> Any:
    """Means of a curve by sequence and method, of one motion."""
    motion = records[0].motion
    figure = go.Figure(layout=_layout(curve, f", {MOTION_TITLES.get(motion, motion)}", "sequence"))
    for method in methods(records):
        means = {r.sequence: r.comparison.figures.get(f"{curve}_mean") for r in of(records, method=method)}
        if any(value is not None for value in means.values()):
            figure.add_bar(x=list(means), y=list(means.values()), name=method)
    return figure


def _lines(go: Any, curve: str, records: Sequence[Record]) -> Any:
    """A curve over the frames of the one sequence, and the truth's own where it has one."""
    figure = go.Figure(layout=_layout(curve, "", "frame"))
    lines = {r.method: r.comparison.curves[curve] for r in records if curve in r.comparison.curves}
    if lines and (true := _TRUE.get(curve)) in records[0].comparison.curves:
        lines["truth"] = records[0].comparison.curves[true]
    for name, values in lines.items():
        first = records[0].comparison.first_frame
        # Surfaces may be measured in every few frames only.
        measured = [(first + i, value) for i, value in enumerate(values) if value is not None]
        if measured:
            frames, y = zip(*measured, strict=True)
            color = {"color": "gray"} if name == "truth" else {}
            figure.add_scatter(x=frames, y=y, name=name, mode="lines", line=color)
    return figure


def _layout(curve: str, of_what: str, across: str) -> dict[str, Any]:
    kind = CURVES[curve]
    title = {"text": f"{kind.title}{of_what}", "font": {"size": 16}}
    axes = {"xaxis": {"title": {"text": across}}, "yaxis": {"title": {"text": kind.unit}}}
    return {"title": title, "template": "none", "showlegend": True, **_SIZE, **axes}


def _figures(records: Sequence[Record]) -> str:
    """Every figure over all frames of a motion, a column for each method."""
    names, rows = methods(records), list[list[str]]()
    for figure, (title, unit, better) in figure_titles().items():
        values = [overall(of(records, method=name), figure) for name in names]
        known = [value for value in values if value is not None]
        if known:
            best = number(min(known)) if better and len(known) > 1 else None
            cells = (f'<span class="best">{n}</span>' if n == best else n for n in map(number, values))
            rows.append([escape(f"{title} {unit}"), *cells])
    return _table(["", *map(escape, names)], rows)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of cells that are HTML already."""

    def row(cells: Sequence[str], name: str) -> str:
        return f"<tr>{''.join(f'<{name}>{cell}</{name}>' for cell in cells)}</tr>"

    return f"<table>{row(head, 'th') if any(head) else ''}{''.join(row(cells, 'td') for cells in rows)}</table>"
