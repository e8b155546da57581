"""Every term of the per-frame objective E_o, as residuals (term_table.py has the table of them).

A term's cost is the sum of its squared residuals. That is all a term needs: `residual`. What it knows beyond (which
columns it touches, a closed-form Jacobian) is a speed-up, checked against automatic differentiation in the tests.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.model import JOINT, POSE_COLUMNS
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.point_jacobian import PointJacobian
from fitting_core.rotations import hat

WIDENED = 6.0
"""How much wider the robust function is that Levenberg-Marquardt minimises first from a cold start."""

TRUSTED = 1e4
"""Pixels: rho that is no robust function any more."""


class Term(Protocol):
    """A part of E_o."""

    @property
    def name(self) -> str:
        """Under which its cost is reported."""
        ...

    def residual(self, e: Estimate) -> Float[Tensor, "B n"]:
        """Weighted residuals; their squares add up to the term's cost."""
        ...


class ColumnTerm(Term, Protocol):
    """A term in which each residual depends on one column alone, so that only the diagonal of the matrix is touched."""

    def columns(self, e: Estimate) -> tuple[Int[Tensor, "n"], bool]:
        """The columns, and whether they count in the axis-angle pose (True) or in the prior's own space (False)."""
        ...

    def slope(self, e: Estimate) -> Float[Tensor, "B n"]:
        """Derivative of each residual by its column."""
        ...


class RowTerm(Term, Protocol):
    """A term with a closed-form Jacobian in the columns of the axis-angle pose."""

    def rows(self, e: Estimate, jacobian: PointJacobian) -> "Rows":
        """Residual rows of the normal equations."""
        ...


class StaircaseTerm(Term, Protocol):
    """A term whose slope says little about how it falls, so that Gauss-Newton steps need a gentler one to follow."""

    def softened(self) -> Term:
        """The gentler term, with its minima in about the same places."""
        ...


@dataclass(frozen=True)
class Rows:
    """Rows of the Gauss-Newton system: half gradient J^T r (+ extra), half matrix J^T J."""

    residual: Float[Tensor, "B n"]
    jacobian: Float[Tensor, "B n width"]
    extra_gradient: Float[Tensor, "B width"] | None = None


@dataclass(frozen=True)
class Data:
    """Reprojection error with the Geman-McClure function on x and y apart.

    sum (confidence x weight)^2 [g(du) + g(dv)] (1000 / height)^2, g(r) = rho^2 r^2 / (r^2 + rho^2) (METHOD, E_J). As a
    residual that is rho r / sqrt(r^2 + rho^2).
    """

    xy: Float[Tensor, "T N 2"]
    weight: Float[Tensor, "T N"]
    """Confidence x joint weight x 1000 / image height."""
    side: Float[Tensor, "T N 2"]
    """1 (-1): the point lies there or at a larger (smaller) coordinate, see reliability.cut_off; 0: just there."""
    rho: Float[Tensor, "N 1"]
    """Pixels at which the Geman-McClure function stops to pull."""
    name: str = "data"

    def errors(self, e: Estimate) -> Float[Tensor, "B N 2"]:
        """Pixels from the keypoints; 0 where one-sided ones are kept."""
        error = e.pixels - self.xy[e.frames]
        return torch.where(error * self.side[e.frames] > 0, 0.0, error)

    def widened(self) -> "Data":
        """With a wider robust function, under which points that are far off still pull."""
        return replace(self, rho=WIDENED * self.rho)

    def trusting(self) -> "Data":
        """With a robust function too wide to matter."""
        return replace(self, rho=torch.full_like(self.rho, TRUSTED))

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


