"""Positions of keypoints in space, from evidence other than pixels: relative to the pelvis, or before the camera."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.config.schema import FitConfig
from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import NUMBER
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.data import irls
from fitting_core.fit.terms.entry import Entry, Kernel
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.ground.contacts import FOOT_POINTS
from fitting_core.keypoints import COUNT

_TOLD_WEIGHT = 6.0
"""Weight of a person's statement of depth, in every stage and configuration: the lifter's weight where it is used. An
elbow or wrist 10 cm off costs as much as some 30 px in the image without the robust function, and a prior gives way."""
_TOLD_RHO = 200.0
"""rho for that, in standard deviations: 4 m, so that it pulls from any distance. A person is never an outlier."""
_START_RHO = 4.0
"""rho for a given start combined with the lifter: with 2, as for the lifter alone, a fit left a good start of a person
cut off at the chest (PA-MPJPE 52.7 -> 57.5 mm instead of 53.6)."""
_HELD_RHO = 30.0
"""rho for held feet, in their standard deviations: phase 3 starts some 0.2 m from where they will stand."""


@dataclass(frozen=True)
class _Positions(Term):
    """Points along each axis, with the Geman-McClure function (beyond the paper).

    sum weight^2 g(p - p_0), g(r) = rho^2 r^2 / (r^2 + rho^2).
    """

    target: Float[Tensor, "T N 3"]
    """p_0: metres in camera axes."""
    weight: Float[Tensor, "T N 3"]
    """Per metre; 0 if nothing is known."""
    rho: Float[Tensor, "T N 3"]
    """Metres at which the Geman-McClure function saturates."""

    def points(self, e: Estimate) -> Float[Tensor, "B N 3"]:
        """Metres, to be compared with the target."""
        raise NotImplementedError

    def errors(self, e: Estimate) -> Float[Tensor, "B N 3"]:
        """Metres from the target."""
        return self.points(e) - self.target[e.frames]

    def residual(self, e: Estimate) -> Tensor:
        """Robustified, weighted metres."""
        r, rho = self.errors(e), self.rho[e.frames]
        return (self.weight[e.frames] * rho * r / (r * r + rho**2).sqrt()).flatten(1)

    def reweighted(self, e: Estimate) -> Tensor:
        """As in the data term."""
        return irls(self.errors(e), self.weight[e.frames], self.rho[e.frames]).flatten(1)


@dataclass(frozen=True)
class RelativePosition(_Positions):
    """Relative to the pelvis: depends on the body's orientation and pose, not its place.

    Of x and y the weight is 0 for all points in the data term: the image is more accurate.
    """

    pelvis: Float[Tensor, "3"]
    """Its place in the body's own space, metres: the root rotates about it."""
    name: str = "relative_position"

    @staticmethod
    def of(context: TermContext, looked: UsedKeypoints, s: int) -> "RelativePosition | None":
        """Of the keypoints used, if anything but the image says where they are.

        Weights per standard deviation, and rho, are those of a person's statement for z if there is one, and else those
        of lifter and given start.
        """
        i, o, config = looked.indices, context.observations, context.config
        is_z = torch.tensor([False, False, True], device=o.xy.device)
        by_person = o.depth_by_hand[:, i, None] & is_z
        weight, robust = o.xy.new_tensor([evidence_weight(config, s), config.robust_deviations])
        place, deviation = (a[:, i].to(o.xy) for a in (o.relative_position, o.relative_position_deviation))
        weight = torch.where(by_person, _TOLD_WEIGHT, weight) / deviation
        if not bool(weight.any()):
            return None
        deviations = torch.where(context.near_start[:, None, None], _START_RHO, robust)
        rho = torch.where(by_person, _TOLD_RHO, deviations) * deviation
        # Nothing is known if the deviation is infinite: any finite rho does, as the weight is 0.
        return RelativePosition(place, weight, rho.where(rho.isfinite(), 1.0), context.pelvis)

    def points(self, e: Estimate) -> Float[Tensor, "B N 3"]:
        """From the pelvis."""
        return e.posed.points - self.pelvis


