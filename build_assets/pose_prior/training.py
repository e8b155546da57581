"""The training loop, seeded."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from build_assets.pose_prior.autoencoder import NetworkSize, PoseAutoencoder
from build_assets.pose_prior.loss import Loss, Precision
from fitting_core.body import rotations
from fitting_core.body.model import BodyModel

_WARM_UP = 1000
"""Steps over which the KL term comes in: with its full weight from the start a third of the latent stayed unused."""
_LARGEST_GRADIENT = 1000.0


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """How long and how fast."""

    steps: int = 20_000
    batch: int = 512
    rate: float = 0.02
    """Largest learning rate (of Muon), reached after 5 % of the steps and then lowered to zero along a cosine."""
    seed: int = 0


@dataclass(frozen=True)
class Progress:
    """Means over the steps since the last report, in nats per pose."""

    step: int
    parts: dict[str, float]
    """As `Loss` names them."""


class Training:
    """A network in training on a pool of poses."""

    def __init__(
        self,
        pool: Float[np.ndarray, "N 63"],
        body: BodyModel,
        *,
        size: NetworkSize,
        precision: Precision,
        schedule: Schedule,
        device: str = "cpu",
    ) -> None:
        torch.manual_seed(schedule.seed)
        self.pool = torch.as_tensor(pool, dtype=torch.float32)
        self.loss, self.precision, self.schedule = Loss(body, precision, device), precision, schedule
        self.device = torch.device(device)
        self.network = PoseAutoencoder(size).to(device)
        weights, biases = (
            [p for p in self.network.parameters() if (p.ndim == 2) is square] for square in (True, False)
        )
        # Muon, not Adam alone: held-out poses to 1.2 degrees and 4 mm after 1500 steps, with Adam (at 2e-3,
        # the only rate tried) to 5.1 and 16.
        self.optimizers = [
            torch.optim.Muon(weights, lr=schedule.rate, weight_decay=0.0, adjust_lr_fn="original"),
            torch.optim.Adam(biases, lr=0.1 * schedule.rate),
        ]
        self.rates = [
            torch.optim.lr_scheduler.OneCycleLR(
                o, o.param_groups[0]["lr"], total_steps=schedule.steps, pct_start=0.05, cycle_momentum=False
            )
            for o in self.optimizers
        ]
        self.random = torch.Generator().manual_seed(schedule.seed)
        self.step = 0

    def run(self, report_every: int = 500) -> Iterator[Progress]:
        """Train to the end of the schedule, with a report now and then."""
        sums: Counter[str] = Counter()
        while self.step < self.schedule.steps:
            parts = self._one_step()
            sums.update({name: float(part.detach()) for name, part in parts.items()})
            if self.step % report_every == 0 or self.step == self.schedule.steps:
                yield Progress(self.step, {name: total / report_every for name, total in sums.items()})
                sums.clear()

    def _one_step(self) -> dict[str, Tensor]:
        chosen = torch.randint(len(self.pool), (self.schedule.batch,), generator=self.random)
        matrices = rotations.exp(self.pool[chosen].to(self.device).view(-1, 21, 3))
        kl_weight = min(1.0, self.step / _WARM_UP)
        loss, parts = self.loss(self.network, matrices, kl_weight, self.random)
        self.network.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), _LARGEST_GRADIENT)
        for part in (*self.optimizers, *self.rates):
            part.step()
        self.step += 1
        return parts

    @torch.no_grad()
    def errors(self, matrices: Float[Tensor, "N 21 3 3"]) -> tuple[float, float]:
        """Mean degrees per joint and millimetres per point between poses and what comes back from their encoding."""
        matrices = matrices.to(self.device)
        back = self.network.decode(self.network.encode(matrices)[0])
        angle = rotations.log(matrices.mT @ back).norm(dim=-1)
        apart = (self.loss.skeleton.points(matrices) - self.loss.skeleton.points(back)).norm(dim=-1)
        return float(angle.mean().rad2deg()), float(1000 * apart.mean())
