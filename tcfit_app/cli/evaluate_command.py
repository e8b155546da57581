"""`tcfit evaluate`: measure a fit against a reference, or the method against the suite; tables and a report."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import torch

from fitting_core.body.markers.files import read_marker_set
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS
from fitting_core.errors import InputError
from fitting_core.io.result_files import read_fit
from fitting_core.measure.records import Evaluation, Record
from fitting_core.measure.references.files import read_reference
from fitting_core.measure.report.markup import number
from fitting_core.synthetic.suite import SEQUENCES, make_sequence
from tcfit_app.cli.evaluate_motion import run_motion_suite
from tcfit_app.cli.json_lines import Note, Progress, emit, emit_figures, emit_wrote
from tcfit_app.evaluation.ablations import Setting, run_ablations
from tcfit_app.evaluation.evaluated_fits import EvaluatedFit, evaluated_fit
from tcfit_app.evaluation.evaluating import drawable, evaluation_of
from tcfit_app.evaluation.files import REPORT_NAME, print_table, write_evaluation
from tcfit_app.evaluation.reference_time import AUTO, in_time, seconds_of
from tcfit_app.evaluation.suite_runs import (
    SuiteTask,
    done_tasks,
    fitted_body,
    method_names,
    preset_tasks,
    run_task,
    sequences_named,
)
from tcfit_app.evaluation.worst_frames import Drawable, worst_frames
from tcfit_app.options.evaluate import EvaluateOptions
from tcfit_app.options.preparing import compile_kernels

_FIGURE = "vertex_to_surface_mean"
"""Of the suite, told as its sequences are done."""
_NEEDED = "Name a fit (a project, a result of tcfit or of another program), or --suite: see tcfit evaluate --help."


def run_evaluate(options: EvaluateOptions, *, command: str = "") -> Path:
    """Measure what the options say, print the table and write the files.

    Returns:
        The folder that was written.

    Raises:
        InputError: Files or options cannot be used.
    """
    _check(options)
    torch.set_num_threads(1)
    if options.suite is not None:
        return _RUN[options.suite](options, command=command)
    assert options.fit is not None
    fit = evaluated_fit(
        options.fit,
        run=options.run,
        models=options.models,
        person=options.person,
        body_model=options.body_model,
        frame_rate=options.frame_rate,
    )
    reference = fit.reference
    if options.reference is not None:
        reference = read_reference(
            options.reference,
            camera=options.camera,
            seen_by=fit.camera,
            search=options.models,
            markers=None if options.markers is None else read_marker_set(options.markers),
        )
    fit = fit.beside(reference)
    reference = in_time(reference, fit, first_frame=options.reference_first_frame, offset=options.reference_offset)
    done = _counted(fit, options.every)
    evaluation = evaluation_of(fit, reference, every=options.every, models=options.models, done=done)
    evaluation = replace(evaluation, settings=evaluation.settings | {"Command": command})
    drawn = drawable(fit, reference, options.models)
    worst = worst_frames(evaluation.records, lambda sequence: drawn, count=options.pictures)
    folder = options.out or Path(f"{_file_name(fit.name)}-evaluation")
    write_evaluation(folder, evaluation, worst=worst)
    print_table(evaluation.records)
    for note in evaluation.notes:
        print(f"Note: {note}", file=sys.stderr)
        emit(Note(text=note))
    _emit_records(evaluation.records, folder)
    print(f"Wrote metrics.csv, metrics.json and {REPORT_NAME} into {folder}")
    return folder


def _counted(fit: EvaluatedFit, every: int) -> Callable[[int], None]:
    """Takes how many frames' surfaces have just been measured, and tells of the share."""
    total = sum(-(-len(params) // every) for params, _ in fit.phases.values())
    count = 0

    def done(more: int) -> None:
        nonlocal count
        count += more
        emit(Progress(step="surfaces", share=min(1.0, count / total), text=f"{count} of {total} frames"))

    return done


def _emit_records(records: Sequence[Record], folder: Path) -> None:
    for record in records:
        emit_figures(record.sequence, record.method, record.comparison.figures)
    emit_wrote(*(folder / name for name in ("metrics.csv", "metrics.json", REPORT_NAME)))


def _check(options: EvaluateOptions) -> None:
    """Raises InputError for options that do not go together."""
    chosen = options.suite is not None
    if chosen == (options.fit is not None):
        raise InputError(_NEEDED if not chosen else "--suite makes its own fits: leave out FIT, or --suite.")
    if chosen and (given := [option for option in _OF_A_FIT if getattr(options, option) is not None]):
        names = ", ".join(f"--{option.replace('_', '-')}" for option in given)
        raise InputError(f"--suite has its own truth: leave out {names}.")
    if options.ablations and not chosen:
        raise InputError("--ablations vary settings on the suite: give --suite too.")
    if options.camera is not None and options.reference is None:
        raise InputError("--camera says where the camera stands in a reference's world: give --reference too.")
    if options.reference_offset is not None and options.reference_first_frame is not None:
        raise InputError("--reference-offset and --reference-first-frame say the same: leave one of them out.")
    if options.reference_offset is not None and options.reference_offset != AUTO:
        seconds_of(options.reference_offset)
    if options.markers is not None and options.reference is None:
        raise InputError("--markers says what the points of a reference are: give --reference too.")
    for name in ("every", "jobs"):
        if getattr(options, name) < 1:
            raise InputError(f"--{name} is {getattr(options, name)}; expected 1 or more.")


_OF_A_FIT = (
    "reference",
    "run",
    "camera",
    "reference_first_frame",
    "reference_offset",
    "markers",
    "person",
    "frame_rate",
    "body_model",
)
"""Options that have no meaning for a suite."""


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip("-.") or "fit"


# --- the suite ---


def run_suite(options: EvaluateOptions, *, command: str = "") -> Path:
    """Fit and measure what the options say; print tables and write the files.

    Raises:
        InputError: Options cannot be used, or the folder cannot be written.
    """
    if options.set:
        raise InputError("--set changes settings on the motion suite: give --suite motion, or leave out --set.")
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
    ablations = ()
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
    write_evaluation(folder, evaluation, worst=worst, ablations=ablations)
    _emit_records(evaluation.records, folder)
    print_table(evaluation.records)
    print(f"Wrote metrics.csv, metrics.json and {REPORT_NAME} into {folder}")
    return folder


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
        emit(Progress(step="sequences", share=len(found) / len(tasks), text=f"{task.sequence}: {said}"))
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


_RUN: dict[str, Callable[..., Path]] = {"acted": run_suite, "motion": run_motion_suite}
"""By name; each takes the options and the command's text."""
