"""What the perspective network is trained on, and that it learns."""

from pathlib import Path

import numpy as np
import pytest
import torch

from build_assets.lifter.figure import Figure
from build_assets.lifter.filming import Shots, Studio
from build_assets.lifter.motions import Corpus, Windows
from build_assets.perspective.__main__ import Options, main
from build_assets.perspective.training import SHOTS, Training, mean_error, shown
from fitting_core.body.model import BodyModel
from fitting_core.lifting.network import Lifter, LifterSize
from fitting_core.lifting.perspective import read_perspective
from tests.build_assets.captured import deepmimic_frames, write_deepmimic
from tests.build_assets.test_lifter_training import KNEE, swinging

pytestmark = pytest.mark.thorough


def studio(free_body: BodyModel, shots: Shots = SHOTS) -> Studio:
    figure, rng = Figure.of(free_body), np.random.default_rng(0)
    return Studio(figure, Windows(Corpus.of([swinging(seed=1)], figure, rng), rng), rng, shots=shots)


def test_the_right_answer_does_not_know_the_assumed_focal_length(free_body: BodyModel):
    """All at one distance are equally large, whatever was assumed, and whatever the features are scaled to."""
    one = Shots(speakers=0.0, near_others=(3.0, 3.0), aside=0.0, cut=0.0, guessed=0.0)
    given = shown(studio(free_body, one), 40)
    assert float(given.log_extent.std()) < 0.2
    assert np.log(0.06) < float(given.log_extent.mean()) < np.log(0.13)
    extents = given.features[:, 0, 75]
    assert bool((extents == extents[0]).all()), "told"


@pytest.mark.slow
def test_training_learns(free_body: BodyModel):
    torch.manual_seed(0)
    stage = studio(free_body)
    training = Training(stage, Lifter(LifterSize(width=24, layers=1, heads=2)), steps=60, batch=12)
    films = [shown(stage, 32)]
    reports = list(training.run(report_every=15))
    assert reports[-1].loss < reports[0].loss - 0.04
    assert float(training.seen_share.sum()) == pytest.approx(1) and 0 < mean_error(training.average, films) < 1


@pytest.mark.slow
def test_the_command_writes_a_network(tmp_path: Path):
    frames = deepmimic_frames(frames=60)
    frames[:, KNEE] = -np.linspace(0.1, 1.0, 60)
    write_deepmimic(tmp_path / "data", {"sink": frames})
    main(Options(data=tmp_path / "data", out=tmp_path / "out", steps=2))
    _, share = read_perspective(tmp_path / "out/tcfit_perspective.npz")
    assert share.sum() == pytest.approx(1, abs=1e-3)
