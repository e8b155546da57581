"""The priors: what a pose, a shape or a camera is likely to be before anything is seen."""

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.model import JOINT, POSE_COLUMNS
from fitting_core.body.rotations import hat
from fitting_core.fit.terms.term import Derivative, Rows, Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.point_jacobian import PointJacobian


@dataclass(frozen=True)
class Quadratic(Term):
    """weight x (columns - target): the L2 priors, E_beta', and the depth of the camera step."""

    name: str
    where: slice
    """In the prior's own space."""
    weight: Float[Tensor, "n"]
    target: Float[Tensor, "n"] | Float[Tensor, "T n"] | None = None
    once: bool = False
    derivative: ClassVar = Derivative.COLUMNS

    def residual(self, e: Estimate) -> Tensor:
        """Weighted distance from the target."""
        value = e.state.vector[:, self.where]
        if self.target is not None:
            value = value - (self.target[e.frames] if self.target.ndim == 2 else self.target)
        return self.weight * value

    def columns(self, e: Estimate) -> Tensor:
        """The slice's columns."""
        return torch.arange(self.where.start, self.where.stop, device=self.weight.device)

    def slope(self, e: Estimate) -> Tensor:
        """The weights."""
        return self.weight.expand(len(e.frames), -1)


@dataclass(frozen=True)
class Height(Term):
    """weight x (height of the shape in the rest pose - what a person says of it), beyond the paper."""

    weight: float
    """Per metre."""
    target: float
    """Metres above the mean shape's."""
    by_betas: Float[Tensor, "10"]
    """Metres that each beta adds."""
    where: slice
    """Of the betas in the state."""
    name: str = "height"

    def residual(self, e: Estimate) -> Tensor:
        """One residual."""
        return self.weight * (e.state.vector[:, self.where] @ self.by_betas - self.target)[:, None]


BENDING = tuple(
    (3 * (JOINT[joint] - 1) + axis, sign)
    for joint, axis, sign in (
        ("left_elbow", 1, 1.0),
        ("right_elbow", 1, -1.0),
        ("left_knee", 0, -1.0),
        ("right_knee", 0, -1.0),
    )
)
"""Columns of the 63 about which elbows and knees bend, and the sign s with which the natural bend is negative."""


@dataclass(frozen=True)
class Bending(Term):
    """weight x exp(s theta) on elbows (y axis) and knees (x axis), see `BENDING`."""

    weight: float
    name: str = "bending"
    derivative: ClassVar = Derivative.POSE_COLUMNS

    def residual(self, e: Estimate) -> Tensor:
        """One residual for each of the four joints."""
        sign = e.body_pose.new_tensor([s for _, s in BENDING])
        return self.weight * torch.exp(sign * e.body_pose[:, [column for column, _ in BENDING]])

    def columns(self, e: Estimate) -> Tensor:
        """Of the axis-angle pose."""
        return 3 + torch.tensor([column for column, _ in BENDING], device=e.body_pose.device)

    def slope(self, e: Estimate) -> Tensor:
        """s x residual."""
        return e.body_pose.new_tensor([s for _, s in BENDING]) * self.residual(e)


@dataclass(frozen=True)
class Rest(Term):
    """weight x (axis-angle pose - target) on joints that nothing in the image turns (beyond the paper).

    E_T knows accelerations only: without it an arm that leaves the image goes on in a straight line and comes back.
    """

    weight: Float[Tensor, "T 63"]
    target: Float[Tensor, "63"]
    name: str = "rest"
    derivative: ClassVar = Derivative.POSE_COLUMNS

    def residual(self, e: Estimate) -> Tensor:
        """Weighted distance from the target."""
        return self.weight[e.frames] * (e.body_pose - self.target)

    def columns(self, e: Estimate) -> Tensor:
        """The whole axis-angle pose."""
        body = POSE_COLUMNS["body_pose"]
        return torch.arange(body.start, body.stop, device=self.weight.device)

    def slope(self, e: Estimate) -> Tensor:
        """The weights."""
        return self.weight[e.frames]


@dataclass(frozen=True)
class Upright(Term):
    """Lean and turn of the root where no leg is seen (beyond the paper).

    lean x the horizontal part (x and z) of the root's up axis in camera space, and turn x the sideways part (x) of its
    forward axis. Nothing else holds the root there: it leaned 67 degrees on average at 1-3 px error, and turned by up
    to 27 degrees on a signer who faces the camera, because shoulders narrower than the model's ask for it.
    """

    lean: Float[Tensor, "T"]
    turn: Float[Tensor, "T"]
    name: str = "upright"
    derivative: ClassVar = Derivative.ROWS

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
