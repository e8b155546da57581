"""The variational autoencoder of body poses."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fitting_core.priors.files.network import Activation

LATENT = 32
MODULES: dict[Activation, Callable[[], nn.Module]] = {
    "leaky_relu_0.2": lambda: nn.LeakyReLU(0.2),
    "elu": nn.ELU,
    "silu": nn.SiLU,
    "softplus": nn.Softplus,
    "tanh": nn.Tanh,
}


@dataclass(frozen=True, kw_only=True)
class NetworkSize:
    """Widths and kind of the network."""

    encoder: int = 256
    decoder: int = 256
    layers: int = 2
    """Hidden layers of each half."""
    activation: Activation = "silu"


class PoseAutoencoder(nn.Module):
    """21 rotations -> mean and log variance of 32 numbers -> 21 rotations, as VPoser's interface has it."""

    def __init__(self, size: NetworkSize) -> None:
        super().__init__()
        self.size = size
        self.encoder = _layers([126] + [size.encoder] * size.layers + [2 * LATENT], size.activation)
        self.decoder = _layers([LATENT] + [size.decoder] * size.layers + [126], size.activation)
        with torch.no_grad():  # the unturned joint, so that training starts at a body
            self.decoder[-1].bias.copy_(torch.eye(3)[:, :2].repeat(21, 1, 1).flatten())  # pyright: ignore

    def encode(self, rotations: Float[Tensor, "B 21 3 3"]) -> tuple[Float[Tensor, "B 32"], Float[Tensor, "B 32"]]:
        """Mean and log variance."""
        mean, log_variance = self.encoder(rotations[..., :2].flatten(1)).chunk(2, 1)
        return mean, log_variance.clamp(-12, 4)

    def decode(self, z: Float[Tensor, "B 32"]) -> Float[Tensor, "B 21 3 3"]:
        """Rotation matrices."""
        return from_columns(self.decoder(z).view(-1, 21, 3, 2))


def _layers(widths: list[int], activation: Activation) -> nn.Sequential:
    parts: list[nn.Module] = []
    for a, b in pairwise(widths):
        parts += [nn.Linear(a, b), MODULES[activation]()]
    return nn.Sequential(*parts[:-1])


def from_columns(columns: Float[Tensor, "*b 3 2"]) -> Float[Tensor, "*b 3 3"]:
    """Two columns made orthonormal, and their cross product (Zhou et al., On the Continuity of Rotation
    Representations in Neural Networks, 2019)."""
    x = nn.functional.normalize(columns[..., 0], dim=-1)
    y = columns[..., 1]
    y = nn.functional.normalize(y - (x * y).sum(-1, keepdim=True) * x, dim=-1)
    return torch.stack([x, y, torch.linalg.cross(x, y)], -1)
