"""How near a camera stood, inferred from how people look and move: a network over windows of keypoints."""

from dataclasses import asdict
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from fitting_core.lifting.network import FRAMES, RATE, Lifter, LifterSize
from fitting_core.lifting.network_file import NetworkAbout, fill, read_network, write_network
from fitting_core.lifting.rays import POINTS, seen
from fitting_core.shipped import PERSPECTIVE

FORMAT = "tcfit perspective 1"
LOG_EXTENTS = torch.linspace(np.log(0.012), np.log(0.6), 40)
"""Natural logarithms of the classes of the network: a trunk's extent over its distance, for people 20 m to 0.5 m away.
The extent is that of `rays`: the root mean square distance of the trunk's keypoints from their centre."""
_EXTENT, _CALIBRATED = 3 * POINTS, 3 * POINTS + 4
"""Columns of the features of `rays.seen`."""
_USUAL = -2.5
"""Replaces the extent, which would give away the answer."""
_HIDDEN = 96
_OF_LIFTER = ("trunk.points", "trunk.error", "trunk.others")
"""Parts of the lifter that are not used here."""


class AboutPerspective(NetworkAbout, kw_only=True):
    """Metadata of the file."""

    seen_share: list[float]
    """How often each of LOG_EXTENTS was seen in training: the network's implicit prior."""

    @property
    def possible(self) -> bool:
        """Whether such a network is possible."""
        right = len(self.seen_share) == len(LOG_EXTENTS) and all(share >= 0 for share in self.seen_share)
        return super().possible and right


class PerspectiveNet(nn.Module):
    """From windows as `hidden_extent` gives them to logits of LOG_EXTENTS; grown from a lifter.

    Near things look larger and move faster than far ones, the more so the nearer the camera stands: arms and legs that
    reach towards it, steps on the floor, a turning trunk.
    """

    def __init__(self, size: LifterSize) -> None:
        super().__init__()
        self.trunk = Lifter(size)
        self.attention = nn.Linear(size.width, 1)
        self.head = nn.Sequential(nn.Linear(2 * size.width, _HIDDEN), nn.GELU(), nn.Linear(_HIDDEN, len(LOG_EXTENTS)))

    def forward(self, features: Float[Tensor, "B T F"]) -> Float[Tensor, "B 40"]:
        """Logits."""
        x = self.trunk.understood(features)
        share = torch.softmax(self.attention(x), 1)
        return self.head(torch.cat([(share * x).sum(1), x.mean(1)], 1))


def hidden_extent(
    rays: Float[Tensor, "B T 25 2"], confidence: Float[Tensor, "B T 25"]
) -> tuple[Float[Tensor, "B T F"], Float[Tensor, "B"]]:
    """Windows of rays, for a focal length that may be wrong, without the extent; and its logarithm."""
    features = seen(rays, confidence, torch.zeros(len(rays))).features.clone()
    extent = features[:, 0, _EXTENT].clone()
    features[:, :, _EXTENT], features[:, :, _CALIBRATED] = _USUAL, 0.0
    return features, extent


def write_perspective(path: Path, network: PerspectiveNet, *, seen_share: Float[Tensor, "40"], notes: str) -> None:
    """Write a network atomically, at half the precision of its training."""
    shares = [round(float(share), 5) for share in seen_share]
    of_windows = {"frames": FRAMES, "rate": RATE, **asdict(network.trunk.size)}
    about = AboutPerspective(format=FORMAT, seen_share=shares, notes=notes, **of_windows)
    arrays = {name: values for name, values in network.state_dict().items() if not name.startswith(_OF_LIFTER)}
    write_network(path, arrays, about)


@lru_cache(maxsize=2)
def read_perspective(path: Path = PERSPECTIVE) -> tuple[PerspectiveNet, Float[np.ndarray, "40"]]:
    """The network that `write_perspective` wrote, and how often it saw each extent. Raises InputError if it is missing,
    damaged, or has the wrong form."""
    about, arrays = read_network(path, AboutPerspective, FORMAT, "perspective network")
    network = PerspectiveNet(about.size)
    fill(network, arrays, path, without=_OF_LIFTER)
    return network, np.array(about.seen_share)
