"""HTML of panels. Every text that is not ours goes through `text`, so that it is shown and never interpreted."""

import html
from collections.abc import Iterable, Sequence

GOOD, BAD, MUTED = "#51cf66", "#ff8787", "#909296"
"""Colours on viser's dark panels."""
_PANEL = "font-size:12.5px;line-height:1.4;padding:2px 10px;overflow-wrap:anywhere"
_CELL = "padding:1.5px 5px 1.5px 0;vertical-align:top"


def text(value: object) -> str:
    """As HTML that shows it."""
    return html.escape(str(value))


def panel(content: str) -> str:
    """A block of a panel."""
    return f'<div style="{_PANEL}">{content}</div>' if content else ""


def colored(content: str, color: str) -> str:
    """HTML in a colour."""
    return f'<span style="color:{color}">{content}</span>'


def muted(value: object) -> str:
    """A text that matters less."""
    return colored(text(value), MUTED)


def label(value: object) -> str:
    """What stands beside it, in one line."""
    return f'<span style="color:{MUTED};white-space:nowrap">{text(value)}</span>'


def problem(value: object) -> str:
    """A text that says what is wrong; its lines stay lines."""
    return f'<div style="color:{BAD};white-space:pre-wrap">{text(value)}</div>'


def bold(value: object) -> str:
    """A text that matters more."""
    return f"<b>{text(value)}</b>"


def preformatted(value: str) -> str:
    """A file's text."""
    style = "white-space:pre-wrap;font-size:11px;line-height:1.35;margin:0"
    return f'<pre style="{style}">{text(value)}</pre>'


def table(rows: Iterable[Sequence[str]], *, head: Sequence[str] = (), numbers: int = 0, dense: bool = False) -> str:
    """Rows of cells that are HTML already.

    Args:
        rows: All as long as each other.
        head: Titles of the columns, as texts.
        numbers: So many columns at the end are aligned to the right.
        dense: In smaller letters.
    """
    lines = [_row(row, numbers) for row in rows]
    if head:
        lines.insert(0, _row([muted(title) for title in head], numbers))
    style = "width:100%;border-collapse:collapse" + (";font-size:11.5px;letter-spacing:-0.1px" if dense else "")
    return f'<table style="{style}">{"".join(lines)}</table>'


def _row(cells: Sequence[str], numbers: int) -> str:
    right = ";text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums"
    styles = [_CELL + right if i >= len(cells) - numbers else _CELL for i in range(len(cells))]
    return "<tr>" + "".join(f'<td style="{s}">{c}</td>' for s, c in zip(styles, cells, strict=True)) + "</tr>"
