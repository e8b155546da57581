"""What all benchmarks share: their options, how they start, and how they report."""

import json
import math
import platform
import shlex
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
import tyro

from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.fit.fused.ready import cores
from fitting_core.io.summary import versions
from fitting_core.shipped import FREE_FOLDER

Row = Mapping[str, str | float | None]
"""One line of a table, by column. None: there is nothing to tell."""


@dataclass(frozen=True, kw_only=True)
class Common:
    """Options of every benchmark."""

    body: Path | None = None
    """A body model's file, or a folder with a neutral SMPL-X body; by default the project's own free body, even if
    another one is registered."""
    threads: int = 1
    """CPU threads of torch. Fits of one clip hardly gain from a second one."""
    json: Path | None = None
    """Write options, machine and all figures to this file."""
    results: Path | None = None
    """Write the tables to this Markdown file, with command, date and commit: one of evaluation/RESULTS."""

    def load_body(self) -> BodyModel:
        """The body model that these options name."""
        return load_body(find_body(search=self.body or FREE_FOLDER))


def start(options_type: type, run: Callable[[Any], None]) -> None:
    """Reads the command line into `options_type` (which has a field `common`) and runs the benchmark.

    What is wrong with the user's input ends the program with one message instead of a traceback.
    """
    options = tyro.cli(options_type, description=sys.modules[options_type.__module__].__doc__)
    torch.set_num_threads(options.common.threads)
    try:
        run(options)
    except InputError as error:
        sys.exit(str(error))


def repeated(what: str, milliseconds: Sequence[float]) -> dict[str, str | float | None]:
    """What was measured several times: the median, and what 95 % do not exceed; empty cells if it never was."""
    middle, high = (median(milliseconds), float(np.percentile(milliseconds, 95))) if milliseconds else (None, None)
    return {"what": what, "n": str(len(milliseconds)), "median ms": middle, "95 % ms": high}


def number(value: float) -> str:
    """Three digits that count."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}"


def _cell(value: str | float | None) -> str:
    return "" if value is None else value if isinstance(value, str) else number(value)


def markdown(rows: Sequence[Row]) -> str:
    """The rows as a table; columns in the order of their first appearance, numbers with three digits."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    lines = [columns, ["---"] * len(columns), *([_cell(row.get(name)) for name in columns] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def report(
    options: Any, tables: Mapping[str, Sequence[Row]], *, shown: Mapping[str, Sequence[Row]] | None = None
) -> None:
    """Print the tables under their titles, and write them to `options.common.json` and `options.common.results`.

    Args:
        options: Of the benchmark.
        tables: Rows by title.
        shown: What is printed in their place.
    """
    printed = "".join(f"\n### {title}\n\n{markdown(rows)}\n" for title, rows in (shown or tables).items())
    print(printed, end="", flush=True)
    if options.common.results is not None:
        _write_whole(options.common.results, f"{_origin()}\n{printed}".rstrip())
    if options.common.json is not None:
        content = {"options": asdict(options), "machine": machine(), "tables": {t: list(r) for t, r in tables.items()}}
        _write_whole(options.common.json, json.dumps(content, indent=1, default=str))
        print(f"\nwritten to {options.common.json}")


def _origin() -> str:
    """Command, date and commit, as the first lines of a file of results."""
    name = Path(sys.argv[0]).stem
    described = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(described, capture_output=True, text=True, check=False).stdout.strip()
    command = shlex.join(["python", "-m", f"benchmarks.{name}", *sys.argv[1:]])
    return f"    {command}\n\nMeasured {date.today()}, commit {commit or 'unknown'}."


def progress(text: str) -> None:
    """Says on stderr what is being measured, so that stdout holds the tables alone."""
    print(text, file=sys.stderr, flush=True)


def machine() -> dict[str, str | int | float]:
    """What the figures depend on beside the code."""
    system = {"processor": _processor(), "cores": cores(), "system": f"{platform.system()} {platform.machine()}"}
    return system | versions() | {"threads": torch.get_num_threads()}


def _processor() -> str:
    listed = Path("/proc/cpuinfo")
    lines = listed.read_text(errors="replace").splitlines() if listed.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _write_whole(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as draft:
        draft.write_text(text + "\n", encoding="utf-8")
