"""`tcfit evaluate`: measure a fit against a reference; a table, files and a report."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch

from fitting_core.body.markers.marker_set import read_marker_set
from fitting_core.errors import InputError, printable
from fitting_core.measure.references.files import read_reference
from tcfit_app.cli.json_lines import Note, StepProgress, emit, emit_figures, emit_wrote
from tcfit_app.evaluation.evaluated_fits import EvaluatedFit, evaluated_fit
from tcfit_app.evaluation.evaluating import AUTO, evaluation_of, in_time, seconds_of
from tcfit_app.evaluation.files import print_table, write_evaluation
from tcfit_app.options.evaluate import EvaluateOptions


def run_evaluate(options: EvaluateOptions, *, command: str = "") -> Path:
    """Measure, print the table and write the files.

    Returns:
        The folder that was written.

    Raises:
        InputError: Files or options cannot be used.
    """
    _check(options)
    torch.set_num_threads(1)
    fit = evaluated_fit(options.fit, run=options.run, models=options.models)
    reference = fit.reference
    if options.reference is not None:
        reference = read_reference(
            options.reference,
            camera=options.camera,
            seen_by=fit.camera,
            search=options.models,
            markers=None if options.markers is None else read_marker_set(options.markers),
        )
    reference = in_time(reference, fit, first_frame=options.reference_first_frame, offset=options.reference_offset)
    done = _counted(fit, options.every)
    evaluation = evaluation_of(fit, reference, every=options.every, models=options.models, done=done)
    evaluation = replace(evaluation, settings=evaluation.settings | {"Command": command})
    folder = options.out or Path(f"{_file_name(fit.name)}-evaluation")
    files = write_evaluation(folder, evaluation)
    print_table(evaluation.records)
    for note in evaluation.notes:
        print(printable(f"Note: {note}"), file=sys.stderr)
        emit(Note(text=note))
    for record in evaluation.records:
        emit_figures(record.sequence, record.method, record.comparison.figures)
    emit_wrote(*files)
    print(f"Wrote {', '.join(file.name for file in files)} into {folder}")
    return folder


def _counted(fit: EvaluatedFit, every: int) -> Callable[[int], None]:
    """Receives the number of frames just measured, and reports the progress."""
    total = sum(-(-len(params) // every) for params, _ in fit.phases.values())
    count = 0

    def done(more: int) -> None:
        nonlocal count
        count += more
        emit(StepProgress(step="surfaces", share=min(1.0, count / total), text=f"{count} of {total} frames"))

    return done


def _check(options: EvaluateOptions) -> None:
    """Raise InputError for options that cannot be combined."""
    if options.camera is not None and options.reference is None:
        raise InputError("--camera is the camera in the reference's world: give --reference too.")
    if options.reference_offset is not None and options.reference_first_frame is not None:
        raise InputError("Give either --reference-offset or --reference-first-frame, not both.")
    if options.reference_offset is not None and options.reference_offset != AUTO:
        seconds_of(options.reference_offset)
    if options.markers is not None and options.reference is None:
        raise InputError("--markers is the meaning of a reference's points: give --reference too.")
    if options.every < 1:
        raise InputError(f"--every is {options.every}; expected 1 or more.")


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip("-.") or "fit"
