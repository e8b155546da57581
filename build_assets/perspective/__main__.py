"""Trains the network by which tcfit estimates focal lengths, from the lifter on, on the same motion capture."""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from tyro.conf import Positional

from build_assets.lifter.figure import Figure
from build_assets.lifter.filming import Studio
from build_assets.lifter.motions import Corpus, Windows, training_clips
from build_assets.perspective.training import SHOTS, Training, mean_error, shown
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.errors import InputError
from fitting_core.lifting.perspective import write_perspective
from fitting_core.lifting.weights import read_lifter
from fitting_core.shipped import FREE_FOLDER

_JUDGED = 8
"""Films of 48 windows of held-out motion, for progress reports."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to train on, and how long."""

    data: Positional[Path]
    """Folder with the motion capture: `cmu`, `deepmimic` and, if it is there, `cmu_expmap`."""
    out: Path
    """Folder for the weights (tcfit_perspective.npz), written again with each report."""
    steps: int = 4000
    """How long; the learning rate falls to zero by then. A step takes a third of a second on a core of its own."""
    threads: int = 1
    """CPU threads of torch."""
    seed: int = 0


def main(options: Options) -> None:
    """Load, film, train, write."""
    torch.set_num_threads(options.threads)
    figure = Figure.of(load_body(find_body(search=FREE_FOLDER)))
    clips, held = training_clips(options.data)
    rng, unseen = np.random.default_rng(options.seed), np.random.default_rng(123)
    studio = Studio(figure, Windows(Corpus.of(clips, figure, rng), rng), rng, shots=SHOTS)
    corpus = Corpus.of(held or clips, figure, unseen)
    stage = Studio(figure, Windows(corpus, unseen, varied=False), unseen, shots=SHOTS)
    films = [shown(stage, 48) for _ in range(_JUDGED)]
    training = Training(studio, read_lifter()[0], steps=options.steps, seed=options.seed)
    options.out.mkdir(parents=True, exist_ok=True)
    for progress in training.run():
        error = mean_error(training.average, films)
        judged = f"{progress.step} steps; mean error of the logarithm on held-out motion {error:.3f}"
        print(f"{judged}; loss {progress.loss:.3f}", flush=True)
        path = options.out / "tcfit_perspective.npz"
        write_perspective(path, training.average, seen_share=training.seen_share, notes=judged)


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except InputError as error:
        sys.exit(str(error))
