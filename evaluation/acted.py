"""`python -m evaluation acted`: the presets on the synthetic suite."""

import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path

from evaluation.options import ActedOptions
from evaluation.suite_runs import SuiteTask, done_tasks, preset_tasks, run_task, sequences_named
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS
from fitting_core.measure.records import Evaluation, Record
from tcfit_app.evaluation.files import print_table, write_evaluation
from tcfit_app.options.preparing import compile_kernels

_FIGURE = "vertex_to_surface_mean"
"""Printed for each finished sequence."""
_COMPARED = ("smplifyx", "paper", "tcfit")
"""Presets."""
_NOTE = (
    "Motions and people are made from the free bodies; keypoints are simulated as a detector gives them. Every fit is "
    "of the neutral free body with the true camera, because sex and shape of the filmed person are unknown to a fit."
)


def run(options: ActedOptions, command: str) -> None:
    """Fit and measure the given sequences; print tables and write the files.

    Raises:
        InputError: An option is wrong, or the folder cannot be written.
    """
    compile_kernels(PRESETS[DEFAULT_PRESET])
    folder = options.out or Path("tcfit-suite")
    names = sequences_named(options.sequences)
    presets = options.presets or _COMPARED
    tasks = preset_tasks(folder, presets, names, every=options.every, collisions=options.collisions)
    found = _done(tasks, options.jobs)
    evaluation = Evaluation(
        title="Synthetic suite",
        records=tuple(record for task in tasks for record in found[task.sequence, task.variant]),
        settings={"Command": command, "Sequences": ", ".join(names), "Date": date.today().isoformat()},
        notes=(_NOTE,) if options.collisions else (_NOTE, "All fits are without the term of self-collision."),
    )
    files = write_evaluation(folder, evaluation)
    print_table(evaluation.records)
    print(f"Wrote {', '.join(file.name for file in files)} into {folder}")


def _done(tasks: Sequence[SuiteTask], jobs: int) -> dict[tuple[str, str], tuple[Record, ...]]:
    found: dict[tuple[str, str], tuple[Record, ...]] = {}
    for task, records in done_tasks(run_task, tasks, jobs=jobs):
        found[task.sequence, task.variant] = records
        errors = "; ".join(f"{r.method} {r.comparison.figures.get(_FIGURE) or 0:.2f} cm" for r in records)
        print(f"{len(found)} of {len(tasks)}: {task.sequence}: {errors}", file=sys.stderr, flush=True)
    return found
