"""`python -m evaluation acted`: the presets on the synthetic suite; tables, and settings varied one at a time."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import msgspec

from evaluation.ablation_plots import ablation_plots
from evaluation.ablations import Setting, run_ablations
from evaluation.options import ActedOptions
from evaluation.suite_plots import plots
from evaluation.suite_runs import (
    SuiteTask,
    done_tasks,
    fitted_body,
    method_names,
    preset_tasks,
    run_task,
    sequences_named,
)
from evaluation.synthetic.suite import SEQUENCES, make_sequence
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS
from fitting_core.files.atomic import replacing
from fitting_core.io.result_files import read_fit
from fitting_core.measure.records import Evaluation, Record
from fitting_core.measure.report.markup import number
from fitting_core.measure.report.sections import section
from tcfit_app.evaluation.files import REPORT_NAME, print_table, write_evaluation
from tcfit_app.evaluation.worst_frames import Drawable, worst_frames
from tcfit_app.options.preparing import compile_kernels

ABLATIONS_NAME = "ablations.json"
_FIGURE = "vertex_to_surface_mean"
"""Told as sequences are done."""


def run(options: ActedOptions, command: str) -> None:
    """Fit and measure what the options say; print tables and write the files.

    Raises:
        InputError: Options cannot be used, or the folder cannot be written.
    """
    compile_kernels(PRESETS[DEFAULT_PRESET])
    folder = options.out or Path("tcfit-suite")
    names = sequences_named(options.sequences)
    tasks = preset_tasks(
        folder,
        options.presets or _COMPARED,
        names,
        level=options.level,
        every=options.every,
        collisions=options.collisions,
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
    sections = plots(evaluation)
    if options.ablations:
        setting = Setting(
            folder=folder,
            preset=tasks[-1].variant,
            config=replace(tasks[-1].config, last_phase=3),
            sequences=names,
            level=options.level,
            every=options.every,
        )
        ablations = run_ablations(setting, jobs=options.jobs)
        with replacing(folder / ABLATIONS_NAME) as draft:
            draft.write_bytes(msgspec.json.format(msgspec.json.encode(ablations), indent=1) + b"\n")
        sections.append(section("Settings varied one at a time", ablation_plots(ablations)))
    write_evaluation(folder, evaluation, worst=worst, sections=sections)
    print_table(evaluation.records)
    print(f"Wrote metrics.csv, metrics.json and {REPORT_NAME} into {folder}")


_COMPARED = ("smplifyx", "paper", "tcfit")
"""Presets."""
_NOTE = (
    "Motions and people are made from the free bodies; keypoints are simulated as a detector gives them. Every fit is "
    "of the neutral free body with the true camera, as sex and shape of who is filmed are not known to it."
)


def _done(tasks: Sequence[SuiteTask], jobs: int) -> dict[tuple[str, str], tuple[Record, ...]]:
    found: dict[tuple[str, str], tuple[Record, ...]] = {}
    for task, records in done_tasks(run_task, tasks, jobs=jobs):
        found[task.sequence, task.variant] = records
        said = "; ".join(f"{r.method} {number(r.comparison.figures.get(_FIGURE), 2)} cm" for r in records)
        print(f"{len(found)} of {len(tasks)}: {task.sequence}: {said}", file=sys.stderr, flush=True)
    return found


def _drawable(tasks: Sequence[SuiteTask], sequence: str) -> Drawable | None:
    """Truth, baseline and the last preset's result."""
    own, body = [task for task in tasks if task.sequence == sequence], fitted_body()
    bodies = {}
    for task in dict.fromkeys([own[0], own[-1]]):
        found = read_fit(task.folder)
        first, final = method_names(task, found.last_phase)
        if task is own[0]:
            bodies[first] = (body, found.phase1)
        if final is not None and task is own[-1]:
            bodies[final] = (body, found.params)
    made = make_sequence(SEQUENCES[sequence], own[0].level)
    return Drawable(camera=made.clip.camera, bodies=bodies, truth=(made.body, made.truth.params))
