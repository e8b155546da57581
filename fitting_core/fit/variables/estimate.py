"""The evaluated state of some frames, which every term depends on."""

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.points.body_points import BodyPoints, Posed
from fitting_core.fit.variables.state import Columns, Parametrisation, State

NEAREST = 0.1
"""Metres: points nearer to the camera, or behind it, make a state invalid."""


@dataclass(frozen=True)
class SolverView:
    """The constants of a stage: the points used, their camera, and the head's yaw tables."""

    parametrisation: Parametrisation
    points: BodyPoints
    focal: Float[Tensor, "2"]
    center: Float[Tensor, "2"]
    contour_bin: Int[Tensor, "T"] | None = None
    """For every frame of the clip, fixed through a stage: the tables differ by millimetres."""

    @property
    def pose_columns(self) -> Columns:
        """Columns of derivatives by the axis-angle pose, whatever the prior's own space."""
        return Columns(63, self.parametrisation.columns.hand)


@dataclass(frozen=True)
class Estimate:
    """Frames `frames` of a clip in a given state."""

    view: SolverView
    state: State
    frames: Int[Tensor, "B"]

    @cached_property
    def body_pose(self) -> Float[Tensor, "B 63"]:
        """Axis-angle of the body joints, decoded by the pose prior."""
        return self.view.parametrisation.body_pose(self.state)

    @cached_property
    def posed(self) -> Posed:
        """The points, without camera translation."""
        p, view = self.view.parametrisation, self.view
        bins = None if view.contour_bin is None else view.contour_bin[self.frames]
        pose = p.pose(self.state, self.body_pose)
        return view.points.forward(self.state.orient, pose, p.coefficients(self.state), bins)

    @cached_property
    def in_camera(self) -> Float[Tensor, "B N 3"]:
        """The points in camera space."""
        translation = self.state.vector[:, self.view.parametrisation.columns.translation]
        return self.posed.points + translation[:, None]

    @cached_property
    def pixels(self) -> Float[Tensor, "B N 2"]:
        """The points' projections."""
        return self.view.focal * self.in_camera[..., :2] / self.in_camera[..., 2:] + self.view.center

    @cached_property
    def projection(self) -> Float[Tensor, "B N 2 3"]:
        """d pixels / d point."""
        x, y, z = self.in_camera.unbind(-1)
        fx, fy = self.view.focal
        zero = torch.zeros_like(z)
        rows = [fx / z, zero, -fx * x / z**2, zero, fy / z, -fy * y / z**2]
        return torch.stack(rows, -1).view(*z.shape, 2, 3)

    @cached_property
    def valid(self) -> Tensor:
        """Frames with every point in front of the camera, (B,) bool."""
        return (self.in_camera[..., 2] > NEAREST).all(1)
