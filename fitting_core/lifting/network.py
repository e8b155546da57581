"""The network: a transformer over the frames of a window; and its file, an npz of arrays by name and `about`, JSON."""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz
from fitting_core.lifting.rays import N_FEATURES, POINTS
from fitting_core.shipped import LIFTER

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


# --- its file ---

FORMAT = "tcfit lifter 1"


class AboutLifter(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Metadata of the file."""

    format: str
    width: int
    layers: int
    heads: int
    frames: int
    """Of a window, as the network expects."""
    rate: float
    """Frames per second of a window."""
    error_factor: float
    """Factor for the network's expected errors, from motion that it was not trained on."""
    notes: str = ""
    """How it was made, for people."""

    @property
    def possible(self) -> bool:
        """Whether such a network is possible."""
        return self.width % max(self.heads, 1) == 0 and math.isfinite(self.error_factor) and self.error_factor > 0


@lru_cache(maxsize=2)
def read_lifter(path: Path = LIFTER) -> tuple[Lifter, float]:
    """A lifter's network, as `build_assets.lifter` writes it, and its error factor. Raises InputError if it is missing,
    damaged, or has the wrong form."""
    try:
        arrays = read_npz(path, most=2**26)
        about = msgspec.json.decode(str(arrays.pop("about")), type=AboutLifter)
    except (OSError, ValueError, KeyError, msgspec.DecodeError) as error:
        raise InputError(f"{path}: is not a lifter ({error}). Reinstall tcfit, or name another file.") from error
    if (about.format, about.frames, about.rate) != (FORMAT, FRAMES, RATE):
        found = f"{about.format!r} for {about.frames} frames at {about.rate:g} per second"
        raise InputError(f"{path}: is {found}, expected {FORMAT!r} for {FRAMES} at {RATE:g}. Reinstall tcfit.")
    if not about.possible:
        raise InputError(f"{path}: its description is impossible ({about}). Reinstall tcfit.")
    network = Lifter(LifterSize(width=about.width, layers=about.layers, heads=about.heads))
    wanted = {name: values.shape for name, values in network.state_dict().items()}
    if {name: values.shape for name, values in arrays.items()} != wanted:
        raise InputError(f"{path}: its arrays are not those of its network. Reinstall tcfit.")
    if not all(np.isfinite(values).all() for values in arrays.values()):
        raise InputError(f"{path}: holds values that are not finite. Reinstall tcfit.")
    network.load_state_dict({name: torch.as_tensor(values.astype(np.float32)) for name, values in arrays.items()})
    network.eval().requires_grad_(False)
    return network, about.error_factor
