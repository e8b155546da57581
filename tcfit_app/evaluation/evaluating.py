"""Measuring one fit: all of its phases against a reference, or by themselves."""

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fitting_core.body.files.former import is_former
from fitting_core.errors import InputError
from fitting_core.measure.clocks import found_offset
from fitting_core.measure.comparison import Comparison, compare, compare_other
from fitting_core.measure.records import Evaluation, Record
from fitting_core.measure.references.bodies import body_of
from fitting_core.measure.references.reference import Reference
from fitting_core.measure.references.resampling import at_frames_of
from tcfit_app.evaluation.evaluated_fits import EvaluatedFit

AUTO = "auto"
"""The offset that is found by the movement."""
_LONGEST = 1e5
"""Seconds: more than a day."""


def evaluation_of(
    fit: EvaluatedFit,
    reference: Reference | None,
    *,
    every: int = 1,
    models: Path | None = None,
    done: Callable[[int], None] = lambda count: None,
) -> Evaluation:
    """Measure all phases of a fit, against a reference if there is one. Raises InputError if reference and fit have no
    moment in common, or the reference's body is not there.

    Args:
        every: Interval of the frames in which surfaces are measured.
        models: Folder with body models, which alone is searched for the reference's.
        done: Takes how many frames' surfaces were measured; what it raises ends the measuring.
    """
    truth_body = None if reference is None or reference.body is None else body_of(reference.body, search=models)
    records = []
    with tqdm(desc="measuring surfaces", unit="frame", disable=truth_body is None or not sys.stderr.isatty()) as bar:

        def measured(count: int) -> None:
            bar.update(count)
            done(count)

        for method, (_, seconds) in fit.phases.items():
            found = compare(fit.estimate(method), reference, truth_body=truth_body, every=every, done=measured)
            records.append(_record(fit, method, found, seconds))
    others = []
    if reference is not None:  # other systems' points, which come with it, in the frames of the fit
        estimate = fit.estimate(next(iter(fit.phases)))
        others = [_record(fit, name, compare_other(name, estimate, reference)) for name in reference.others]
    return Evaluation(
        title=f"Evaluation of {fit.name}",
        records=(*others, *records),
        settings=_settings(fit, reference),
        notes=(*fit.notes, *_coverage(fit, reference, records), *notes_about(reference, fit.frame_rate)),
    )


def _record(fit: EvaluatedFit, method: str, comparison: Comparison, seconds: float = 0.0) -> Record:
    return Record(
        sequence=fit.name,
        motion="",
        method=method,
        frames=len(fit),
        frame_rate=fit.frame_rate,
        seconds=seconds,
        comparison=comparison,
    )


def _settings(fit: EvaluatedFit, reference: Reference | None) -> dict[str, str]:
    body = f"{fit.body.kind}, {fit.body.gender}, {fit.body.hash[:12]}" + (
        ", of an earlier tcfit" if is_former(fit.body.hash) else ""
    )
    compared = "none" if reference is None else f"{reference.name} ({reference.kind}, {len(reference)} frames)"
    return {"Fit": fit.source, "Body": body, "Reference": compared, "Date": date.today().isoformat()}


def notes_about(reference: Reference | None, frame_rate: float) -> tuple[str, ...]:
    """Notes on the comparison with a fit of this frame rate, for the user."""
    if reference is None:
        return ("There is no reference: only smoothness, volume and, with keypoints, reprojection are measured.",)
    notes = list(reference.notes)
    if not reference.in_camera:
        notes.append(
            "The reference has a world of its own, so only form is compared. --camera adds positions and depth, unless "
            "the clip's camera moves."
        )
    if not reference.is_even(frame_rate):
        notes.append(
            f"The reference has {reference.frame_rate:g} frames per second and the fit {frame_rate:g}: each frame is "
            "compared with the nearest of the reference's, and accelerations and the reference's jitter are left out."
        )
    if reference.params is None:
        notes.append("The reference has points but no surface: joints are compared, volumes and surfaces are not.")
    return tuple(notes)


def _coverage(fit: EvaluatedFit, reference: Reference | None, records: Sequence[Record]) -> tuple[str, ...]:
    """A note if the reference does not cover all frames of the fit."""
    count, compared = records[0].frames, records[0].comparison.compared_frames
    if reference is None or compared is None or compared == count:
        return ()
    known = "" if reference.first_frame_known else ", if it begins with the video"
    covered = fit.first_frame + np.flatnonzero(reference.frames_of(count, fit.first_frame, fit.frame_rate) >= 0)
    reached = len(covered)
    unknown = f" {reached - compared} of the covered frames have too few reference points." * (compared < reached)
    return (
        f"Compared in {compared} of {count} frames: the fit has the video's frames {fit.first_frame} to "
        f"{fit.first_frame + count - 1}, of which the reference covers {covered[0]} to {covered[-1]}{known}. If it "
        f"begins at another time, give --reference-offset or --reference-first-frame.{unknown}",
    )


# --- where a reference lies in time: as its file says, as the user says, or as the movement shows ---


def in_time(
    reference: Reference | None, fit: EvaluatedFit, *, first_frame: int | None, offset: str | None
) -> Reference | None:
    """The reference at the frames of the fit's video, as far as it can be. Raises InputError if there is no reference,
    the offset is no number, or cannot be found.

    Args:
        first_frame: Number in the video of its first frame; None: as it says.
        offset: Second of the video at which its first frame was taken, or AUTO; None: as it says.
    """
    if reference is None:
        for name, given in (("first-frame", first_frame), ("offset", offset)):
            if given is not None:
                raise InputError(f"--reference-{name}: {fit.source} has no reference: give --reference too.")
        return None
    if first_frame is not None:
        reference = reference.starting_at(first_frame, fit.frame_rate)
    if offset is None:
        return _as_it_says(reference, fit)
    if offset != AUTO:
        return at_frames_of(reference, fit.frame_rate, start=seconds_of(offset))
    found = found_offset(fit.estimate(list(fit.phases)[-1]), reference)
    placed = at_frames_of(reference, fit.frame_rate, start=found.seconds)
    return replace(placed, notes=(*placed.notes, found.text))


def _as_it_says(reference: Reference, fit: EvaluatedFit) -> Reference:
    """Points are interpolated between their frames; a reference of any other kind stays as it is."""
    if reference.params is not None or reference.joints is not None or reference.is_even(fit.frame_rate):
        return reference
    reference.frames_of(len(fit), fit.first_frame, fit.frame_rate)  # raises where it is not clear where it begins
    note = f"Its {reference.frame_rate:g} frames per second are interpolated to the fit's {fit.frame_rate:g}."
    placed = at_frames_of(reference, fit.frame_rate)
    return replace(placed, notes=(*placed.notes, note))


def seconds_of(offset: str) -> float:
    """The offset as a number. Raises InputError if it is not a time."""
    try:
        seconds = float(offset)
    except ValueError:
        seconds = math.nan
    if not abs(seconds) <= _LONGEST:
        raise InputError(
            f"--reference-offset {offset[:40]}: is not a time; expected seconds, such as -0.37, or {AUTO} to find it "
            "by the movement."
        )
    return seconds
