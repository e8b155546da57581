"""The whole page."""

from collections.abc import Sequence

from fitting_core.measure.records import Evaluation, sequences
from fitting_core.measure.report.markup import Markup, joined, tag
from fitting_core.measure.report.plots import CSS
from fitting_core.measure.report.sections import (
    SURFACE,
    WorstFrame,
    all_figures,
    paper_table,
    provenance,
    section,
    together,
    verdict,
    worst_frames,
)

_TABLE = (
    "The paper's table: mean and standard deviation over all frames. Vertex to surface: the fitted mesh is aligned "
    "rigidly (ICP), then the distances of its vertices from the closest points of the true surface are averaged. "
    "Volume error: mean absolute difference of the closed meshes' volumes."
)
OVER_TIME = (
    (SURFACE, "", "Error over the frames"),
    ("volume", "true_volume", "Volume over time"),
    ("pa_mpjpe", "", "PA-MPJPE over the frames"),
    ("joint_error", "", "Joint error in the camera over the frames"),
    ("reprojection", "", "Reprojection error over the frames"),
)
"""Curves, those of the truth beside them, and titles where each has a section."""
_HEAD = '<!doctype html><html lang="en"><head><meta charset="utf-8">'
_VIEWPORT = '<meta name="viewport" content="width=device-width, initial-scale=1">'


def report_page(evaluation: Evaluation, *, worst: Sequence[WorstFrame] = (), sections: Sequence[Markup] = ()) -> str:
    """HTML that shows itself without a network.

    Args:
        evaluation: What was measured.
        worst: Pictures.
        sections: What else there is to show, as `section` makes it.
    """
    parts = [tag("h1", evaluation.title)]
    parts += [tag("p", note, class_="dim") for note in evaluation.notes]
    if evaluation.records:
        parts += [verdict(evaluation.records), section("Errors", paper_table(evaluation.records), note=_TABLE)]
        if len(sequences(evaluation.records)) == 1:
            parts.append(section("Over the frames", together(evaluation, [(c, truth) for c, truth, _ in OVER_TIME])))
    if worst:
        parts.append(section("Worst frames", worst_frames(worst), note=_WORST))
    parts += sections
    if evaluation.records:
        parts.append(section("All figures", all_figures(evaluation), note="Over all frames of a motion."))
    parts.append(section("How this was measured", provenance(evaluation)))
    head = joined([Markup(_HEAD), Markup(_VIEWPORT), tag("title", evaluation.title), Markup(f"<style>{CSS}</style>")])
    return f"{head}</head><body>{tag('main', *parts)}</body></html>\n"


_WORST = (
    "The frames with the largest errors, one of each sequence. Above as the clip's camera sees them, below from the "
    "side, pelvis on pelvis: what is wrong in depth shows there alone."
)
