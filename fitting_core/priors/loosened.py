"""A pose prior whose joints may turn a little beyond what it decodes: nothing is out of a fit's reach then."""

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core import rotations
from fitting_core.priors.pose import PosePrior

N_JOINTS = 21


class Loosened:
    """A prior's numbers, then 63 more: by how many times `spread` each joint turns further, about its own axes.

    A latent space of 32 numbers holds no pose exactly. What it leaves is an error of the prior as the keypoints have
    theirs, so that it has a variance too: the penalty is |z|^2 + |d|^2 with R = R(z) exp(spread d).

    Args:
        prior: what is loosened.
        spread: standard deviation of what it leaves, radians about each axis.
    """

    def __init__(self, prior: PosePrior, spread: float) -> None:
        self.prior, self.spread = prior, spread
        self.title, self.size = prior.title, prior.size + 3 * N_JOINTS
        self.neutral = torch.cat([prior.neutral, prior.neutral.new_zeros(3 * N_JOINTS)])

    def to(self, *, dtype: torch.dtype, device: torch.device | str) -> "Loosened":
        """The same prior in another type or on another device."""
        return Loosened(self.prior.to(dtype=dtype, device=device), self.spread)

    def _parts(self, z: Tensor) -> tuple[Float[Tensor, "B 21 3"], Float[Tensor, "B 21 3"]]:
        """Axis-angle of what the prior decodes, and of what is added."""
        held, further = z[:, : self.prior.size], z[:, self.prior.size :]
        return _by_joint(self.prior.decode(held)), self.spread * _by_joint(further)

    def decode(self, z: Float[Tensor, "B size"]) -> Float[Tensor, "B 63"]:
        """Axis-angle of the 21 body joints, each of a length of pi at most."""
        base, further = self._parts(z)
        return rotations.log(rotations.exp(base) @ rotations.exp(further)).flatten(1)

    def encode(self, body_pose: Float[Tensor, "B 63"]) -> Float[Tensor, "B size"]:
        """What the prior encodes, and all that this leaves: it decodes to the very pose."""
        z = self.prior.encode(body_pose)
        base = rotations.exp(_by_joint(self.prior.decode(z)))
        rest = rotations.log(base.mT @ rotations.exp(_by_joint(body_pose)))
        return torch.cat([z, rest.flatten(1) / self.spread], 1)

    @torch.no_grad()
    def jacobian(self, z: Float[Tensor, "B size"]) -> Float[Tensor, "B 63 size"]:
        """d decode / dz, in closed form.

        exp(a) turns by L(a)^T da about its own axes when a grows by da, and what follows it turns these axes.
        """
        base, further = self._parts(z)
        (first, by_base), (second, by_further) = map(rotations.exp_and_left_jacobian, (base, further))
        outward = rotations.inverse_left_jacobian(rotations.log(first @ second)).mT
        blocks = self.spread * (outward @ by_further.mT)
        added = blocks.new_zeros(len(z), N_JOINTS, 3, N_JOINTS, 3)
        joint = torch.arange(N_JOINTS)
        added[:, joint, :, joint] = blocks.transpose(0, 1)
        turned = outward @ second.mT @ by_base.mT
        decoder = self.prior.jacobian(z[:, : self.prior.size])
        assert decoder is not None, "what decodes every pose needs no loosening"
        held = (turned @ decoder.unflatten(1, (N_JOINTS, 3))).flatten(1, 2)
        return torch.cat([held, added.flatten(3).flatten(1, 2)], 2)


def _by_joint(pose: Float[Tensor, "B 63"]) -> Float[Tensor, "B 21 3"]:
    return pose.unflatten(1, (N_JOINTS, 3))
