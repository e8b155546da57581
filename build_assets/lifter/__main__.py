"""Trains the lifter that tcfit ships, on motion capture that may be used freely.

Writes a checkpoint beside the result and goes on from it when it is started again with the same settings.
"""

import json
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
import tyro
from tqdm import tqdm
from tyro.conf import OmitArgPrefixes, Positional

from build_assets.lifter.figure import Figure
from build_assets.lifter.filming import Studio
from build_assets.lifter.motions import Corpus, Windows, training_clips
from build_assets.lifter.training import Schedule, Training, score, write_lifter
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.errors import InputError
from fitting_core.lifting.network import LifterSize
from fitting_core.shipped import FREE_FOLDER

_JUDGED = 8
"""Films of 32 windows of held-out motion, for progress reports."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to train on, and how."""

    data: Positional[Path]
    """Folder with the motion capture: the folders of `mocap.READERS`, or some of them."""
    out: Path
    """Folder for the checkpoint, the learning curve (curve.jsonl) and the weights (tcfit_lifter.npz)."""
    minutes: float | None = None
    """Stop after so long, with a checkpoint; start again to go on."""
    threads: int = 1
    """CPU threads of torch."""
    save_every: int = 500
    """Steps between two checkpoints."""
    size: OmitArgPrefixes[LifterSize] = field(default_factory=LifterSize)
    schedule: OmitArgPrefixes[Schedule] = field(default_factory=Schedule)


def main(options: Options) -> None:
    """Load, film, train, write."""
    torch.set_num_threads(options.threads)
    figure = Figure.of(load_body(find_body(search=FREE_FOLDER)))
    clips, held = training_clips(options.data)
    rng = np.random.default_rng(options.schedule.seed)
    corpus = Corpus.of(clips, figure, rng)
    print(f"{len(corpus)} frames to train on")
    training = Training(Studio(figure, Windows(corpus, rng), rng), size=options.size, schedule=options.schedule)
    options.out.mkdir(parents=True, exist_ok=True)
    checkpoint = options.out / "checkpoint.pt"
    if checkpoint.exists():
        training.load(checkpoint)
        print(f"goes on at step {training.step} ({checkpoint})")
    unseen = np.random.default_rng(123)
    stage = Studio(figure, Windows(Corpus.of(held or clips, figure, unseen), unseen, varied=False), unseen)
    films = [stage.film(32) for _ in range(_JUDGED)]
    started = time.monotonic()
    with tqdm(total=options.schedule.steps, initial=training.step, unit="step", mininterval=30) as bar:
        for progress in training.run():
            bar.update(progress.step - bar.n)
            over = options.minutes is not None and time.monotonic() - started > 60 * options.minutes
            if progress.step % options.save_every == 0 or over:
                judged = score(training.average, films)
                took = round(time.monotonic() - started)
                line = {"step": progress.step, "seconds": took, "held out": asdict(judged), "loss": progress.parts}
                with (options.out / "curve.jsonl").open("a") as file:
                    file.write(json.dumps(line) + "\n")
                bar.write(str(judged))
                training.save(checkpoint)
            if over:
                break
    judged = score(training.average, films)
    notes = f"{training.step} of {options.schedule.steps} steps, {options.schedule}; held out: {judged}"
    write_lifter(options.out / "tcfit_lifter.npz", training.average, error_factor=judged.error_factor, notes=notes)
    print(f"written to {options.out}")


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except InputError as error:
        sys.exit(str(error))
