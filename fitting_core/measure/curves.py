"""Measures of each frame of a fit: the CURVES table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from jaxtyping import Float

from fitting_core import metrics
from fitting_core.io.summary import counted_keypoints
from fitting_core.keypoints import COUNT, ERROR_GROUPS
from fitting_core.measure.pairing import Pair, pixels_of

_FEWEST = 4
"""Points without which a frame is not aligned."""
PointMetric = Callable[[np.ndarray, np.ndarray, list[int]], np.ndarray]
Curve = Callable[[Pair], Float[np.ndarray, "T"] | None]


def _on_points(metric: PointMetric, *, placed: bool, rooted: bool = False) -> Curve:
    """A metric of points, frame by frame on those that are known there; with `rooted`, where the root is."""

    def curve(pair: Pair) -> Float[np.ndarray, "T"] | None:
        if pair.points is None or (placed and not pair.in_camera):
            return None
        estimate, truth, roots = pair.points
        known = np.asarray(np.isfinite(truth).all(-1))
        values = np.full(len(estimate), np.nan)
        for pattern in np.unique(known, axis=0):
            frames, kept = (known == pattern).all(1), np.flatnonzero(pattern)
            if len(kept) >= _FEWEST and (not rooted or pattern[roots].all()):
                own_roots = np.searchsorted(kept, roots).tolist()
                values[frames] = metric(estimate[frames][:, kept], truth[frames][:, kept], own_roots)
        return values if np.isfinite(values).any() else None

    return curve


def _acceleration_error(pair: Pair) -> Float[np.ndarray, "T"] | None:
    if pair.points is None or not pair.in_camera or not pair.even:
        return None
    estimate, truth, roots = pair.points
    still = pair.estimate.still(estimate), pair.estimate.still(truth)
    rooted = metrics.rooted(still[0], roots), metrics.rooted(still[1], roots)
    whole = np.asarray(np.isfinite(truth[pair.frames >= 0]).all((0, 2)))
    chosen = whole if whole.any() else np.ones(len(whole), bool)
    return metrics.acceleration_error(rooted[0][:, chosen], rooted[1][:, chosen], pair.estimate.frame_rate)


def _reprojection(pair: Pair, columns: Sequence[int] = range(COUNT)) -> Float[np.ndarray, "T"] | None:
    fit = pair.estimate
    if fit.clip is None:
        return None
    counted = np.zeros((len(fit.pixels), COUNT), bool)
    counted[:, columns] = (counted_keypoints(fit.clip, fit.body) & np.isfinite(fit.pixels).all(-1))[:, columns]
    return metrics.frame_means(fit.pixels, fit.clip.keypoints.xy, counted)


def _reprojection_share(pair: Pair) -> Float[np.ndarray, "T"] | None:
    errors, clip = _reprojection(pair), pair.estimate.clip
    if errors is None or clip is None:
        return None
    return 100 * errors / metrics.heights_in_image(clip.keypoints.xy, counted_keypoints(clip, pair.estimate.body))


def _reprojection_of_truth(pair: Pair) -> Float[np.ndarray, "T"] | None:
    camera = pair.estimate.camera
    if camera is None or pair.reference is None or not pair.in_camera:
        return None
    true = pixels_of(camera, pair.matched(pair.reference.points))
    counted = np.asarray(np.isfinite(true).all(-1) & np.isfinite(pair.estimate.pixels).all(-1))
    return metrics.frame_means(pair.estimate.pixels, true, counted)


@dataclass(frozen=True, kw_only=True)
class CurveKind:
    """Something that is measured in every frame."""

    title: str
    unit: str
    values: Curve
    """None if it cannot be measured."""
    statistics: tuple[Literal["mean", "std"], ...] = ("mean",)
    """Which figures it gives."""
    better: Literal["lower", ""] = "lower"


CURVES: dict[str, CurveKind] = {
    "vertex_to_surface": CurveKind(
        title="Vertex-to-surface error",
        unit="cm",
        values=lambda p: None if p.meshes is None else 100 * p.meshes.vertex_to_surface,
        statistics=("mean", "std"),
    ),
    "volume_error": CurveKind(
        title="Volume error",
        unit="dm³",
        values=lambda p: None if p.true_volumes is None else abs(p.volumes - p.true_volumes),
    ),
    "per_vertex": CurveKind(
        title="Vertex error, pelvis aligned",
        unit="mm",
        values=lambda p: None if p.meshes is None or p.meshes.per_vertex is None else 1e3 * p.meshes.per_vertex,
    ),
    "pa_mpjpe": CurveKind(
        title="PA-MPJPE", unit="mm", values=_on_points(lambda e, t, r: metrics.pa_mpjpe(e, t), placed=False)
    ),
    "mpjpe": CurveKind(title="MPJPE", unit="mm", values=_on_points(metrics.mpjpe, placed=True, rooted=True)),
    "joint_error": CurveKind(
        title="Joint error in the camera",
        unit="mm",
        values=_on_points(lambda e, t, r: metrics.point_error(e, t), placed=True),
    ),
    "depth_error": CurveKind(
        title="Depth error",
        unit="mm",
        values=_on_points(lambda e, t, r: abs(metrics.depth_error(e, t)), placed=True),
        statistics=("mean", "std"),
    ),
    "acceleration_error": CurveKind(title="Acceleration error", unit="m/s²", values=_acceleration_error),
    "reprojection": CurveKind(title="Reprojection error", unit="px", values=_reprojection),
    **{
        f"reprojection_{name}": CurveKind(
            title=f"Reprojection error, {name}", unit="px", values=partial(_reprojection, columns=columns)
        )
        for name, columns in ERROR_GROUPS.items()
    },
    "reprojection_share": CurveKind(
        title="Reprojection error, of the person's length", unit="%", values=_reprojection_share
    ),
    "reprojection_truth": CurveKind(
        title="Reprojection error against the truth", unit="px", values=_reprojection_of_truth
    ),
    "volume": CurveKind(title="Volume", unit="dm³", values=lambda p: p.volumes, statistics=("mean", "std"), better=""),
    "true_volume": CurveKind(title="Volume of the truth", unit="dm³", values=lambda p: p.true_volumes, better=""),
}
"""By name. Joints are the 22 of trunk and limbs; for a reference that is not a body, the 12 keypoints of the limbs and
its joints and markers."""
