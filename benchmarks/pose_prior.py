"""The trained pose prior on people whom its training never saw: how exactly their poses come back, and its samples.

Beside it principal components of the same number, of the axis-angle and of the 6D rotations, found on the same poses.
Needs the motion capture that the prior was trained on (`build_assets.pose_prior`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from tyro.conf import OmitArgPrefixes, Positional

from benchmarks.report import Common, Row, progress, report, start
from build_assets.motion_capture.collections import split
from build_assets.motion_capture.retarget import load
from build_assets.pose_prior.dataset import balanced, matrices, pool
from build_assets.pose_prior.skeleton import Contact, Skeleton
from fitting_core.body import rotations
from fitting_core.body.mesh import Mesh
from fitting_core.body.params import BodyParams
from fitting_core.priors.pose import make_prior
from fitting_core.render.sheets import Cell, beside, write_sheet
from tests.samples.body_pictures import pose_cells

Coder = Callable[[Float[Tensor, "N 21 3 3"]], Float[Tensor, "N 21 3 3"]]
"""Rotations through a bottleneck and back."""
_SAMPLES = 32
_WORST = 16
_ON_MESH = 400
"""Poses whose whole mesh is compared."""


@dataclass(frozen=True, kw_only=True)
class PosePriorBenchmark:
    """Which prior on which poses."""

    data: Positional[Path]
    """Folder with the motion capture (`cmu`, `deepmimic`)."""
    prior: str = "tcfit"
    """Name or file of a latent prior."""
    every: int = 5
    """Take every n-th held-out frame."""
    pool: int = 60_000
    """Poses, as the training has them, that principal components are found on."""
    seed: int = 0
    sheets: Path | None = None
    """Write pictures of samples and of the worst reconstructions to this folder."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def components(
    poses: Float[Tensor, "N 21 n m"], count: int, back: Callable[[Tensor], Tensor], into: Callable[[Tensor], Tensor]
) -> Coder:
    """The first principal components of `into(rotations)`."""
    flat = into(poses).flatten(1)
    mean = flat.mean(0)
    basis = torch.linalg.eigh((flat - mean).T @ (flat - mean))[1][:, -count:]
    return lambda r: back(mean + (into(r).flatten(1) - mean) @ basis @ basis.T)


def bottlenecks(prior, train: Float[Tensor, "N 21 3 3"]) -> dict[str, Coder]:
    """The prior, and principal components of the same size."""

    def through(r: Tensor) -> Tensor:
        return rotations.exp(prior.decode(prior.encode(rotations.log(r).flatten(1))).view(-1, 21, 3))

    return {
        "prior": through,
        "PCA, axis-angle": components(train, prior.size, lambda v: rotations.exp(v.view(-1, 21, 3)), rotations.log),
        "PCA, 6D": components(
            train, prior.size, lambda v: rotations.orthonormalised(v.view(-1, 21, 3, 2)), lambda r: r[..., :2]
        ),
    }


