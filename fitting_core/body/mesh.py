"""The whole mesh: every vertex of a posed body."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.body.params import BodyParams, full_pose


@dataclass(frozen=True)
class Skeleton:
    """The posed joints of B frames."""

    local: Float[Tensor, "B 55 3 3"]
    world: Float[Tensor, "B 55 3 3"]
    joints: Float[Tensor, "B 55 3"]
    offset: Float[Tensor, "B 55 3"]
    """A point x of the rest pose that joint k carries alone goes to world_k x + offset_k."""


class Mesh:
    """Evaluates all vertices of one body by linear blend skinning with shape, expression and pose correctives."""

    def __init__(
        self, body: BodyModel, *, dtype: torch.dtype = torch.float32, device: torch.device | str = "cpu"
    ) -> None:
        def tensor(a) -> Tensor:
            return torch.as_tensor(a, dtype=dtype, device=device)

        self.body, self.dtype, self.device = body, dtype, torch.device(device)
        self.tree = Tree.of(body.parents, device)
        self.template = tensor(body.template)
        self.directions = torch.cat([tensor(body.shape_directions), tensor(body.expression_directions)], 2)
        regressor = tensor(body.joint_regressor)
        self.rest = regressor @ self.template
        self.rest_directions = (regressor @ self.directions.flatten(1)).view(N_JOINTS, 3, -1)
        self.weights = tensor(body.skinning_weights)

    @cached_property
    def _used(self) -> Bool[np.ndarray, "54"]:
        return abs(self.body.pose_directions.reshape(-1, N_JOINTS - 1, 9)).max((0, 2)) > 0

    @cached_property
    def driving(self) -> Int[Tensor, "n"]:
        """The joints that drive a corrective: a body's file may have few."""
        return torch.as_tensor(self._used.nonzero()[0] + 1, device=self.device)

    @cached_property
    def correctives(self) -> Float[Tensor, "V*3 n*9"]:
        """The pose correctives of these joints. Made when asked for: 79 MB and half a second for the free body."""
        every = self.body.pose_directions.reshape(-1, N_JOINTS - 1, 9)
        return torch.as_tensor(every[:, self._used].reshape(len(every), -1), dtype=self.dtype, device=self.device)

    def __call__(self, params: BodyParams, *, chunk: int = 32) -> Float[Tensor, "T V 3"]:
        """Vertices in camera space (metres), translation included."""
        params = params.to(dtype=self.dtype, device=self.device)
        frames = torch.arange(len(params)).split(chunk)
        return torch.cat([self._evaluate(params[i]) for i in frames]) if len(params) else self.template[None][:0]

    def joints(self, params: BodyParams) -> Float[Tensor, "T 55 3"]:
        """The kinematic joints in camera space (metres), translation included."""
        params = params.to(dtype=self.dtype, device=self.device)
        local = rotations.exp(full_pose(self.body, params))
        return self.skeleton(local, _coefficients(params)).joints + params.camera_translation[:, None]

    def _evaluate(self, params: BodyParams) -> Tensor:
        local = rotations.exp(full_pose(self.body, params))
        return self.vertices(local, _coefficients(params)) + params.camera_translation[:, None]

    def skeleton(self, local: Float[Tensor, "B 55 3 3"], coefficients: Float[Tensor, "B 20"]) -> Skeleton:
        """Poses the joints.

        Args:
            local: rotation of every joint against its parent; of the root, in the world.
            coefficients: betas, then expression.
        """
        rest = self.rest + (coefficients @ self.rest_directions.flatten(0, 1).T).view(-1, N_JOINTS, 3)
        world, joints = pose_joints(self.tree, local, rest)
        return Skeleton(local, world, joints, joints - (world @ rest[..., None])[..., 0])

    def features(self, local: Float[Tensor, "B 55 3 3"]) -> Float[Tensor, "B F"]:
        """What the pose correctives are linear in: the driving joints' rotations minus the identity."""
        return (local[:, self.driving] - torch.eye(3, dtype=self.dtype, device=self.device)).flatten(1)

    def vertices(self, local: Float[Tensor, "B 55 3 3"], coefficients: Float[Tensor, "B 20"]) -> Float[Tensor, "B V 3"]:
        """All vertices without camera translation, metres; arguments as for `skeleton`."""
        posed = self.skeleton(local, coefficients)
        moved = coefficients @ self.directions.flatten(0, 1).T + self.features(local) @ self.correctives.T
        rest = self.template + moved.view(len(local), -1, 3)
        transforms = torch.cat([posed.world, posed.offset[..., None]], -1)
        blended = (self.weights @ transforms.flatten(2)).view(len(local), -1, 3, 4)
        return (blended[..., :3] @ rest[..., None])[..., 0] + blended[..., 3]


def _coefficients(params: BodyParams) -> Float[Tensor, "T 20"]:
    return torch.cat([params.betas, params.expression], 1)


@lru_cache(maxsize=2)
def shared_mesh(body: BodyModel) -> Mesh:
    """A body's mesh in float32, of the two that were asked for last: its table of correctives takes half a second."""
    return Mesh(body)
