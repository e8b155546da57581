"""Where keypoints lie in space, as far as there is evidence of it: relative to the pelvis, or before the camera."""

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.fit.terms.term import Derivative, Rows, Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.point_jacobian import PointJacobian


@dataclass(frozen=True)
class _Positions(Term):
    """Points along each axis, with the Geman-McClure function (beyond the paper).

    sum weight^2 g(p - p_0), g(r) = rho^2 r^2 / (r^2 + rho^2).
    """

    target: Float[Tensor, "T N 3"]
    """p_0: metres in camera axes."""
    weight: Float[Tensor, "T N 3"]
    """Per metre; 0 where nothing is known."""
    rho: Float[Tensor, "T N 3"]
    """Metres at which the Geman-McClure function stops to pull."""
    derivative: ClassVar = Derivative.ROWS
    moves_with_camera: ClassVar[bool]
    """Whether the camera's translation has a part in it."""

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

    def rows(self, e: Estimate, jacobian: PointJacobian) -> Rows:
        """IRLS, as of the data term."""
        r, rho = self.errors(e), self.rho[e.frames]
        scale = self.weight[e.frames] * rho**2 / (r * r + rho**2)
        weighted, left = scale * r, torch.diag_embed(scale)
        correctives = jacobian.corrective_gradient(e.posed, scale * weighted)
        return Rows(weighted.flatten(1), jacobian(e.posed, left, translation=self.moves_with_camera), correctives)


@dataclass(frozen=True)
class RelativePosition(_Positions):
    """Relative to the pelvis: only how the body stands and bends counts, not where it is.

    Of x and y the weight is 0 for all points that the data term weighs: the image knows better.
    """

    pelvis: Float[Tensor, "3"]
    """Its place in the body's own space, metres: the root turns about it."""
    name: str = "relative_position"
    moves_with_camera: ClassVar[bool] = False

    def points(self, e: Estimate) -> Float[Tensor, "B N 3"]:
        """From the pelvis."""
        return e.posed.points - self.pelvis


@dataclass(frozen=True)
class HeldPosition(_Positions):
    """In camera space: what stands stays where it stands."""

    name: str = "held_position"
    moves_with_camera: ClassVar[bool] = True

    def points(self, e: Estimate) -> Float[Tensor, "B N 3"]:
        """From the camera."""
        return e.in_camera