def main(options: PosePriorBenchmark) -> None:
    """Run it."""
    body = options.common.load_body()
    skeleton, mesh, rng = Skeleton(body), Mesh(body), np.random.default_rng(options.seed)
    prior = make_prior(options.prior, dtype=torch.float64, device="cpu")
    clips, held = split(load(options.data))
    progress("poses to find components on")
    captured = balanced(clips, skeleton, rng)
    contact = Contact(skeleton)
    drawn = matrices(captured.body_pose[rng.choice(len(captured.weight), options.pool, p=captured.weight)]).double()
    mixed = matrices(pool(captured, contact, options.pool, rng)).double()
    truth = matrices(np.concatenate([clip.body_pose for clip in held])[:: options.every]).double()
    rows: list[Row] = []
    for trained_on, train in (("captured", drawn), ("captured and synthesised", mixed)):
        for name, coder in bottlenecks(prior, train).items():
            if name == "prior" and rows:
                continue
            progress(f"{name}, {trained_on}")
            rows.append(
                {
                    "bottleneck": name,
                    "found on": trained_on if name != "prior" else "captured and synthesised",
                    **_errors(skeleton, mesh, truth, coder(truth)),
                }
            )
    latent = prior.encode(rotations.log(mixed[:5000]).flatten(1))
    samples = prior.decode(
        torch.randn(2000, prior.size, generator=torch.Generator().manual_seed(options.seed), dtype=torch.float64)
    )
    colliding = float(contact.overlaps(matrices(samples.numpy())).double().mean())
    statistics = [
        {"latent": "mean over numbers of |mean|", "value": float(latent.mean(0).abs().mean())},
        {"latent": "standard deviation, least", "value": float(latent.std(0).min())},
        {"latent": "standard deviation, mean", "value": float(latent.std(0).mean())},
        {"latent": "standard deviation, greatest", "value": float(latent.std(0).max())},
        {"latent": "|correlation| of two numbers, mean", "value": _correlation(latent)},
        {"latent": "share beyond 3 (normal: 0.0027)", "value": float((latent.abs() > 3).double().mean())},
        {"latent": "samples that collide with themselves", "value": colliding},
    ]
    report(options, {"held-out subjects": rows, "latent": statistics})
    if options.sheets:
        _write_sheets(options.sheets, mesh, prior, samples, truth)


def _correlation(latent: Tensor) -> float:
    c = torch.corrcoef(latent.T)
    return float((c - torch.diag(c.diagonal())).abs().sum() / (len(c) * (len(c) - 1)))


def _errors(skeleton: Skeleton, mesh: Mesh, truth: Tensor, found: Tensor) -> dict[str, float]:
    angle = rotations.log(truth.mT @ found).norm(dim=-1).rad2deg()
    points = 1000 * (skeleton.points(truth) - skeleton.points(found)).norm(dim=-1).mean(1)
    some = torch.linspace(0, len(truth) - 1, _ON_MESH).long()
    vertices = 1000 * (_vertices(mesh, truth[some]) - _vertices(mesh, found[some])).norm(dim=-1).mean(1)
    return {
        "degrees per joint": float(angle.mean()),
        "joints mm": float(points.mean()),
        "joints mm, 90 %": float(points.quantile(0.9)),
        "vertices mm": float(vertices.mean()),
        "vertices mm, 90 %": float(vertices.quantile(0.9)),
    }


def _params(body_pose: Float[Tensor, "N 63"]) -> BodyParams:
    return replace(BodyParams.neutral(len(body_pose)), body_pose=body_pose)


def _vertices(mesh: Mesh, turned: Float[Tensor, "N 21 3 3"]) -> Tensor:
    return torch.cat([mesh(_params(rotations.log(part).flatten(1))) for part in turned.split(50)])


def _write_sheets(folder: Path, mesh: Mesh, prior, samples: Float[Tensor, "N 63"], truth: Tensor) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    captions = [str(i) for i in range(_SAMPLES)]
    write_sheet(folder / "samples.png", pose_cells(mesh, _params(samples[:_SAMPLES]), captions, degrees=(25.0,)), 8)
    pose = rotations.log(truth).flatten(1)
    found = prior.decode(prior.encode(pose))
    error = 1000 * (mesh.joints(_params(pose)) - mesh.joints(_params(found))).norm(dim=-1).mean(1)
    worst = error.argsort(descending=True)
    spread = worst[: len(worst) // 50][:: max(1, len(worst) // 50 // _WORST)][:_WORST]
    cells = []
    for i in spread.tolist():
        pair = pose_cells(mesh, _params(torch.stack([pose[i], found[i]])), ["", ""], degrees=(25.0,), extent=2.1)
        cells.append(Cell(picture=beside([c.picture for c in pair]), caption=f"true | back: {error[i]:.0f} mm"))
    write_sheet(folder / "worst.png", cells, 4)


if __name__ == "__main__":
    start(PosePriorBenchmark, main)
