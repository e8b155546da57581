"""One table of how right fits are, on everything that can judge them: for each change to the method.

Phone videos with marker truth beside two learned systems, a man who balances, captured motion from all sides, people
who stand, people who are carried, and signers. Rows come as they are done; data that are not there are left out, with
the reason. Every figure is one of which less is better.

    python -m benchmarks.accuracy --json before.json
    python -m benchmarks.accuracy --set weights.relative_position=9,9,9,9,9 --baseline before.json
    python -m benchmarks.accuracy --quick                  a few minutes, without what is kept apart (untouched)
    python -m benchmarks.accuracy --only squat cam03       rows whose data set has this in its name
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import torch
from tyro.conf import OmitArgPrefixes, UseAppendAction

from benchmarks.accuracy_sets import COLUMNS, KEPT_APART, SETS, Figures, Variant
from benchmarks.report import Common, Row, number, progress, report, start
from evaluation.suite_runs import done_tasks
from fitting_core.errors import InputError
from fitting_core.fit.fused import ready
from tcfit_app.options.fit import MethodOptions, fit_config

_TITLE = "Accuracy"


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """What to fit, and how."""

    only: tuple[str, ...] = ()
    """Data sets whose name has one of these in it; by default all."""
    quick: bool = False
    """Fewer frames, windows and people, and nothing of what is kept apart."""
    preset: str | None = None
    """Another preset than the default one."""
    set: Annotated[UseAppendAction[tuple[str, ...]], None] = ()
    """Any setting as `tcfit fit --set` takes it: KEY=VALUE (repeatable)."""
    workers: int = 1
    """Processes that share out the data sets."""
    baseline: Path | None = None
    """What --json wrote before: differences from it stand behind the figures."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True)
class _Task:
    """One data set."""

    name: str
    variant: Variant
    threads: int


def _done(task: _Task) -> dict[str, Figures] | str:
    """Its rows by label; a text: the reason for having no rows."""
    torch.set_num_threads(task.threads)
    ready.use(threads=task.threads)
    try:
        return SETS[task.name](task.variant)
    except (InputError, FileNotFoundError) as error:
        return str(error)


def run(options: Accuracy) -> None:
    """Fit and judge, and report."""
    config = fit_config(MethodOptions(preset=options.preset, set=options.set))
    before = {} if options.baseline is None else _read(options.baseline)
    variant = Variant(config=config, body=options.common.load_body(), quick=options.quick)
    names = [name for name in SETS if not (options.quick and name in KEPT_APART)]
    chosen = [name for name in names if not options.only or any(part in name for part in options.only)]
    if not chosen:
        raise InputError(f"--only {' '.join(options.only)}: is in no name; expected parts of {', '.join(names)}.")
    ready.prepare(progress)
    tasks = [_Task(name=name, variant=variant, threads=options.common.threads) for name in chosen]
    rows: list[Row] = [
        {"": label} | {column: figures.get(column) for column in COLUMNS}
        for label, figures in _all_done(tasks, options.workers).items()
    ]
    shown = [_beside(row, before.get(str(row[""]), {})) for row in rows]
    report(options, {_TITLE: rows}, shown={_TITLE: shown})


def _all_done(tasks: Sequence[_Task], workers: int) -> dict[str, Figures]:
    """The rows of all data sets that are there, by label; each is reported as it is done."""
    found: dict[str, dict[str, Figures]] = {}
    for task, own in done_tasks(_done, tasks, jobs=workers):
        if isinstance(own, str):
            progress(f"{task.name}: left out: {own}")
            continue
        found[task.name] = own
        for label, figures in own.items():
            progress(f"{label}: " + ", ".join(f"{name} {number(value)}" for name, value in figures.items()))
    return {label: figures for task in tasks for label, figures in found.get(task.name, {}).items()}


def _read(path: Path) -> dict[str, Mapping[str, float | None]]:
    """Figures by label. Raises InputError for what `--json` did not write."""
    try:
        return {row[""]: row for row in json.loads(path.read_text())["tables"][_TITLE]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"--baseline {path}: {error!r}; expected what this benchmark wrote with --json.") from error


def _beside(row: Row, before: Mapping[str, float | None]) -> Row:
    """A row with the differences from what was before behind its figures."""
    return {
        name: value
        if isinstance(value, str) or value is None or (old := before.get(name)) is None
        else f"{number(value)} ({value - old:+.3g})"
        for name, value in row.items()
    }


if __name__ == "__main__":
    start(Accuracy, run)
