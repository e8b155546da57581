"""The training loop: from a lifter on, seeded."""

import math
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from build_assets.lifter.filming import Shots, Studio
from fitting_core.lifting.network import Lifter
from fitting_core.lifting.perspective import LOG_EXTENTS, PerspectiveNet, hidden_extent

SHOTS = Shots(
    speakers=0.03,
    near_speakers=(0.8, 6.4),
    near_others=(1.3, 15.6),
    aside=0.1,
    narrow_beyond=4.0,
    cut=0.15,
    guessed=0.0,
)
"""People seen whole, before lenses of all lengths."""
_WIDTH = 0.08
"""Standard deviation of the right answer, which lies between two of LOG_EXTENTS, in the logarithm."""
_ASSUMED = 0.4
"""Standard deviation of the logarithm of the factor between the assumed focal length and the right one."""
_RATES = {"trunk": 3e-4, "head": 1.5e-3}
_WARM_UP = 100
_LARGEST_GRADIENT = 2.0
_AVERAGED = 0.998
"""Of the running mean of the weights, which is what is used in the end."""


class Shown(NamedTuple):
    """Windows as the network takes them, and the truth."""

    features: Float[Tensor, "B T F"]
    log_extent: Float[Tensor, "B"]


@dataclass(frozen=True)
class Progress:
    """Since the last report."""

    step: int
    loss: float
    """Nats."""


def shown(studio: Studio, count: int) -> Shown:
    """Films with an assumed focal length, which is wrong."""
    film = studio.film(count)
    factor = torch.exp(_ASSUMED * torch.as_tensor(studio.rng.standard_normal(count), dtype=torch.float32))
    factor = factor.clamp(0.4, 2.5)
    features, log_extent = hidden_extent(film.rays * factor[:, None, None, None], film.confidence)
    return Shown(features[film.usable], (log_extent - factor.log())[film.usable])


def targets(log_extent: Float[Tensor, "B"]) -> Float[Tensor, "B 40"]:
    """Shares of LOG_EXTENTS that stand for the truth."""
    return torch.softmax(-0.5 * ((log_extent[:, None] - LOG_EXTENTS) / _WIDTH) ** 2, 1)


class Training:
    """A network in training.

    Args:
        studio: with SHOTS.
        lifter: what the network grows from.
        steps: how long it is trained; the learning rate falls to zero by then.
        batch: windows in a step.
        seed: of the weights that the lifter has not.
    """

    def __init__(self, studio: Studio, lifter: Lifter, *, steps: int, batch: int = 48, seed: int = 0) -> None:
        torch.manual_seed(seed)
        self.studio, self.steps, self.batch = studio, steps, batch
        self.network = PerspectiveNet(lifter.size)
        self.network.trunk.load_state_dict(lifter.state_dict())
        self.average = deepcopy(self.network)
        trunk = list(self.network.trunk.parameters())
        head = [*self.network.attention.parameters(), *self.network.head.parameters()]
        self.optimizer = torch.optim.AdamW([{"params": trunk}, {"params": head}], weight_decay=0.01)
        self.step = 0
        self._seen = torch.zeros(len(LOG_EXTENTS))

    @property
    def seen_share(self) -> Float[Tensor, "40"]:
        """How often each of LOG_EXTENTS was seen, smoothed over neighbours."""
        padded = torch.nn.functional.pad(self._seen[None, None], (2, 2), mode="replicate")
        smooth = torch.nn.functional.avg_pool1d(padded, 5, stride=1)[0, 0]
        return smooth / smooth.sum()

    def run(self, report_every: int = 250) -> Iterator[Progress]:
        """Train to the end, with a report now and then and at the end."""
        losses: list[float] = []
        while self.step < self.steps:
            losses.append(self._one_step())
            if self.step % report_every == 0 or self.step == self.steps:
                yield Progress(self.step, float(np.mean(losses)))
                losses.clear()

    def _one_step(self) -> float:
        done = self.step / self.steps
        share = min(1.0, (self.step + 1) / _WARM_UP) * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * done)))
        for group, rate in zip(self.optimizer.param_groups, _RATES.values(), strict=True):
            group["lr"] = share * rate
        given = shown(self.studio, self.batch)
        wanted = targets(given.log_extent)
        self._seen += wanted.sum(0)
        loss = -(wanted * torch.log_softmax(self.network(given.features), 1)).sum(1).mean()
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), _LARGEST_GRADIENT)
        self.optimizer.step()
        self.step += 1
        keep = min(_AVERAGED, self.step / (self.step + 10))
        with torch.no_grad():
            for mean, now in zip(self.average.parameters(), self.network.parameters(), strict=True):
                mean.lerp_(now, 1 - keep)
        return float(loss.detach())


@torch.no_grad()
def mean_error(network: PerspectiveNet, films: list[Shown]) -> float:
    """Of the logarithm of the extent, and so of a focal length found from a single window."""
    errors = [(torch.softmax(network(film.features), 1) @ LOG_EXTENTS - film.log_extent).abs() for film in films]
    return float(torch.cat(errors).mean())
