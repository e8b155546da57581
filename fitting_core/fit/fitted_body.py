"""The body as one fit sees it: its numbers, its points, and the whole mesh, each made once and used in every frame."""

from functools import cached_property, lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.kinematics import contour_bins
from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.body.points.pairs import Point, keypoint_points
from fitting_core.body.points.points import BodyPoints
from fitting_core.config.schema import FitConfig
from fitting_core.fit.terms.collision.term import CollidingBody
from fitting_core.fit.variables.state import Parametrisation, State
from fitting_core.priors.pose import make_prior


class FittedBody:
    """A body model, how a solver's numbers become its pose, and what of it can be looked at.

    Args:
        model: the body model.
        config: its pose prior, hands, precision and device count.
    """

    def __init__(self, model: BodyModel, config: FitConfig) -> None:
        self.model = model
        self.dtype, self.device = getattr(torch, config.precision), torch.device(config.device)
        self.parametrisation = Parametrisation(
            model,
            make_prior(config.pose_prior, dtype=self.dtype, device=self.device),
            hand_components=config.hand_components,
            dtype=self.dtype,
            device=self.device,
        )
        self.keypoint_points: list[Point | None] = keypoint_points(model)
        self.known = torch.tensor([p is not None for p in self.keypoint_points], device=self.device)
        """Keypoints that the body has, (137,) bool."""

    @cached_property
    def colliding(self) -> CollidingBody:
        """The whole mesh, made when the first stage asks for collisions."""
        return CollidingBody(self.model, dtype=self.dtype, device=self.device)

    @cached_property
    def rest_joints(self) -> Float[Tensor, "55 3"]:
        """Joints of the mean shape at rest, metres."""
        joints = self.model.rest_joints
        return torch.as_tensor(joints, dtype=self.dtype, device=self.device)

    def points(self, indices: Int[Tensor, "N"]) -> BodyPoints:
        """What some keypoints are on the body."""
        return _compiled(self.model, tuple(indices.tolist()), self.dtype, self.device)

    def contour_bins(self, points: BodyPoints, state: State) -> Int[Tensor, "B"]:
        """The face contour's table of each frame, from the head's yaw in `state`."""
        p = self.parametrisation
        return contour_bins(points.world_rotations(state.orient, p.pose(state, p.body_pose(state))))

    def turned_by(self, seen: Bool[Tensor, "T 137"]) -> Bool[np.ndarray, "T 55"]:
        """Joints with one of these keypoints below them in the tree, so that the image says how they are turned."""
        return (seen.cpu().numpy().astype(int) @ _turning(self.model)) > 0


@lru_cache(maxsize=16)
def _compiled(body: BodyModel, indices: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> BodyPoints:
    """The points of some keypoints. Remembered beyond a fit: 0.1 s that each drag of a keypoint would wait."""
    known = keypoint_points(body)
    points = [point for i in indices if (point := known[i]) is not None]
    return BodyPoints(body, points, dtype=dtype, device=device)


@lru_cache(maxsize=4)
def _turning(body: BodyModel) -> Int[np.ndarray, "137 55"]:
    """1 where a joint turns a keypoint. Remembered: to compile all keypoints takes 0.3 s, which a drag would wait."""
    known = {i: p for i, p in enumerate(keypoint_points(body)) if p is not None}
    points = BodyPoints(body, list(known.values()))
    hangs = np.zeros((kp.COUNT, N_JOINTS), int)
    hangs[np.array(list(known))[points.entry_point.numpy()], points.entry_joint.numpy()] = 1
    return hangs
