"""The network: a transformer over the frames of a window."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fitting_core.lifting.rays import N_FEATURES, POINTS

FRAMES = 32
"""Of a window."""
RATE = 20.0
"""Frames per second of a window, which lasts 1.6 s."""


@dataclass(frozen=True, kw_only=True)
class LifterSize:
    """Sizes of the network."""

    width: int = 192
    layers: int = 4
    heads: int = 6


class Lifted(NamedTuple):
    """The network's output for windows, in the axes of the virtual camera (see `rays.Seen`)."""

    points: Float[Tensor, "B T 25 3"]
    """BODY_25 relative to the pelvis joint, metres."""
    log_error: Float[Tensor, "B T 25"]
    """Logarithm of the expected distance along z between `points` and the truth, metres."""
    up: Float[Tensor, "B T 3"]
    """Against gravity; its length is 1 if the network is sure, and less otherwise."""
    contact: Float[Tensor, "B T 2"]
    """Logits: whether the left and the right foot stand still on the ground."""


class Lifter(nn.Module):
    """From windows as `rays.seen` gives them to points in space."""

    def __init__(self, size: LifterSize = LifterSize()) -> None:
        super().__init__()
        self.size = size
        width = size.width
        self.first = nn.Linear(N_FEATURES, width)
        self.second = nn.Linear(width, width)
        self.place = nn.Parameter(0.02 * torch.randn(FRAMES, width))
        self.blocks = nn.ModuleList([_Block(width, size.heads) for _ in range(size.layers)])
        self.last = nn.LayerNorm(width)
        self.points = nn.Linear(width, 3 * POINTS)
        self.error = nn.Linear(width, POINTS)
        self.others = nn.Linear(width, 5)
        nn.init.zeros_(self.error.weight)
        nn.init.constant_(self.error.bias, -2.5)

    def forward(self, features: Float[Tensor, "B T F"]) -> Lifted:
        """See `Lifted`; the expected error is learned from the points, without a gradient to them."""
        x = self.second(nn.functional.gelu(self.first(features))) + self.place
        for block in self.blocks:
            x = block(x)
        x = self.last(x)
        points = self.points(x).float().unflatten(-1, (POINTS, 3))
        others = self.others(x).float()
        return Lifted(points, self.error(x.detach()).float(), others[..., :3], others[..., 3:])


class _Block(nn.Module):
    """Attention among all frames of the window, then a perceptron per frame."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.before_attention, self.before_perceptron = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attention, self.joined = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.widened, self.narrowed = nn.Linear(width, 2 * width), nn.Linear(2 * width, width)

    def forward(self, x: Float[Tensor, "B T width"]) -> Float[Tensor, "B T width"]:
        query, key, value = self.attention(self.before_attention(x)).unflatten(-1, (3, self.heads, -1)).unbind(2)
        parts = (part.transpose(1, 2) for part in (query, key, value))
        mixed = nn.functional.scaled_dot_product_attention(*parts).transpose(1, 2).flatten(2)
        x = x + self.joined(mixed)
        return x + self.narrowed(nn.functional.gelu(self.widened(self.before_perceptron(x))))