@dataclass(frozen=True)
class Quadratic:
    """weight x (columns - target): the L2 priors, and the depth of the camera step."""

    name: str
    where: slice
    """In the prior's own space."""
    weight: Float[Tensor, "n"]
    target: Float[Tensor, "n"] | Float[Tensor, "T n"] | None = None

    def residual(self, e: Estimate) -> Tensor:
        """Weighted distance from the target."""
        value = e.state.vector[:, self.where]
        if self.target is not None:
            value = value - (self.target[e.frames] if self.target.ndim == 2 else self.target)
        return self.weight * value

    def columns(self, e: Estimate) -> tuple[Tensor, bool]:
        """The slice's columns."""
        return torch.arange(self.where.start, self.where.stop, device=self.weight.device), False

    def slope(self, e: Estimate) -> Tensor:
        """The weights."""
        return self.weight.expand(len(e.frames), -1)


_BENDING = [("left_elbow", 1, 1.0), ("right_elbow", 1, -1.0), ("left_knee", 0, -1.0), ("right_knee", 0, -1.0)]


@dataclass(frozen=True)
class Bending:
    """weight x exp(s theta) on elbows (y axis) and knees (x axis), s such that the natural bend is negative."""

    weight: float
    name: str = "bending"

    def _columns(self) -> list[int]:
        return [3 * (JOINT[joint] - 1) + axis for joint, axis, _ in _BENDING]

    def residual(self, e: Estimate) -> Tensor:
        """One residual for each of the four joints."""
        sign = e.body_pose.new_tensor([s for *_, s in _BENDING])
        return self.weight * torch.exp(sign * e.body_pose[:, self._columns()])

    def columns(self, e: Estimate) -> tuple[Tensor, bool]:
        """Columns of the axis-angle pose."""
        return 3 + torch.tensor(self._columns(), device=e.body_pose.device), True

    def slope(self, e: Estimate) -> Tensor:
        """s x residual."""
        return e.body_pose.new_tensor([s for *_, s in _BENDING]) * self.residual(e)


@dataclass(frozen=True)
class Rest:
    """weight x (axis-angle pose - target) on joints that nothing in the image turns (beyond the paper).

    E_T knows accelerations only: without it an arm that leaves the image goes on in a straight line and comes back.
    """

    weight: Float[Tensor, "T 63"]
    target: Float[Tensor, "63"]
    name: str = "rest"

    def residual(self, e: Estimate) -> Tensor:
        """Weighted distance from the target."""
        return self.weight[e.frames] * (e.body_pose - self.target)

    def columns(self, e: Estimate) -> tuple[Tensor, bool]:
        """The whole axis-angle pose."""
        body = POSE_COLUMNS["body_pose"]
        return torch.arange(body.start, body.stop, device=self.weight.device), True

    def slope(self, e: Estimate) -> Tensor:
        """The weights."""
        return self.weight[e.frames]


@dataclass(frozen=True)
class Upright:
    """Lean and turn of the root where no leg is seen (beyond the paper).

    lean x the horizontal part (x and z) of the root's up axis in camera space, and turn x the sideways part (x) of its
    forward axis. Nothing else holds the root there: it leaned 67 degrees on average at 1-3 px error, and turned by up
    to 27 degrees on a signer who faces the camera, because shoulders narrower than the model's ask for it.
    """

    lean: Float[Tensor, "T"]
    turn: Float[Tensor, "T"]
    name: str = "upright"

    def residual(self, e: Estimate) -> Tensor:
        """x and z of the body's y axis, x of its z axis."""
        up, forward = e.state.orient[:, [0, 2], 1], e.state.orient[:, :1, 2]
        return torch.cat([self.lean[e.frames, None] * up, self.turn[e.frames, None] * forward], 1)

    def rows(self, e: Estimate, jacobian: PointJacobian) -> Rows:
        """d (R a) = d x (R a) for a turn d about world axes."""
        by_up, by_forward = (-hat(e.state.orient[:, :, axis]) for axis in (1, 2))
        full = e.state.orient.new_zeros(len(by_up), 3, jacobian.width)
        full[:, :2, :3] = self.lean[e.frames, None, None] * by_up[:, [0, 2]]
        full[:, 2:, :3] = self.turn[e.frames, None, None] * by_forward[:, :1]
        return Rows(self.residual(e), full)
