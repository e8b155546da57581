"""Train the pose prior that tcfit ships, on motion capture that may be used freely."""

import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from tqdm import tqdm
from tyro.conf import OmitArgPrefixes, Positional, arg

from build_assets.motion_capture.collections import split
from build_assets.motion_capture.retarget import load
from build_assets.pose_prior.autoencoder import NetworkSize, PoseAutoencoder
from build_assets.pose_prior.dataset import balanced, matrices, pool
from build_assets.pose_prior.loss import Precision
from build_assets.pose_prior.skeleton import Contact, Skeleton
from build_assets.pose_prior.training import Progress, Schedule, Training
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.errors import InputError
from fitting_core.priors.files.network import Activation, Layer, PriorNetwork, write_prior_network
from fitting_core.shipped import FREE_FOLDER, POSE_PRIOR

_LICENCE = "Apache-2.0"


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to train on, and how."""

    data: Positional[Path]
    """Folder with the motion capture: `cmu` (BVH channels) and `deepmimic`."""
    out: Path = POSE_PRIOR
    """The prior's file."""
    poses: int = 300_000
    """Poses to draw and to synthesise before training."""
    device: Annotated[str, arg(metavar="DEVICE", help_behavior_hint="(default: cuda where there is one)")] = ""
    """cpu or cuda."""
    threads: int = 1
    """CPU threads of torch. On a busy machine a step took 0.5 s of two of them, 0.05 s of one."""
    size: OmitArgPrefixes[NetworkSize] = field(default_factory=NetworkSize)
    precision: OmitArgPrefixes[Precision] = field(default_factory=Precision)
    schedule: OmitArgPrefixes[Schedule] = field(default_factory=Schedule)


def main(options: Options) -> None:
    """Load, draw, train, write."""
    torch.set_num_threads(options.threads)
    device = options.device or ("cuda" if torch.cuda.is_available() else "cpu")
    body = load_body(find_body(search=FREE_FOLDER))
    skeleton = Skeleton(body)
    clips, held = split(load(options.data))
    rng = np.random.default_rng(options.schedule.seed)
    print(
        f"{sum(len(c.body_pose) for c in clips)} captured poses; drawing {options.poses} from them and from synthesis"
    )
    captured = balanced(clips, skeleton, rng)
    training = Training(
        pool(captured, Contact(skeleton), options.poses, rng),
        body,
        size=options.size,
        precision=options.precision,
        schedule=options.schedule,
        device=device,
    )
    unseen = np.concatenate([clip.body_pose for clip in held] or [clips[0].body_pose])[::10]
    started = time.monotonic()
    with tqdm(total=options.schedule.steps, unit="step") as bar:
        for progress in training.run():
            bar.update(progress.step - bar.n)
            bar.write(_line(progress, training, unseen))
    notes = f"{options.schedule}, {options.precision}, {options.size}; {time.monotonic() - started:.0f} s on {device}"
    write_prior_network(options.out, exported(training.network), notes=notes)
    print(f"written to {options.out}")


def _line(progress: Progress, training: Training, unseen: np.ndarray) -> str:
    """How far training is, and how exactly held-out poses come back."""
    degrees, millimetres = training.errors(matrices(unseen))
    parts = "  ".join(f"{name} {value:.1f}" for name, value in progress.parts.items())
    return f"{progress.step:6d}  {parts} nats;  held out {degrees:.2f} degrees, {millimetres:.1f} mm"


def exported(network: PoseAutoencoder) -> PriorNetwork:
    """The network in the form that fits use: the encoder gives the mean only."""

    def layers(part: torch.nn.Sequential, outputs: int | None = None) -> tuple[Layer, ...]:
        dense = [m for m in part if isinstance(m, torch.nn.Linear)]
        arrays = [(m.weight.detach().cpu().numpy(), m.bias.detach().cpu().numpy()) for m in dense]
        arrays[-1] = (arrays[-1][0][:outputs], arrays[-1][1][:outputs])
        hidden: list[Activation] = [network.size.activation] * (len(dense) - 1)
        kinds: list[Activation] = [*hidden, "linear"]
        return tuple(Layer(weight, bias, kind) for (weight, bias), kind in zip(arrays, kinds, strict=True))

    latent = network.decoder[0].in_features
    return PriorNetwork(
        decoder=layers(network.decoder),
        encoder=layers(network.encoder, latent),  # pyright: ignore
        title="tcfit pose prior",
        licence=_LICENCE,
    )


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except InputError as error:
        sys.exit(str(error))
