"""The data term E_J: how far the body's points are from the keypoints in the image."""

from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.fit.terms.term import Derivative, Rows, Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.point_jacobian import PointJacobian

WIDENED = 6.0
"""How much wider the robust function is that Levenberg-Marquardt minimises first from a cold start."""


@dataclass(frozen=True)
class Data(Term):
    """Reprojection error with the Geman-McClure function on x and y apart.

    sum (confidence x weight)^2 [g(du) + g(dv)] (1000 / height)^2, g(r) = rho^2 r^2 / (r^2 + rho^2) (METHOD, E_J). As a
    residual that is rho r / sqrt(r^2 + rho^2).
    """

    xy: Float[Tensor, "T N 2"]
    weight: Float[Tensor, "T N"]
    """Confidence x joint weight x 1000 / image height."""
    side: Float[Tensor, "T N 2"]
    """1 (-1): the point lies there or at a larger (smaller) coordinate, see image_border.cut_off; 0: just there."""
    rho: Float[Tensor, "N 1"]
    """Pixels at which the Geman-McClure function stops to pull."""
    name: str = "data"
    derivative: ClassVar = Derivative.ROWS

    def errors(self, e: Estimate) -> Float[Tensor, "B N 2"]:
        """Pixels from the keypoints; 0 where one-sided ones are kept."""
        error = e.pixels - self.xy[e.frames]
        return torch.where(error * self.side[e.frames] > 0, 0.0, error)

    def softened(self, *, cold: bool) -> "Data":
        """From a cold start with a wider robust function, under which points that are far off still pull."""
        return replace(self, rho=WIDENED * self.rho) if cold else self

    def residual(self, e: Estimate) -> Tensor:
        """Robustified, weighted pixels."""
        r = self.errors(e)
        return (self.weight[e.frames][..., None] * self.rho * r / (r * r + self.rho**2).sqrt()).flatten(1)

    def rows(self, e: Estimate, jacobian: PointJacobian) -> Rows:
        """IRLS: exact gradient; Triggs' correction was no better and left outliers where they were."""
        r = self.errors(e)
        scale = self.weight[e.frames][..., None] * self.rho**2 / (r * r + self.rho**2)
        weighted, left = scale * r, scale[..., None] * e.projection
        pull = (left.transpose(-1, -2) @ weighted[..., None])[..., 0]
        correctives = jacobian.corrective_gradient(e.posed, pull)
        return Rows(weighted.flatten(1), jacobian(e.posed, left), correctives)
