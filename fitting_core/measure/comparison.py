"""Everything measured of a fit: curves over the frames, and figures, those of FIGURES and those of the curves."""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core import metrics
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.files.regular import StrPath
from fitting_core.measure.curves import CURVES
from fitting_core.measure.limbs import LIMB_FIGURES, Limbs, limb_figures, limb_pa_mpjpe
from fitting_core.measure.mesh.errors import MeshErrors, PosedBody, mesh_errors
from fitting_core.measure.pairing import BODY_JOINTS, Pair, PosedMotion
from fitting_core.measure.references.bodies import body_of
from fitting_core.measure.references.files import read_reference
from fitting_core.measure.references.reference import Reference
from fitting_core.results.fit_result import FitResult


@dataclass(frozen=True, kw_only=True)
class FigureKind:
    """One number for a fit."""

    title: str
    unit: str
    value: Callable[[Pair], float | None]
    better: Literal["lower", ""] = "lower"


def _of_truth(figure: Callable[[np.ndarray, float], float]) -> Callable[[Pair], float | None]:
    """A figure of the reference's own movement, at the fit's frames."""

    def value(pair: Pair) -> float | None:
        if pair.reference is None or pair.reference.joints is None or not pair.even or (pair.frames < 0).any():
            return None
        joints = pair.reference.joints[pair.frames][:, BODY_JOINTS]
        return figure(pair.estimate.still(joints) if pair.in_camera else joints, pair.estimate.frame_rate)

    return value


def _of_fit(figure: Callable[[np.ndarray, float], float]) -> Callable[[Pair], float | None]:
    return lambda pair: figure(_still_joints(pair), pair.estimate.frame_rate)


def _still_joints(pair: Pair) -> Float[np.ndarray, "T 22 3"]:
    """The fit's, where a camera that moves does not move them."""
    return pair.estimate.still(pair.estimate.joints[:, BODY_JOINTS])


def _depth_jitter(pair: Pair) -> float:
    return metrics.depth_jitter(_still_joints(pair), pair.estimate.frame_rate, view=pair.estimate.view)


def _bones(pair: Pair) -> float:
    parents = pair.estimate.body.parents
    return 100 * metrics.bone_length_variation(pair.estimate.joints, [(int(parents[j]), j) for j in BODY_JOINTS[1:]])


def _of_limbs(figure: Callable[[Limbs, Limbs], float | None]) -> Callable[[Pair], float | None]:
    def value(pair: Pair) -> float | None:
        if pair.reference is None:
            return None
        found, _ = pair.estimate.points_beside(pair.reference)
        return figure(found[:, kp.LIMBS], pair.matched(pair.reference.points[:, kp.LIMBS]))

    return value


FIGURES: dict[str, FigureKind] = {
    **{
        name: FigureKind(title=figure.title, unit=figure.unit, value=_of_limbs(figure.value))
        for name, figure in LIMB_FIGURES.items()
    },
    "jitter": FigureKind(title="Jitter", unit="mm/frame²", value=_of_fit(lambda j, rate: metrics.jitter(j))),
    "jitter_truth": FigureKind(
        title="Jitter of the truth", unit="mm/frame²", value=_of_truth(lambda j, rate: metrics.jitter(j)), better=""
    ),
    "jerk": FigureKind(title="Jitter, third difference", unit="m/s³", value=_of_fit(metrics.jerk)),
    "jerk_truth": FigureKind(
        title="Jitter of the truth, third difference", unit="m/s³", value=_of_truth(metrics.jerk), better=""
    ),
    "depth_jitter": FigureKind(title="Depth jitter", unit="m/s²", value=_depth_jitter),
    "bone_length_variation": FigureKind(title="Bone length variation", unit="%", value=_bones),
    "shape_variation": FigureKind(
        title="Shape variation", unit="", value=lambda p: metrics.shape_variation(p.estimate.params.betas.numpy())
    ),
}
"""Those that are not statistics of a curve. Motion is measured in still space, where a moving camera moves nothing."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Everything measured of a fit."""

    first_frame: int
    curves: dict[str, list[float | None]]
    """By name in CURVES, a number for each frame; None if not measured."""
    figures: dict[str, float | None]
    """By name: of CURVES with the statistic behind it (`vertex_to_surface_mean`), and of FIGURES."""
    compared_frames: int | None = None
    """In how many frames the reference's form was known; None without a reference."""


