"""Figures of a run against the project's reference."""

from collections.abc import Callable

from fitting_core.body.model import BodyModel
from fitting_core.measure.comparison import compare, figure_titles
from fitting_core.measure.pairing import Estimate
from fitting_core.measure.references.reference import Reference
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.run_metrics import Metric

REFERENCE = "reference_"
"""Before the names of these figures."""
SURFACES = 12
"""Frames whose surfaces are measured, evenly over the clip: each takes some 0.4 s, beside which the page must live."""
_SHOWN = (
    "pa_mpjpe_mean",
    "mpjpe_mean",
    "joint_error_mean",
    "depth_error_mean",
    "acceleration_error_mean",
    "volume_error_mean",
    "vertex_to_surface_mean",
    "vertex_to_surface_std",
    "per_vertex_mean",
)
_SAMPLED = ("vertex_to_surface_mean", "vertex_to_surface_std", "per_vertex_mean")


def reference_metrics(
    fit: PosedFit, reference: Reference, truth_body: Callable[[], BodyModel | None]
) -> tuple[Metric, ...]:
    """Those of the figures that can be measured.

    Args:
        fit: A run over the whole clip.
        reference: The project's.
        truth_body: Reads the body of the reference, which takes a second.
    """
    every = max(1, -(-len(fit) // SURFACES))
    estimate = Estimate(
        body=fit.meshes.body,
        params=fit.params,
        camera=fit.clip.camera,
        frame_rate=fit.clip.frame_rate,
        first_frame=fit.clip.first_frame,
    )
    compared, titles = compare(estimate, reference, truth_body=truth_body(), every=every), figure_titles()
    found, part = compared.figures, compared.compared_frames
    sampled = "" if every == 1 else f", every {every} frames"
    covered = "" if part == len(fit) else f", {part} of {len(fit)} frames"
    return tuple(
        Metric(
            name=REFERENCE + name,
            title=titles[name][0] + (sampled if name in _SAMPLED else "") + covered,
            unit=titles[name][1],
            value=value,
            better="lower",
        )
        for name in _SHOWN
        if (value := found[name]) is not None
    )
