"""Where a reference lies in time: as its file says, as the user says, or as the movement shows."""

import math
from dataclasses import replace

from fitting_core.errors import InputError
from fitting_core.measure.clocks import found_offset
from fitting_core.measure.references.reference import Reference
from fitting_core.measure.references.resampling import at_frames_of
from tcfit_app.evaluation.evaluated_fits import EvaluatedFit

AUTO = "auto"
"""The offset that is found by the movement."""
_LONGEST = 1e5
"""Seconds: more than a day."""


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
