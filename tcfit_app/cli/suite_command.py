"""`tcfit evaluate --suite`: the presets, or single settings, on sequences whose truth is known."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

from fitting_core.measure.records import Evaluation, Record
from fitting_core.measure.report.markup import number
from fitting_core.synthetic.suite import SEQUENCES, make_sequence
from tcfit_app.evaluation.files import REPORT_NAME, print_table, write_evaluation
from tcfit_app.evaluation.suite_runs import (
    SuiteTask,
    fitted_body,
    method_names,
    preset_tasks,
    run_tasks,
    sequences_named,
    stored_fit,
)
from tcfit_app.evaluation.worst_frames import Drawable, worst_frames
from tcfit_app.options.evaluate import EvaluateOptions

_FIGURE = "vertex_to_surface_mean"


def run_suite(options: EvaluateOptions, *, command: str = "") -> Path:
    """Fit and measure what the options say; print tables and write the files.

    Raises:
        InputError: Options cannot be used, or the folder cannot be written.
    """
    folder = options.out or Path("tcfit-suite")
    names = sequences_named(options.sequences)
    tasks = preset_tasks(
        folder, options.presets, names, level=options.level, every=options.every, collisions=options.collisions
    )
    found = _done(tasks, options.jobs)
    records = tuple(record for task in tasks for record in found[task.sequence, task.variant])
    evaluation = Evaluation(
        title=f"Synthetic suite, level {options.level}",
        records=records,
        settings={"Command": command, "Sequences": ", ".join(names), "Date": date.today().isoformat()},
        notes=(_NOTE,) if options.collisions else (_NOTE, "All fits are without the term of self-collision."),
    )
    worst = worst_frames(evaluation.records, lambda name: _drawable(tasks, name), count=options.pictures)
    ablations = ()
    if options.ablations:
        from tcfit_app.evaluation.ablations import Setting, run_ablations

        setting = Setting(
            folder=folder,
            preset=options.presets[-1],
            config=replace(tasks[-1].config, last_phase=3),
            sequences=names,
            level=options.level,
            every=options.every,
        )
        ablations = run_ablations(setting, jobs=options.jobs)
    write_evaluation(folder, evaluation, worst=worst, ablations=ablations)
    print_table(evaluation.records)
    print(f"Wrote metrics.csv, metrics.json and {REPORT_NAME} into {folder}")
    return folder


_NOTE = (
    "Motions and people are made from the free bodies; keypoints are simulated as a detector gives them. Every fit is "
    "of the neutral free body with the true camera, as sex and shape of who is filmed are not known to it."
)


def _done(tasks: Sequence[SuiteTask], jobs: int) -> dict[tuple[str, str], tuple[Record, ...]]:
    found: dict[tuple[str, str], tuple[Record, ...]] = {}
    for task, records in run_tasks(tasks, jobs=jobs):
        found[task.sequence, task.variant] = records
        said = "; ".join(f"{r.method} {number(r.comparison.figures.get(_FIGURE), 2)} cm" for r in records)
        print(f"{len(found)} of {len(tasks)}: {task.sequence}: {said}", file=sys.stderr, flush=True)
    return found


def _drawable(tasks: Sequence[SuiteTask], sequence: str) -> Drawable | None:
    """Truth, baseline and the last preset's result."""
    own, body = [task for task in tasks if task.sequence == sequence], fitted_body()
    bodies = {}
    for task in dict.fromkeys([own[0], own[-1]]):
        found = stored_fit(task)
        first, final = method_names(task, found.last_phase)
        if task is own[0]:
            bodies[first] = (body, found.phase1)
        if final is not None and task is own[-1]:
            bodies[final] = (body, found.params)
    made = make_sequence(SEQUENCES[sequence], own[0].level)
    return Drawable(camera=made.clip.camera, bodies=bodies, truth=(made.body, made.truth.params))
