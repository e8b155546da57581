"""Parameters of a posed body over some frames, as users and files know them."""

from dataclasses import dataclass, fields

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.model import N_BETAS, N_EXPRESSION, N_HAND_COMPONENTS, BodyModel


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyParams:
    """SMPL-X parameters of T frames. Angles are axis-angle in radians, lengths metres, frame: camera space."""

    betas: Float[Tensor, "T 10"]
    global_orient: Float[Tensor, "T 3"]
    """Body to camera (x right, y down, z away)."""
    body_pose: Float[Tensor, "T 63"]
    left_hand_pose: Float[Tensor, "T K"]
    """K < 45: principal components over the hand mean; K = 45: axis-angle over the hand mean."""
    right_hand_pose: Float[Tensor, "T K"]
    jaw_pose: Float[Tensor, "T 3"]
    leye_pose: Float[Tensor, "T 3"]
    reye_pose: Float[Tensor, "T 3"]
    expression: Float[Tensor, "T 10"]
    camera_translation: Float[Tensor, "T 3"]
    """Added to every posed point: from the body's own origin into camera space."""

    def __len__(self) -> int:
        return len(self.betas)

    def __getitem__(self, frames: slice | Tensor | list[int]) -> "BodyParams":
        return BodyParams(**{f.name: getattr(self, f.name)[frames] for f in fields(self)})

    def to(self, *, dtype: torch.dtype | None = None, device: torch.device | str | None = None) -> "BodyParams":
        """The same parameters in another type or on another device."""
        return BodyParams(**{f.name: getattr(self, f.name).to(dtype=dtype, device=device) for f in fields(self)})

    def with_frames(self, frames: range, window: "BodyParams") -> "BodyParams":
        """All frames, some of them replaced, in the type and on the device of these."""
        merged = {f.name: getattr(self, f.name).clone() for f in fields(self)}
        for name, values in vars(window).items():
            merged[name][frames.start : frames.stop] = values.to(merged[name])
        return BodyParams(**merged)

    @staticmethod
    def neutral(frames: int, *, hand_components: int = N_HAND_COMPONENTS) -> "BodyParams":
        """Mean shape in the rest pose at the origin, facing along +z with y up (upside down in a camera's eyes)."""
        widths = {"betas": N_BETAS, "body_pose": 63, "expression": N_EXPRESSION}
        widths |= dict.fromkeys(("left_hand_pose", "right_hand_pose"), hand_components)
        zeros = {f.name: torch.zeros(frames, widths.get(f.name, 3), dtype=torch.float64) for f in fields(BodyParams)}
        return BodyParams(**zeros)


def hand_basis(body: BodyModel, components: int, like: Tensor) -> tuple[Float[Tensor, "2 45 K"], Float[Tensor, "2 45"]]:
    """Linear map from hand parameters to the 15 finger joints' axis-angle, and the mean pose; left, right."""
    if components == 45:
        basis = torch.eye(45, dtype=like.dtype, device=like.device).expand(2, 45, 45)
    else:
        basis = torch.as_tensor(body.hand_components[:, :components]).to(like).transpose(1, 2)
    return basis, torch.as_tensor(body.hand_mean).to(like)


def full_pose(body: BodyModel, params: BodyParams) -> Float[Tensor, "T 55 3"]:
    """Axis-angle of all 55 joints in SMPL-X's order, hands decoded."""
    basis, mean = hand_basis(body, params.left_hand_pose.shape[1], params.body_pose)
    left = mean[0] + params.left_hand_pose @ basis[0].T
    right = mean[1] + params.right_hand_pose @ basis[1].T
    pose = [params.global_orient, params.body_pose, params.jaw_pose, params.leye_pose, params.reye_pose, left, right]
    return torch.cat(pose, 1).view(len(params), -1, 3)
