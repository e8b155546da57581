"""The evaluated state of some frames, which every term depends on."""

from dataclasses import dataclass
from functools import cached_property

from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.points.body_points import BodyPoints, Posed
from fitting_core.fit.variables.state import Parametrisation, State

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


@dataclass(frozen=True)
class Estimate:
    """Frames `frames` of a clip in a given state."""

    view: SolverView
    state: State
    frames: Int[Tensor, "B"]
    correctives_held: bool = False
    """Whether the points' derivatives leave out what goes through the pose correctives."""

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
        return view.points.forward(
            self.state.orient, pose, p.coefficients(self.state), bins, correctives_held=self.correctives_held
        )

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
    def valid(self) -> Tensor:
        """Frames with every point in front of the camera, (B,) bool."""
        return (self.in_camera[..., 2] > NEAREST).all(1)
