"""The training loop: seeded, with checkpoints from which it goes on."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from build_assets.lifter.filming import Film, Studio
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.npz import write_npz
from fitting_core.files.regular import regular_file
from fitting_core.lifting.network import FORMAT, FRAMES, RATE, AboutLifter, Lifted, Lifter, LifterSize
from fitting_core.lifting.rays import seen

_WARM_UP = 200
"""Steps over which the learning rate rises, in a schedule of some length."""
_LARGEST_GRADIENT = 5.0
_AVERAGED = 0.999
"""Of the running mean of the weights, which is what is used in the end."""
_UNSEEN = 0.12
"""Weight of keypoints that no frame of the window shows: what is likely of them is learned as well."""
_WEIGHTS = {"points": 4.0, "speed": 4.0, "error": 0.05, "up": 1.0, "contact": 0.1}
"""Of the parts of the loss."""
_SMALLEST = 0.005
"""Metres: no expected error is smaller."""


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """How long and how fast."""

    steps: int = 60_000
    batch: int = 48
    """Windows in a step."""
    rate: float = 0.02
    """Largest learning rate of Muon; that of AdamW is 0.075 times as large. Lowered to zero along a cosine."""
    seed: int = 0


@dataclass(frozen=True)
class Progress:
    """Means over the steps since the last report."""

    step: int
    parts: dict[str, float]
    """Of the loss: metres, metres a frame, nats, and so on."""


class Training:
    """A lifter in training.

    Args:
        studio: what films the windows.
        size: of the network.
        schedule: how long and how fast.
    """

    def __init__(self, studio: Studio, *, size: LifterSize, schedule: Schedule) -> None:
        torch.manual_seed(schedule.seed)
        self.studio, self.schedule = studio, schedule
        self.network, self.average = Lifter(size), Lifter(size)
        self.average.load_state_dict(self.network.state_dict())
        inner = [p for name, p in self.network.named_parameters() if p.ndim == 2 and name.startswith("blocks")]
        others = [p for p in self.network.parameters() if not any(p is one for one in inner)]
        self.optimizers = [
            torch.optim.Muon(inner, lr=schedule.rate, weight_decay=0.01, adjust_lr_fn="original"),
            torch.optim.AdamW(others, lr=0.075 * schedule.rate, weight_decay=0.01),
        ]
        self._rates = [0.075 * schedule.rate if k else schedule.rate for k in range(2)]
        self.step = 0

    def run(self, report_every: int = 250) -> Iterator[Progress]:
        """Train to the end of the schedule, with a report now and then."""
        sums: Counter[str] = Counter()
        while self.step < self.schedule.steps:
            sums.update(self._one_step())
            if self.step % report_every == 0 or self.step == self.schedule.steps:
                yield Progress(self.step, {name: total / report_every for name, total in sums.items()})
                sums.clear()

    def _one_step(self) -> dict[str, float]:
        done = self.step / self.schedule.steps
        warm = min(_WARM_UP, 0.05 * self.schedule.steps)
        share = min(1.0, (self.step + 1) / warm) * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * done)))
        for optimizer, rate in zip(self.optimizers, self._rates, strict=True):
            for group in optimizer.param_groups:
                group["lr"] = share * rate
        film = self.studio.film(self.schedule.batch)
        parts = losses(self.network, film)
        loss = torch.stack([_WEIGHTS[name] * part for name, part in parts.items()]).sum()
        self.network.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), _LARGEST_GRADIENT)
        for optimizer in self.optimizers:
            optimizer.step()
        self.step += 1
        keep = min(_AVERAGED, self.step / (self.step + 10))
        with torch.no_grad():
            for mean, now in zip(self.average.parameters(), self.network.parameters(), strict=True):
                mean.lerp_(now, 1 - keep)
        return {name: float(part.detach()) for name, part in parts.items()}

    def _identity(self) -> dict[str, object]:
        return {"size": asdict(self.network.size), "schedule": asdict(self.schedule)}

    def save(self, path: Path) -> None:
        """Write a checkpoint."""
        state = {
            "step": self.step,
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
        }
        _write_checkpoint(path, self._identity(), state)

    def load(self, path: Path) -> None:
        """Continue from a checkpoint, with new windows.

        Raises:
            InputError: it belongs to a training with other settings, or is no checkpoint.
        """
        state = _read_checkpoint(path, self._identity())
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        for optimizer, saved in zip(self.optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(saved)
        self.step = state["step"]
        self.studio.reseeded((self.schedule.seed, self.step))


def lifted(network: Lifter, film: Film) -> tuple[Lifted, Float[Tensor, "B T 25 3"], Float[Tensor, "B 3"]]:
    """What a network says of windows, and the truth in the same axes: points and up."""
    given = seen(film.rays, film.confidence, film.calibrated)
    up = (given.to_virtual @ film.up[..., None])[..., 0]
    return network(given.features), film.points @ given.to_virtual[:, None].mT, up


def losses(network: Lifter, film: Film) -> dict[str, Tensor]:
    """The parts of the loss over the usable windows."""
    film = Film(*(values[film.usable] for values in film))
    found, points, up = lifted(network, film)
    there = (film.confidence > 0).float()
    weight = torch.maximum(there, 0.6 * there.mean(1, keepdim=True)).clamp_min(_UNSEEN)
    off = found.points - points
    apart = off.norm(dim=-1)
    moved = (off[:, 1:] - off[:, :-1]).norm(dim=-1)
    aside, scale = off[..., 2].detach().abs(), found.log_error.exp().clamp_min(_SMALLEST)
    missed = (found.up - up[:, None]).square().sum(-1)
    known = film.stands.isfinite()
    stands = torch.where(known, film.stands, 0.0)
    contact = torch.nn.functional.binary_cross_entropy_with_logits(found.contact, stands, reduction="none")
    return {
        "points": (weight * apart).sum() / weight.sum(),
        "speed": (weight[:, 1:] * moved).sum() / weight[:, 1:].sum(),
        "error": (aside / scale + scale.log()).mean(),
        "up": missed.mean(),
        "contact": (contact * known).sum() / known.sum().clamp_min(1),
    }


@dataclass(frozen=True, kw_only=True)
class Score:
    """How well held-out motion comes back, over keypoints that are seen."""

    points: float
    """Mean distance, mm."""
    depth: float
    """Mean distance along z, mm."""
    known_depth: float
    """The same of the half of the keypoints that are expected to be nearest, mm."""
    error_factor: float
    """Mean error over expected error: 1 where errors are as large as the network says."""
    calibration: tuple[float, ...]
    """The same in five bins of equal size, from the smallest expected error on."""
    up: float
    """Mean angle from the true vertical, degrees."""
    contact: float
    """Share of feet that are judged right."""


@torch.no_grad()
def score(network: Lifter, films: list[Film]) -> Score:
    """Over some films."""
    distances, depths, expected, angles, right = [], [], [], [], []
    for film in films:
        film = Film(*(values[film.usable] for values in film))
        found, points, up = lifted(network, film)
        there = film.confidence > 0
        off = found.points - points
        distances.append(off.norm(dim=-1)[there])
        depths.append(off[..., 2].abs()[there])
        expected.append(found.log_error.exp().clamp_min(_SMALLEST)[there])
        mean = torch.nn.functional.normalize(found.up.mean(1), dim=-1)
        angles.append((mean * up).sum(-1).clamp(-1, 1).acos().rad2deg())
        known = film.stands.isfinite()
        right.append(((found.contact > 0) == (film.stands > 0.5))[known].float())
    depth, sure = torch.cat(depths).numpy(), torch.cat(expected).numpy()
    order = np.argsort(sure)
    bins = np.array_split(order, 5)
    return Score(
        points=1e3 * float(torch.cat(distances).mean()),
        depth=1e3 * float(depth.mean()),
        known_depth=1e3 * float(depth[order[: len(order) // 2]].mean()),
        error_factor=float(depth.mean() / sure.mean()),
        calibration=tuple(round(float(depth[b].mean() / sure[b].mean()), 2) for b in bins),
        up=float(torch.cat(angles).mean()),
        contact=float(torch.cat(right).mean()),
    )


def _write_checkpoint(path: Path, of: Mapping[str, object], state: Mapping[str, object]) -> None:
    """Write how far a training is, whole or not at all.

    Args:
        path: The file.
        of: The training's settings, which it cannot go on without.
        state: Tensors, numbers, and lists and dictionaries of them.
    """
    with replacing(path) as draft:
        torch.save({"of": dict(of), **state}, draft)


def _read_checkpoint(path: Path, of: Mapping[str, object]) -> dict[str, Any]:
    """The state that `_write_checkpoint` wrote, of a training with these settings.

    Raises:
        InputError: It belongs to a training with other settings, or is no checkpoint.
    """
    try:
        state = torch.load(regular_file(path, most=None), weights_only=True)
        found = state.pop("of")
    except Exception as error:  # torch raises many kinds for damaged files
        raise InputError(f"{path}: not a checkpoint of this training ({error}). Delete it to start again.") from error
    if found != dict(of):
        raise InputError(
            f"{path}: belongs to a training with other settings, {found}; now: {dict(of)}. Give the same settings to "
            f"go on with it, or delete it to start again."
        )
    return state


def write_lifter(path: Path, network: Lifter, *, error_factor: float, notes: str) -> None:
    """Write a network atomically, at half the precision of its training."""
    of_windows = {"frames": FRAMES, "rate": RATE, **asdict(network.size)}
    about = AboutLifter(format=FORMAT, error_factor=error_factor, notes=notes, **of_windows)
    halves = {name: values.detach().cpu().numpy().astype(np.float16) for name, values in network.state_dict().items()}
    write_npz(path, {"about": np.array(msgspec.json.encode(about).decode()), **halves})
