"""`tcfit evaluate`: measure a fit against a reference, or the method against the suite; tables and a report."""

import sys
from dataclasses import replace
from pathlib import Path

import torch

from fitting_core.errors import InputError
from fitting_core.measure.references.files import read_reference
from tcfit_app.evaluation.evaluated_fits import evaluated_fit
from tcfit_app.evaluation.evaluating import drawable, evaluated
from tcfit_app.evaluation.files import REPORT_NAME, print_table, write_evaluation
from tcfit_app.evaluation.worst_frames import worst_frames
from tcfit_app.options.evaluate import EvaluateOptions

_NEEDED = "Name a fit (a project, or the folder of a result), or --suite: see tcfit evaluate --help."


def run_evaluate(options: EvaluateOptions, *, command: str = "") -> Path:
    """Measure what the options say, print the table and write the files.

    Args:
        options: The command line.
        command: The same as text, for the record.

    Returns:
        The folder that was written.

    Raises:
        InputError: Files or options cannot be used.
    """
    _check(options)
    torch.set_num_threads(1)
    if options.suite:
        from tcfit_app.cli.suite_command import run_suite

        return run_suite(options, command=command)
    assert options.fit is not None
    fit = evaluated_fit(options.fit, run=options.run, models=options.models)
    reference = fit.reference
    if options.reference is not None:
        reference = read_reference(options.reference, camera=options.camera, search=options.models)
    if options.reference_first_frame is not None:
        if reference is None:
            raise InputError(f"--reference-first-frame: {options.fit} has no reference: give --reference too.")
        reference = reference.starting_at(options.reference_first_frame, fit.frame_rate)
    evaluation = evaluated(fit, reference, every=options.every, models=options.models)
    evaluation = replace(evaluation, settings=evaluation.settings | {"Command": command})
    drawn = drawable(fit, reference, options.models)
    worst = worst_frames(evaluation.records, lambda sequence: drawn, count=options.pictures)
    folder = options.out or Path(f"{_file_name(fit.name)}-evaluation")
    write_evaluation(folder, evaluation, worst=worst)
    print_table(evaluation.records)
    for note in evaluation.notes:
        print(f"Note: {note}", file=sys.stderr)
    print(f"Wrote metrics.csv, metrics.json and {REPORT_NAME} into {folder}")
    return folder


def _check(options: EvaluateOptions) -> None:
    """Raises InputError for options that do not go together."""
    if options.suite == (options.fit is not None):
        raise InputError(_NEEDED if not options.suite else "--suite makes its own fits: leave out FIT, or --suite.")
    own = (options.reference, options.run, options.camera, options.reference_first_frame)
    if options.suite and any(option is not None for option in own):
        raise InputError(
            "--suite has its own truth: leave out --reference, --camera, --reference-first-frame and --run."
        )
    if options.ablations and not options.suite:
        raise InputError("--ablations vary settings on the suite: give --suite too.")
    if options.camera is not None and options.reference is None:
        raise InputError("--camera says where the camera stands in a reference's world: give --reference too.")
    for name in ("every", "jobs"):
        if getattr(options, name) < 1:
            raise InputError(f"--{name} is {getattr(options, name)}; expected 1 or more.")


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip("-.") or "fit"