def evidence_weight(config: FitConfig, s: int) -> float:
    """From lifter and given start in a stage (0 to 4); if no stage uses the lifter, the start has its own weight."""
    weights = config.weights.relative_position
    return weights[s] if any(weights) else _TOLD_WEIGHT


@dataclass(frozen=True)
class HeldPosition(_Positions):
    """In camera space: standing feet stay in place."""

    name: str = "held_position"

    @staticmethod
    def of(context: TermContext, looked: UsedKeypoints, s: int) -> "HeldPosition | None":
        """Of the keypoints used, where they are held."""
        i, o, weight = looked.indices, context.observations, context.config.weights.held_position[s]
        if not weight or not bool(o.held_position_deviation.isfinite().any()):
            return None
        place, spread = o.xy.new_zeros(len(o), COUNT, 3), o.xy.new_full((len(o), COUNT), torch.inf)
        place[:, FOOT_POINTS], spread[:, FOOT_POINTS] = o.held_position, o.held_position_deviation
        deviation = spread[:, i, None].expand(-1, -1, 3)
        rho = torch.where(deviation.isfinite(), _HELD_RHO * deviation, 1.0)
        return HeldPosition(place[:, i], weight / deviation, rho)

    def points(self, e: Estimate) -> Float[Tensor, "B N 3"]:
        """From the camera."""
        return e.in_camera


@helper
def position_cost(c, frame, i, scratch, cost):
    """`cost` and that of a point in space. Leaves metres from where it is relative to the pelvis in
    `scratch.error[i, 2:5]`, and from where it is held in `scratch.error[i, 5:]`; the pelvis' place is in `s.v`."""
    keypoint, points, pelvis = c.keypoints[frame, i], scratch.points, scratch.frame.v
    for d in range(3):
        if keypoint.relative_weight[d] > 0.0:
            weight, rho = keypoint.relative_weight[d], keypoint.relative_rho[d]
            e = points[i, d] - pelvis[d] - keypoint.relative[d]
            scratch.error[i, 2 + d] = e
            cost += weight * weight * rho * rho * e * e / (e * e + rho * rho)
        if keypoint.held_weight[d] > 0.0:
            weight, rho = keypoint.held_weight[d], keypoint.held_rho[d]
            e = points[i, d] - keypoint.held[d]
            scratch.error[i, 5 + d] = e
            cost += weight * weight * rho * rho * e * e / (e * e + rho * rho)
    return cost


@helper
def set_position_row(weight, rho, e, d, s):
    """Residual along an axis d and its derivative by the point, see `irls`."""
    squared = rho * rho
    s.by_point[d, 0] = s.by_point[d, 1] = s.by_point[d, 2] = 0.0
    s.by_point[d, d] = weight * squared / (e * e + squared)
    s.residual[d] = s.by_point[d, d] * e


def _kernel(name: str, clip: tuple[tuple, ...], constants: Callable[[Any], dict[str, Any]]) -> Kernel:
    """Target, weight and rho of each point in each frame, under this name."""
    fields = (name, f"{name}_weight", f"{name}_rho")
    return Kernel(
        constants=lambda t: {**dict(zip(fields, (t.target, t.weight, t.rho), strict=True)), **constants(t)},
        clip=clip,
        keypoint=tuple((field, NUMBER, 3) for field in fields),
    )


ENTRIES = (
    Entry(
        name="relative_position",
        kind=RelativePosition,
        about="body keypoints have the depth from the pelvis that the [lifter](developing/layout.md) or a person "
        "states; for undetected ones the whole position counts",
        make=RelativePosition.of,
        weights=("relative_position",),
        kernel=_kernel("relative", (("pelvis", NUMBER, 3),), lambda term: {"pelvis": term.pelvis}),
    ),
    Entry(
        name="held_position",
        kind=HeldPosition,
        about="phase 3: a standing foot stays in place",
        make=HeldPosition.of,
        weights=("held_position",),
        kernel=_kernel("held", (), lambda term: {}),
    ),
)
