"""`tcfit evaluate`: measure a fit against a reference, or the method against the suite; tables and a report."""

import sys
from dataclasses import replace
from datetime import date
from pathlib import Path

import torch
from tqdm import tqdm

from fitting_core.errors import InputError
from fitting_core.evaluation.comparison import compare
from fitting_core.evaluation.records import Evaluation, Record
from fitting_core.evaluation.reference import Reference
from fitting_core.evaluation.reference_bodies import body_of
from fitting_core.evaluation.reference_files import read_reference
from tcfit_app.evaluate_options import EvaluateOptions
from tcfit_app.evaluated_fits import EvaluatedFit, evaluated_fit
from tcfit_app.evaluation_files import REPORT_NAME, print_table, write_evaluation
from tcfit_app.worst_frames import Drawable, worst_frames

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
        from tcfit_app.suite_command import run_suite

        return run_suite(options, command=command)
    assert options.fit is not None
    fit = evaluated_fit(options.fit, run=options.run, models=options.models)
    reference = fit.reference
    if options.reference is not None:
        reference = read_reference(options.reference, camera=options.camera, search=options.models)
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
    if options.suite and (options.reference or options.run or options.camera):
        raise InputError("--suite has its own truth: leave out --reference, --camera and --run.")
    if options.ablations and not options.suite:
        raise InputError("--ablations vary settings on the suite: give --suite too.")
    if options.camera is not None and options.reference is None:
        raise InputError("--camera says where the camera stands in a reference's world: give --reference too.")
    for name in ("every", "jobs"):
        if getattr(options, name) < 1:
            raise InputError(f"--{name} is {getattr(options, name)}; expected 1 or more.")


def evaluated(
    fit: EvaluatedFit, reference: Reference | None, *, every: int = 1, models: Path | None = None
) -> Evaluation:
    """Measure all phases of a fit.

    Args:
        fit: Which.
        reference: What it is compared with; None: only smoothness, reprojection and volume are measured.
        every: Surfaces are measured in every so many frames.
        models: Folder with body models that alone is searched for the reference's.

    Raises:
        InputError: Reference and fit have no moment in common, or the reference's body is not there.
    """
    truth_body = None if reference is None or reference.body is None else body_of(reference.body, search=models)
    records = []
    with tqdm(desc="measuring surfaces", unit="frame", disable=truth_body is None or not sys.stderr.isatty()) as bar:
        for method, (params, seconds) in fit.phases.items():
            found = compare(
                fit.estimate(method),
                reference,
                truth_body=truth_body,
                every=every,
                done=lambda n: bar.update(n) or None,
            )
            records.append(
                Record(
                    sequence=fit.name,
                    motion="",
                    method=method,
                    frames=len(params),
                    frame_rate=fit.frame_rate,
                    seconds=seconds,
                    comparison=found,
                )
            )
    return Evaluation(
        title=f"Evaluation of {fit.name}",
        records=tuple(records),
        settings=_settings(fit, reference),
        notes=notes_about(reference),
    )


def _settings(fit: EvaluatedFit, reference: Reference | None) -> dict[str, str]:
    body = f"{fit.body.kind}, {fit.body.gender}, {fit.body.hash[:12]}"
    compared = "none" if reference is None else f"{reference.name} ({reference.kind}, {len(reference)} frames)"
    return {"Fit": fit.source, "Body": body, "Reference": compared, "Date": date.today().isoformat()}


def notes_about(reference: Reference | None) -> tuple[str, ...]:
    """What a user should know about the comparison."""
    if reference is None:
        return ("There is no reference: only smoothness, reprojection and volume are measured.",)
    notes = list(reference.notes)
    if not reference.in_camera:
        notes.append(
            "The reference stands in a world of its own: only form is compared. With --camera positions and depth are."
        )
    if reference.params is None:
        notes.append("The reference has points and no surface: joints are compared, volumes and surfaces are not.")
    return tuple(notes)


def drawable(fit: EvaluatedFit, reference: Reference | None, models: Path | None) -> Drawable | None:
    """The bodies of a fit, for pictures."""
    truth = None
    if reference is not None and reference.params is not None and reference.body is not None:
        count = len(next(iter(fit.phases.values()))[0])
        frames = reference.frames_of(count, fit.first_frame, fit.frame_rate).clip(0)
        if reference.in_camera:
            truth = body_of(reference.body, search=models), reference.params[frames.tolist()]
    bodies = {name: (fit.body, params) for name, (params, _) in fit.phases.items()}
    return Drawable(camera=fit.camera, bodies=bodies, truth=truth)


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip("-.") or "fit"
