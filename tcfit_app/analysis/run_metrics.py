"""Figures of a run, by itself and against the project's reference, and comparisons of two runs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from fitting_core.body.model import BodyModel
from fitting_core.keypoints import ERROR_GROUPS
from fitting_core.measure import comparison
from fitting_core.measure.pairing import PosedMotion
from fitting_core.measure.references.reference import Reference
from fitting_core.metrics import error_figures, jitter, torso_lean
from tcfit_app.analysis.posed_fit import PosedFit


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A figure of a run."""

    name: str
    title: str
    unit: str
    value: float | None
    """None if it cannot be measured."""
    lower_is_better: bool = True
    """False: no value is better as such."""


@dataclass(frozen=True, kw_only=True)
class ComparedMetric:
    """A figure of two runs."""

    of: Metric
    """A's, or B's if A has none."""
    a: float | None
    b: float | None

    @property
    def difference(self) -> float | None:
        """b - a."""
        return None if self.a is None or self.b is None else self.b - self.a

    @property
    def better(self) -> Literal["a", "b", ""]:
        """Empty: equally good, unknown, or not comparable."""
        a, b = self.a, self.b
        if not self.of.lower_is_better or a is None or b is None or abs(b - a) <= _AS_GOOD * max(abs(a), abs(b)):
            return ""
        return "a" if a < b else "b"


@dataclass(frozen=True, kw_only=True)
class MetricKind:
    """How a figure is computed."""

    title: str
    unit: str
    value: Callable[[PosedFit], float | None]
    lower_is_better: bool = True
    """As in Metric."""


_AS_GOOD = 0.01
"""Figures that differ by a smaller fraction are equally good."""


def run_metrics(fit: PosedFit, seconds: float) -> tuple[Metric, ...]:
    """The METRICS of a run, and the seconds of the phases that it computed itself, 0 if it was not fitted here."""
    found = (
        Metric(name=name, title=kind.title, unit=kind.unit, value=kind.value(fit), lower_is_better=kind.lower_is_better)
        for name, kind in METRICS.items()
    )
    return (*found, Metric(name="seconds", title="Time to fit", unit="s", value=seconds or None))


def compare(a: tuple[Metric, ...], b: tuple[Metric, ...]) -> tuple[ComparedMetric, ...]:
    """Two runs' figures, row by row: all of the first one's, then those that only the second one has."""
    ones, others = {m.name: m.value for m in a}, {m.name: m.value for m in b}
    of = {m.name: m for m in (*b, *a)}
    names = dict.fromkeys([*ones, *others])
    return tuple(ComparedMetric(of=of[name], a=ones.get(name), b=others.get(name)) for name in names)


def _error(figure: str) -> Callable[[PosedFit], float | None]:
    return lambda fit: error_figures(fit.errors)[figure]


def _jitter(points: Callable[[PosedFit], Float[np.ndarray, "T 55 3"]]) -> Callable[[PosedFit], float | None]:
    return lambda fit: jitter(points(fit)) if len(fit) > 2 else None


def _acceleration(fit: PosedFit) -> float | None:
    return jitter(fit.still_joints) / 1e3 * fit.clip.frame_rate**2 if len(fit) > 2 else None


def _height(fit: PosedFit) -> float:
    mean, by_betas = fit.meshes.body.height
    return mean + float(by_betas @ fit.params.betas.mean(0).numpy())


METRICS: dict[str, MetricKind] = {
    **{
        f"reprojection_{group}{short}": MetricKind(
            title=f"Reprojection, {group.replace('_', ', ')}{words}", unit="px", value=_error(group + short)
        )
        for group in ("", *(f"{name}_" for name in ERROR_GROUPS))
        for short, words in (("median", "median"), ("p95", "95 %"))
    },
    "jitter": MetricKind(title="Jitter", unit="mm/frame²", value=_jitter(lambda fit: fit.still_joints)),
    "jitter_in_body": MetricKind(
        title="Jitter without translation", unit="mm/frame²", value=_jitter(lambda fit: fit.joints_in_body)
    ),
    "acceleration": MetricKind(title="Jitter", unit="m/s²", value=_acceleration),
    "height": MetricKind(title="Body height", unit="m", value=_height, lower_is_better=False),
    "betas_size": MetricKind(
        title="Shape, distance from the mean shape",
        unit="σ",
        value=lambda fit: float(fit.params.betas.mean(0).norm()),
        lower_is_better=False,
    ),
    "betas_std": MetricKind(
        title="Shape, standard deviation",
        unit="",
        value=lambda fit: float(fit.params.betas.std(0, correction=0).mean()),
    ),
    "lean": MetricKind(
        title="Lean of the torso, mean",
        unit="°",
        value=lambda fit: float(torso_lean(fit.joints).mean()),
        lower_is_better=False,
    ),
}
"""By name. Reprojection errors are over the keypoints counted in summary.json; jitter is the mean second difference of
the 55 joints, in camera space unless stated; the shape's deviation is over frames, mean of the betas."""


# --- against a reference ---

REFERENCE = "reference_"
"""Prefix of these figures' names."""
SURFACES = 12
"""Number of frames whose surfaces are measured, evenly over the clip: each takes about 0.4 s, during which the page
must respond."""
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
    """The figures of a whole run against the project's reference, as far as they can be measured.

    `truth_body` reads the reference's body, which takes a second.
    """
    every = max(1, -(-len(fit) // SURFACES))
    estimate = PosedMotion(
        body=fit.meshes.body,
        params=fit.params,
        camera=fit.clip.camera,
        frame_rate=fit.clip.frame_rate,
        first_frame=fit.clip.first_frame,
    )
    compared = comparison.compare(estimate, reference, truth_body=truth_body(), every=every)
    titles = comparison.figure_titles()
    found, part = compared.figures, compared.compared_frames
    sampled = "" if every == 1 else f", every {every} frames"
    covered = "" if part == len(fit) else f", {part} of {len(fit)} frames"
    return tuple(
        Metric(
            name=REFERENCE + name,
            title=titles[name][0] + (sampled if name in _SAMPLED else "") + covered,
            unit=titles[name][1],
            value=value,
        )
        for name in _SHOWN
        if (value := found[name]) is not None
    )
