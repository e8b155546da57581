"""HTML and SVG as text: whatever is given as text is escaped, whatever these functions return is not escaped again."""

from collections.abc import Iterable, Sequence
from html import escape


class Markup(str):
    """Text that is HTML or SVG already, and safe."""

    __slots__ = ()


def markup(value: object) -> Markup:
    """Anything as markup; markup stays as it is."""
    return value if isinstance(value, Markup) else Markup(escape(str(value)))


def joined(parts: Iterable[Markup]) -> Markup:
    """One after the other."""
    return Markup("".join(parts))


def tag(name: str, *content: object, **attributes: object) -> Markup:
    """An element; "_" at the end of an attribute's name is left out, others become "-"; None leaves one out."""
    texts = {key: f"{v:.2f}".rstrip("0").rstrip(".") if isinstance(v, float) else v for key, v in attributes.items()}
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(str(text))}"' for key, text in texts.items() if text is not None
    )
    return Markup(f"<{name}{given}>{joined(map(markup, content))}</{name}>")


def table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> Markup:
    """A table; all columns but the first hold numbers. A cell may be a whole <td>."""

    def cell(index: int, value: object, name: str) -> Markup:
        if isinstance(value, Markup) and value.startswith("<td"):
            return value
        return tag(name, value, class_="n" if index else None)

    top = tag("tr", *(cell(i, value, "th") for i, value in enumerate(head)))
    body = (tag("tr", *(cell(i, value, "td") for i, value in enumerate(row))) for row in rows)
    return tag("div", tag("table", tag("thead", top), tag("tbody", *body)), class_="scroll")


def number(value: float | None, digits: int | None = None) -> str:
    """Three significant digits or so many after the point; a dash where there is none."""
    if value is None:
        return "–"
    if digits is None:
        digits = 0 if abs(value) >= 100 else 1 if abs(value) >= 10 else 2 if abs(value) >= 0.1 else 3
    return f"{value:.{digits}f}".replace("-", "−")
