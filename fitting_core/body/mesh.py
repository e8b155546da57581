"""The whole mesh: every vertex of a posed body."""

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core import rotations
from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.body.params import BodyParams, full_pose


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
        self.regressor = tensor(body.joint_regressor)
        self.weights = tensor(body.skinning_weights)
        correctives = body.pose_directions.reshape(-1, N_JOINTS - 1, 9)
        used = abs(correctives).max((0, 2)) > 0
        # only the joints that drive a corrective: the free body's are 1.7 % non-zero
        self.driving = torch.as_tensor(used.nonzero()[0] + 1, device=device)
        self.correctives = tensor(correctives[:, used].reshape(len(correctives), -1))

    def __call__(self, params: BodyParams, *, chunk: int = 32) -> Float[Tensor, "T V 3"]:
        """Vertices in camera space (metres), translation included."""
        params = params.to(dtype=self.dtype, device=self.device)
        frames = torch.arange(len(params)).split(chunk)
        return torch.cat([self._evaluate(params[i]) for i in frames]) if len(params) else self.template[None][:0]

    def joints(self, params: BodyParams) -> Float[Tensor, "T 55 3"]:
        """The kinematic joints in camera space (metres), translation included."""
        params = params.to(dtype=self.dtype, device=self.device)
        _, _, _, position = self._pose(params)
        return position + params.camera_translation[:, None]

    def _pose(self, params: BodyParams) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        coefficients = torch.cat([params.betas, params.expression], 1)
        shaped = self.template + (coefficients @ self.directions.reshape(-1, 20).T).view(len(params), -1, 3)
        rest = self.regressor @ shaped
        local = rotations.exp(full_pose(self.body, params))
        world, position = pose_joints(self.tree, local, rest)
        features = (local[:, self.driving] - torch.eye(3, dtype=self.dtype, device=self.device)).flatten(1)
        shaped = shaped + (features @ self.correctives.T).view(len(params), -1, 3)
        transforms = torch.cat([world, (position - (world @ rest[..., None])[..., 0])[..., None]], -1)
        return shaped, transforms, rest, position

    def _evaluate(self, params: BodyParams) -> Tensor:
        shaped, transforms, _, _ = self._pose(params)
        blended = (self.weights @ transforms.flatten(2)).view(len(params), -1, 3, 4)
        posed = (blended[..., :3] @ shaped[..., None])[..., 0] + blended[..., 3]
        return posed + params.camera_translation[:, None]
