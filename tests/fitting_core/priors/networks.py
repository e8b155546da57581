"""Random networks in the form of pose priors."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from fitting_core.priors.files.network import Activation, Layer, PriorNetwork
from fitting_core.priors.latent import LatentPrior

IDENTITY = np.tile(np.eye(3)[:, :2].reshape(-1), 21)
"""What a decoder puts out for 21 joints at rest."""


def random_layer(
    rng: np.random.Generator, inputs: int, outputs: int, activation: Activation = "linear", scale: float = 1.4
) -> Layer:
    weight = rng.normal(0, scale / np.sqrt(inputs), (outputs, inputs))
    return Layer(weight, rng.normal(0, 0.1, outputs), activation)


def random_network(
    activation: Activation = "silu", *, size: int = 32, hidden: int = 96, spread: float = 0.3, seed: int = 0
) -> PriorNetwork:
    """Poses around rest, by angles of about `spread`; the encoder knows nothing about the decoder."""
    rng = np.random.default_rng(seed)
    last = random_layer(rng, hidden, 126, scale=spread)
    return PriorNetwork(
        decoder=(
            random_layer(rng, size, hidden, activation),
            random_layer(rng, hidden, hidden, activation),
            Layer(last.weight, last.bias + IDENTITY),
        ),
        encoder=(random_layer(rng, 63, hidden, activation), random_layer(rng, hidden, size)),
        title="random",
        licence="none",
    )


def with_fitted_encoder(network: PriorNetwork, samples: int = 2000) -> PriorNetwork:
    """The network with the linear map that tells latents best from axis-angle, in the place of a trained encoder."""
    z = random_latents(samples, network.size, seed=99)
    pose = LatentPrior(network).decode(z)
    fitted = torch.linalg.lstsq(torch.cat([pose, torch.ones(samples, 1, dtype=z.dtype)], 1), z).solution.T
    return replace(network, encoder=(Layer(fitted[:, :-1].contiguous().numpy(), fitted[:, -1].numpy()),))


def random_latents(frames: int, size: int = 32, seed: int = 0) -> Tensor:
    return torch.randn(frames, size, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def modules_of(layers: tuple[Layer, ...]) -> torch.nn.Sequential:
    """The same layers in torch's own modules."""
    kinds = {
        "linear": torch.nn.Identity, "leaky_relu_0.01": torch.nn.LeakyReLU, "elu": torch.nn.ELU, "silu": torch.nn.SiLU,
        "leaky_relu_0.2": lambda: torch.nn.LeakyReLU(0.2), "softplus": torch.nn.Softplus, "tanh": torch.nn.Tanh,
    }  # fmt: skip
    modules = []
    for layer in layers:
        linear = torch.nn.Linear(*layer.weight.shape[::-1], dtype=torch.float64)
        linear.weight.data, linear.bias.data = torch.tensor(layer.weight).double(), torch.tensor(layer.bias).double()
        modules += [linear, kinds[layer.activation]()]
    return torch.nn.Sequential(*modules).requires_grad_(False)


def rotations_by_hand(numbers: Tensor) -> Tensor:
    """(B, 126) -> (B, 21, 3, 3): 3 x 2 row by row, the columns made orthonormal one after the other."""
    rows = numbers.reshape(-1, 21, 3, 2)
    first = rows[..., 0] / rows[..., 0].norm(dim=-1, keepdim=True)
    second = torch.linalg.cross(torch.linalg.cross(first, rows[..., 1]), first)
    second = second / second.norm(dim=-1, keepdim=True)
    return torch.stack([first, second, torch.linalg.cross(first, second)], -1)
