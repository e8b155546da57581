"""The docs' table of terms: `python -m tests.drivers.written_terms` writes it from their files, a test compares."""

import re
from pathlib import Path

from fitting_core.fit.terms.table import TERMS

_ROOT = Path(__file__).parents[2]
_TABLE = re.compile(r"\| term \| weights \| meaning \|\n(\|.*\n)+")


def docs_table() -> str:
    """The table of docs/method.md."""
    rows = [
        f"| `{entry.name}` | {', '.join(f'`{weight}`' for weight in entry.weights)} | {entry.about} |\n"
        for entry in TERMS.values()
    ]
    return "".join(["| term | weights | meaning |\n", "|---|---|---|\n", *rows])


def written() -> dict[Path, str]:
    """The files as they must be."""
    method = _ROOT / "docs" / "method.md"
    text, count = _TABLE.subn(lambda _: docs_table(), method.read_text(encoding="utf-8"))
    assert count == 1, f"{method} has {count} tables of terms, expected one"
    return {method: text}


if __name__ == "__main__":
    for path, text in written().items():
        path.write_text(text, encoding="utf-8")
