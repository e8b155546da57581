"""The temporal term E_T: joints move evenly from frame to frame."""

from dataclasses import dataclass
from functools import lru_cache

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.body.points.body_points import BodyPoints
from fitting_core.body.points.pairs import Joint
from fitting_core.camera import CameraPath
from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.entry import Entry
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate, SolverView
from fitting_core.fit.variables.state import Parametrisation, State

REACH = 1
"""Frames to either side that a residual of E_T depends on: frames up to twice as far apart are coupled."""


def off_mean(values: Float[Tensor, "s m"]) -> Float[Tensor, "c m"]:
    """J_i - mean(J_{i-1}, J_i, J_{i+1}) = (2 J_i - J_{i-1} - J_{i+1}) / 3 (paper, equation of E_T), of each frame of a
    span that has one before and one after it."""
    return (2 * values[1:-1] - values[:-2] - values[2:]) / 3


class JointPositions:
    """The 55 joints, in the body's own space or in camera space; for a moving camera, in still space.

    Args:
        body: the body model.
        parametrisation: how a state's numbers become its pose.
        in_camera: whether the camera's translation counts.
        path: the camera's motion through these frames; only its rotation matters in the body's own space.
    """

    def __init__(
        self, body: BodyModel, parametrisation: Parametrisation, *, in_camera: bool, path: CameraPath | None = None
    ) -> None:
        points = _joints(body, parametrisation.dtype, parametrisation.device)
        unit = torch.ones(2, dtype=parametrisation.dtype, device=parametrisation.device)
        self.view = SolverView(parametrisation, points, unit, 0 * unit)
        self.in_camera, self.path = in_camera, path
        if path is not None:
            self._turn, self._place = torch.as_tensor(path.to_still).to(unit), torch.as_tensor(path.places).to(unit)

    def estimate(self, state: State, frames: Int[Tensor, "B"] | None = None) -> Estimate:
        """The state's joints, evaluated on demand; `frames` says which of the clip they are, None: the first."""
        index = torch.arange(len(state), device=state.vector.device) if frames is None else frames
        return Estimate(self.view, state, index)

    def __call__(self, state: State) -> Float[Tensor, "B 55 3"]:
        """Metres, of the clip's first frames."""
        return self.of(self.estimate(state))

    def of(self, e: Estimate) -> Float[Tensor, "B 55 3"]:
        """Metres, of what `estimate` gave."""
        return self.in_still_space(e.in_camera if self.in_camera else e.posed.points, e.frames)

    def in_still_space(self, joints: Float[Tensor, "B 55 3"], frames: Int[Tensor, "B"]) -> Float[Tensor, "B 55 3"]:
        """Joints as the camera has them, in still space."""
        if self.path is None:
            return joints
        turned = joints @ self._turn[frames].mT
        return turned + self._place[frames, None] if self.in_camera else turned

    def rows_in_still_space(self, rows: Float[Tensor, "B 165 d"], frames: Int[Tensor, "B"]) -> Float[Tensor, "B 165 d"]:
        """The Jacobian in still space, from the one in camera space."""
        if self.path is None:
            return rows
        return (self._turn[frames, None] @ rows.unflatten(1, (N_JOINTS, 3))).flatten(1, 2)


@lru_cache(maxsize=4)
def _joints(body: BodyModel, dtype: torch.dtype, device: torch.device) -> BodyPoints:
    """The joints as points. Cached beyond a fit, as each drag of a keypoint would wait for them."""
    return BodyPoints(body, [Joint(j) for j in range(N_JOINTS)], dtype=dtype, device=device)


@dataclass(frozen=True, eq=False)
class Smoothness(Term):
    """E_T: weight x distance of each joint from the mean of its places in the frame before, this one and the next.

    The one term that couples frames: `solvers.sequence` has its derivatives.
    """

    weight: float
    joints: JointPositions
    name: str = "temporal"

    def residual(self, e: Estimate) -> Float[Tensor, "c 165"]:
        """Of consecutive frames, for each that has one before and one after it."""
        return self.weight * off_mean(self.joints.of(self.joints.estimate(e.state, e.frames)).flatten(1))


def _make(context: TermContext, looked: UsedKeypoints, s: int) -> Term | None:
    if not context.temporal_weight:
        return None
    in_camera = context.config.temporal.space == "camera"
    joints = JointPositions(context.body, context.parametrisation, in_camera=in_camera, path=context.camera.path)
    return Smoothness(context.temporal_weight, joints)


ENTRY = Entry(
    name="temporal",
    kind=Smoothness,
    about="phase 3: joints move evenly; the residual is `(2 J[i] - J[i-1] - J[i+1]) / 3` for the joints J of frame i, "
    "in metres; its weight is `temporal.weight`",
    make=_make,
)
