"""The data term E_J: distance of the body's points from the keypoints in the image."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.fit.compiled.jit import helper
from fitting_core.fit.compiled.layout import NUMBER
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.entry import Entry, Kernel
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate

WIDENED = 6.0
"""Factor on the width of the robust function for Levenberg-Marquardt's first pass from a cold start."""


@dataclass(frozen=True)
class Data(Term):
    """Reprojection error with the Geman-McClure function on x and y separately.

    sum (confidence x weight)^2 [g(du) + g(dv)] (1000 / height)^2, g(r) = rho^2 r^2 / (r^2 + rho^2) (paper, E_J). As a
    residual that is rho r / sqrt(r^2 + rho^2).
    """

    xy: Float[Tensor, "T N 2"]
    weight: Float[Tensor, "T N"]
    """Confidence x joint weight x 1000 / image height."""
    side: Float[Tensor, "T N 2"]
    """1 (-1): the point is there or at a larger (smaller) coordinate, see image_border.cut_off; 0: exactly there."""
    rho: Float[Tensor, "N 1"]
    """Pixels at which the Geman-McClure function saturates."""
    name: str = "data"

    @staticmethod
    def of(context: TermContext, looked: UsedKeypoints) -> "Data":
        """The term on these keypoints."""
        i, o, config = looked.indices, context.observations, context.config
        scale = context.camera.size[1] / config.robust_at_height if config.robust_at_height else 1.0
        fine = (i >= kp.HANDS.start)[:, None]
        rho = scale * torch.where(fine, config.robust_pixels_fine, config.robust_pixels).to(o.xy)
        return Data(o.xy[:, i], looked.weight, o.side[:, i].to(o.xy), rho)

    def errors(self, e: Estimate) -> Float[Tensor, "B N 2"]:
        """Pixels from the keypoints; 0 for satisfied one-sided ones, with the slope of the others.

        This keeps their rows in the normal matrix, so steps that would violate them are shortened.
        """
        error = e.pixels - self.xy[e.frames]
        return error - torch.where(error * self.side[e.frames] > 0, error, 0.0).detach()

    def softened(self, *, cold: bool) -> "Data":
        """From a cold start with a wider robust function, under which distant points still pull."""
        return replace(self, rho=WIDENED * self.rho) if cold else self

    def residual(self, e: Estimate) -> Tensor:
        """Robustified, weighted pixels."""
        r = self.errors(e)
        return (self.weight[e.frames][..., None] * self.rho * r / (r * r + self.rho**2).sqrt()).flatten(1)

    def reweighted(self, e: Estimate) -> Tensor:
        """IRLS: Triggs' correction was no better and left outliers in place."""
        return irls(self.errors(e), self.weight[e.frames][..., None], self.rho).flatten(1)


def irls(r: Tensor, weight: Tensor, rho: Tensor) -> Tensor:
    """s r with s = weight rho^2 / (r^2 + rho^2) held: (s r) s is half the slope of weight^2 g(r), which is weight^2 r
    rho^4 / (r^2 + rho^2)^2, and the matrix gets s^2."""
    return (weight * rho**2 / (r * r + rho**2)).detach() * r


@helper
def data_cost(c, frame, i, scratch, cost):
    """`cost` and that of a point in the image. Leaves the errors, pixels, in `scratch.error[i, :2]`."""
    keypoint, points, clip = c.keypoints[frame, i], scratch.points, c.clip
    weight, squared = keypoint.weight * keypoint.weight, c.points[i].rho * c.points[i].rho
    for d in range(2):
        e = clip.focal[d] * points[i, d] / points[i, 2] + clip.center[d] - keypoint.xy[d]
        if e * keypoint.side[d] > 0:
            e = 0.0
        scratch.error[i, d] = e
        cost += weight * squared * e * e / (e * e + squared)
    return cost


@helper
def set_data_rows(c, frame, i, scratch):
    """Residual, and its derivative by the point, of x and y: into `s.residual` and `s.by_point`.

    The residual is s e, with s held as in `irls`; e is in pixels, the point (x, y, z) in camera space, and
    d (f x / z) = (f / z, 0, -f x / z^2).
    """
    s, clip = scratch.frame, c.clip
    weight, squared, depth = c.keypoints[frame, i].weight, c.points[i].rho * c.points[i].rho, scratch.points[i, 2]
    for d in range(2):
        e = scratch.error[i, d]
        scale = weight * squared / (e * e + squared)
        s.by_point[d, 1 - d] = 0.0
        s.by_point[d, d] = scale * clip.focal[d] / depth
        s.by_point[d, 2] = -scale * clip.focal[d] * scratch.points[i, d] / (depth * depth)
        s.residual[d] = scale * e


ENTRY = Entry(
    name="data",
    kind=Data,
    about="projected keypoints are near the detected ones, by confidence; the pull of single outliers is limited "
    "(Geman-McClure)",
    make=lambda context, looked, _: Data.of(context, looked),
    weights=(
        "body_keypoints",
        "hand_keypoints",
        "face_keypoints",
    ),
    kernel=Kernel(
        constants=lambda term: {"xy": term.xy, "side": term.side, "weight": term.weight, "rho": term.rho[:, 0]},
        point=(("rho", NUMBER),),
        keypoint=(("xy", NUMBER, 2), ("side", NUMBER, 2), ("weight", NUMBER)),
    ),
)