def figure_titles() -> dict[str, tuple[str, str, str]]:
    """Title, unit and which is better, of every figure by its name."""
    words = {"mean": "", "std": ", standard deviation"}
    means = {
        f"{name}_{statistic}": (kind.title + words[statistic], kind.unit, kind.better)
        for name, kind in CURVES.items()
        for statistic in kind.statistics
    }
    return means | {name: (kind.title, kind.unit, kind.better) for name, kind in FIGURES.items()}


def statistic_of(values: Float[np.ndarray, "n"], statistic: str) -> float | None:
    """The mean or standard deviation of the finite values; None without any."""
    finite = values[np.isfinite(values)]
    return float(getattr(finite, statistic)()) if len(finite) else None


def compare(
    estimate: PosedMotion,
    reference: Reference | None,
    *,
    truth_body: BodyModel | None = None,
    meshes: bool = True,
    every: int = 1,
    done: Callable[[int], object] | None = None,
) -> Comparison:
    """Measure a fit. Raises InputError if the reference has no moment in common with the fit.

    Args:
        estimate: The fit.
        reference: What it is compared with; None: only what needs no reference is measured.
        truth_body: The body of a reference that is a body (`reference_bodies.body_of`).
        meshes: Whether to measure surfaces, which takes some 0.4 s a frame.
        every: Interval of the frames in which surfaces are measured.
        done: Called with the number of frames whose surfaces have just been measured.
    """
    pair = _paired(estimate, reference, truth_body)
    if pair.true_volumes is not None and meshes:
        pair = _with_surfaces(pair, every, done)
    found = {name: kind.values(pair) for name, kind in CURVES.items()}
    curves = {name: values for name, values in found.items() if values is not None and np.isfinite(values).any()}
    statistics = {
        f"{name}_{statistic}": statistic_of(curves[name], statistic) if name in curves else None
        for name, kind in CURVES.items()
        for statistic in kind.statistics
    }
    return Comparison(
        first_frame=estimate.first_frame,
        curves={name: [_plain(v) for v in values] for name, values in curves.items()},
        figures=statistics | {name: kind.value(pair) for name, kind in FIGURES.items()},
        compared_frames=None if reference is None else int(np.isfinite(curves.get("pa_mpjpe", np.empty(0))).sum()),
    )


def compare_other(name: str, estimate: PosedMotion, reference: Reference) -> Comparison:
    """What another system made of the clip, whose points are in the reference, in the frames of a fit. Raises
    InputError if the reference has no moment in common with the fit.

    Args:
        name: Of the system, in `Reference.others`.
        estimate: The fit: its frames count.
        reference: With the system's points.
    """
    frames = reference.frames_of(len(estimate.params), estimate.first_frame, estimate.frame_rate)
    found, true = (
        np.where(frames[:, None, None] >= 0, points[frames][:, kp.LIMBS], np.nan)
        for points in (reference.others[name], reference.points)
    )
    errors = limb_pa_mpjpe(found, true)
    return Comparison(
        first_frame=estimate.first_frame,
        curves={"pa_mpjpe": [_plain(value) for value in errors]},
        figures={"pa_mpjpe_mean": statistic_of(errors, "mean")} | limb_figures(found, true),
        compared_frames=int(np.isfinite(errors).sum()),
    )


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _paired(estimate: PosedMotion, reference: Reference | None, truth_body: BodyModel | None) -> Pair:
    volumes = PosedBody(body=estimate.body, params=estimate.params).volumes()
    pair = Pair(estimate=estimate, reference=reference, truth_body=truth_body, volumes=volumes)
    if reference is None or reference.params is None or truth_body is None:
        return pair
    true = PosedBody(body=truth_body, params=reference.params).volumes()
    return replace(pair, true_volumes=pair.matched(true))


def _with_surfaces(pair: Pair, every: int, done: Callable[[int], object] | None) -> Pair:
    assert pair.reference is not None and pair.reference.params is not None and pair.truth_body is not None
    there = np.flatnonzero(pair.frames >= 0)
    estimate = PosedBody(body=pair.estimate.body, params=pair.estimate.params[there.tolist()])
    truth = PosedBody(body=pair.truth_body, params=pair.reference.params[pair.frames[there].tolist()])
    found = mesh_errors(estimate, truth, every=every, done=done)

    def spread(values: np.ndarray) -> np.ndarray:
        whole = np.full(len(pair.frames), np.nan)
        whole[there] = values
        return whole

    per_vertex = None if found.per_vertex is None else spread(found.per_vertex)
    meshes = MeshErrors(vertex_to_surface=spread(found.vertex_to_surface), per_vertex=per_vertex)
    return replace(pair, meshes=meshes)


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
