"""What is written from the terms' own files: their weights as settings, and the docs' table.

`python -m tests.drivers.written_terms` writes both; a test compares. The settings are a file of their own, as the
command line reads them without torch.
"""

import re
import textwrap
from pathlib import Path

from fitting_core.fit.terms.entry import Five, Weight
from fitting_core.fit.terms.table import TERMS

_ROOT = Path(__file__).parents[2]
_TABLE = re.compile(r"\| term \| weights \| what it says \|\n(\|.*\n)+")
_HEAD = '''"""The weights of all terms, as their files in `fit/terms/` declare them; imports no torch.

Made by `python -m tests.drivers.written_terms`.
"""

from dataclasses import dataclass, replace

Five = tuple[float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights by stage 1 to 5. A term's coefficient is the square of its weight; 0 switches it off.

    The defaults are the paper's table.
    """

'''


def weights_module() -> str:
    """The text of config/weights.py."""
    weights = [weight for entry in TERMS.values() for weight in entry.weights]
    presets = (("SMPLIFYX", {w.name: w.smplifyx for w in weights}), ("TCFIT", {w.name: w.tcfit for w in weights}))
    return (
        _HEAD
        + "".join(map(_field, weights))
        + "\n\nPAPER = Weights()\n"
        + "".join(f"{name} = replace(\n    PAPER,\n{_values(values)})\n" for name, values in presets)
    )


def _field(weight: Weight) -> str:
    doc = textwrap.fill(f'"""{weight.about}"""', 120, initial_indent="    ", subsequent_indent="    ")
    return f"    {weight.name}: Five = {weight.paper}\n{doc}\n"


def _values(values: dict[str, Five | None]) -> str:
    return "".join(f"    {name}={five},\n" for name, five in values.items() if five is not None)


def docs_table() -> str:
    """The table of docs/method.md."""
    rows = [
        f"| `{entry.name}` | {', '.join(f'`{weight.name}`' for weight in entry.weights)} | {entry.about} |\n"
        for entry in TERMS.values()
    ]
    return "".join(["| term | weights | what it says |\n", "|---|---|---|\n", *rows])


def written() -> dict[Path, str]:
    """The files as they must be."""
    method = _ROOT / "docs" / "method.md"
    text, count = _TABLE.subn(lambda _: docs_table(), method.read_text(encoding="utf-8"))
    assert count == 1, f"{method} has {count} tables of terms, expected one"
    return {_ROOT / "fitting_core" / "config" / "weights.py": weights_module(), method: text}


if __name__ == "__main__":
    for path, text in written().items():
        path.write_text(text, encoding="utf-8")
