"""The report about a run as an export."""

import math
from pathlib import Path

from fitting_core.io.motion.fitted_motion import Progress
from fitting_core.measure.report.page import report_page
from tcfit_app.evaluation.evaluated_fits import of_run
from tcfit_app.evaluation.evaluating import drawable, evaluated
from tcfit_app.evaluation.worst_frames import worst_frames
from tcfit_app.exports.source import ExportSource
from tcfit_app.project.storage.reference import stored_reference

SURFACES = 60
"""At most so many frames of a run have their surfaces measured, which takes 0.2 to 0.4 s for each."""
PICTURES = 12


def write_report(source: ExportSource, path: Path, progress: Progress) -> None:
    """A page that needs no network; see `tcfit evaluate`, which can measure every frame."""
    run, clip = source.fit, source.clip
    reference = stored_reference(source.folder)
    fit = of_run(run.fit, clip, run.body, name=run.shown.run.name, folder=source.folder, reference=reference)
    every = math.ceil(len(clip) / SURFACES)
    expected, measured = len(fit.phases) * math.ceil(len(clip) / every), 0

    def done(count: int) -> None:
        nonlocal measured
        measured += count
        progress(0.9 * min(1.0, measured / expected))

    evaluation = evaluated(fit, reference, every=every, done=done)
    drawn = drawable(fit, reference, None)
    worst = worst_frames(evaluation.records, lambda sequence: drawn, count=PICTURES)
    path.write_text(report_page(evaluation, worst=worst, ablations=()), encoding="utf-8")
    progress(1.0)
