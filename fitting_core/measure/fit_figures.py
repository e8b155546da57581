"""Figures of a fit for scripts, by itself or against a reference."""

import os

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.files.regular import StrPath
from fitting_core.measure.comparison import Comparison, compare
from fitting_core.measure.pairing import PosedMotion
from fitting_core.measure.references.bodies import body_of
from fitting_core.measure.references.files import read_reference
from fitting_core.measure.references.reference import Reference
from fitting_core.results.fit_result import FitResult


def evaluate_fit(
    fit: FitResult,
    clip: Clip,
    body: BodyModel,
    reference: StrPath | Reference | None = None,
    *,
    phase: int | None = None,
    every: int = 1,
    surfaces: bool = True,
) -> Comparison:
    """Measure one phase of a fit, as `tcfit evaluate` does.

    Args:
        fit: The result.
        clip: What was fitted; reprojection is measured on its keypoints.
        body: With which body.
        reference: What it is compared with: a file as `read_reference` takes it, or what that has read. None: only
            smoothness, reprojection and volume are measured.
        phase: 1 to 3; None: the last.
        every: Interval of the frames in which surfaces are measured, in some 0.4 s each.
        surfaces: Whether to measure surfaces, where the reference is a body.

    Returns:
        `figures` by name, of which `figure_titles` knows title and unit, None where one cannot be measured; and
        `curves`, a number for each frame.

    Raises:
        InputError: The fit has no such phase, or the reference cannot be read or has no frame in common with it.
    """
    known = read_reference(reference) if isinstance(reference, str | os.PathLike) else reference
    estimate = PosedMotion(
        body=body,
        params=fit.chosen(phase).params,
        camera=fit.camera,
        frame_rate=clip.frame_rate,
        first_frame=clip.first_frame,
        clip=clip,
    )
    truth_body = None if known is None or known.body is None else body_of(known.body)
    return compare(estimate, known, truth_body=truth_body, meshes=surfaces, every=every)
