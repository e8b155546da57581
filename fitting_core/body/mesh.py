"""The whole mesh: every vertex of a posed body.

Most skinning weights are zero, and 98 % of the free body's correctives: sparse tables make a frame of it take
2.7 ms in float32 (1.0 in batches) where dense ones take 11 (2.4), on one thread.
"""

import warnings
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from jaxtyping import Float
from scipy.sparse import csr_array
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.model import N_JOINTS, BodyModel, sparse_if_mostly_zero
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
        self._blend = _tensor(sparse_if_mostly_zero(body.skinning_weights), dtype, self.device)

    @cached_property
    def _correct(self) -> Tensor:
        """(V*3, 486), the pose correctives. Made when asked for: joints alone need none."""
        return _corrective_table(self.body, self.dtype, self.device)

    def __call__(self, params: BodyParams, *, chunk: int = 16) -> Float[Tensor, "T V 3"]:
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

    def vertices(self, local: Float[Tensor, "B 55 3 3"], coefficients: Float[Tensor, "B 20"]) -> Float[Tensor, "B V 3"]:
        """All vertices without camera translation, metres; arguments as for `skeleton`."""
        posed = self.skeleton(local, coefficients)
        features = (local[:, 1:] - torch.eye(3, dtype=self.dtype, device=self.device)).flatten(1)
        moved = coefficients @ self.directions.flatten(0, 1).T + (self._correct @ features.T).T
        rest = self.template + moved.view(len(local), -1, 3)
        transforms = torch.cat([posed.world, posed.offset[..., None]], -1).flatten(2)
        # Frame by frame, for those of many frames leave the cache: 32 in one product take ten times as long.
        blended = torch.stack([self._blend @ bones for bones in transforms]).view(len(local), -1, 3, 4)
        return (blended[..., :3] @ rest[..., None])[..., 0] + blended[..., 3]


def _tensor(
    values: csr_array | Float[np.ndarray, "m n"], dtype: torch.dtype, device: torch.device
) -> Float[Tensor, "m n"]:
    if not isinstance(values, csr_array):
        return torch.as_tensor(values, dtype=dtype, device=device)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")
        starts, columns, numbers = (torch.as_tensor(a) for a in (values.indptr, values.indices, values.data))
        return torch.sparse_csr_tensor(
            starts, columns, numbers, values.shape, dtype=dtype, device=device, check_invariants=True
        )


@lru_cache(maxsize=2)
def _corrective_table(body: BodyModel, dtype: torch.dtype, device: torch.device) -> Float[Tensor, "V*3 486"]:
    return _tensor(body.pose_directions, dtype, device)


def _coefficients(params: BodyParams) -> Float[Tensor, "T 20"]:
    return torch.cat([params.betas, params.expression], 1)


@lru_cache(maxsize=2)
def shared_mesh(body: BodyModel) -> Mesh:
    """A body's mesh in float32, of the two that were asked for last: its tables take a tenth of a second."""
    return Mesh(body)
