"""`python -m evaluation`: what is fitted once, what is told of it, and which options are refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluation import motion, suite_runs
from evaluation.__main__ import main
from evaluation.synthetic import suite
from evaluation.synthetic.motion_suite import clips
from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from evaluation.synthetic.suite import SEQUENCES
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.results.fit_result import FitResult, PhaseResult
from tests.tcfit_app.cli.test_evaluate_command import fit_result, records_in

NAME = "backflip_1"
ARGUMENTS = ["motion", "--sequences", NAME]


@pytest.fixture
def fitted(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Clip, FitConfig]]:
    """Fits that are the truth, 10 cm too far away in phase 1; the list has what was fitted."""
    found: list[tuple[Clip, FitConfig]] = []
    made: list[MotionClipMade] = []
    monkeypatch.setattr(clips, "in_view", lambda body, params, camera: np.ones((len(params), 137), bool))
    monkeypatch.setattr(motion, "compile_kernels", lambda config: None)

    def make(sequence: clips.MotionSequence, *, focal: str) -> MotionClipMade:
        made.append(make_motion(sequence, focal=focal, cached=False))
        return made[-1]

    def fit(clip: Clip, body: BodyModel, config: FitConfig) -> FitResult:
        found.append((clip, config))
        true = made[-1].truth.params
        away = replace(true, camera_translation=true.camera_translation + true.betas.new_tensor([0, 0, 0.1]))
        phases = tuple(
            PhaseResult(phase=n, params=params, objective={"total": 1.0}, frame_cost=np.ones(len(params)), seconds=1.0)
            for n, params in ((1, away), (3, true))
        )
        observed = np.ones((len(true), 55), bool)
        return FitResult(phases=phases, camera=clip.camera, config=config, observed=observed)

    monkeypatch.setattr(motion, "make_motion", make)
    monkeypatch.setattr(motion, "fit_clip", fit)
    return found


def test_a_half_is_fitted_once_and_told(
    fitted: list[tuple[Clip, FitConfig]], tmp_path: Path, capsys: pytest.CaptureFixture
):
    for _ in range(2):
        assert main([*ARGUMENTS, "--out", str(tmp_path)]) == 0 and len(fitted) == 1
    told = capsys.readouterr()
    assert "tcfit, phase 1: figures over all frames" in told.out and "motion: acrobatics" in told.out
    assert f"{NAME}, tcfit: MPJPE" in told.err
    content = json.loads((tmp_path / "motion.json").read_bytes())
    assert content["settings"]["Focal length"] == "true" and content["settings"]["Half"] == "tuning"
    first, final = content["records"]
    assert (first["method"], final["method"]) == ("tcfit, phase 1", "tcfit")
    # The fit is of the neutral body, whose joints are not quite the true body's.
    assert np.mean(first["curves"]["depth"]) > 60 and np.mean(final["curves"]["depth"]) < 40
    lines = (tmp_path / "motion.md").read_text().splitlines()
    widths = {line.count("|") for line in lines if line.startswith("| ")}
    assert len(widths) == 2, "two forms of tables, each of equal rows"


def test_settings_and_the_focal_length_make_fits_of_their_own(fitted: list[tuple[Clip, FitConfig]], tmp_path: Path):
    out = ["--out", str(tmp_path)]
    assert main([*ARGUMENTS, *out, "--set", "temporal.weight=7"]) == 0
    assert main([*ARGUMENTS, *out, "--focal", "default"]) == 0
    (clip, config), (other, plain) = fitted
    assert config.temporal.weight == 7 != plain.temporal.weight
    assert not other.camera.calibrated and other.camera.focal[0] == pytest.approx(np.hypot(*other.camera.size))
    np.testing.assert_array_equal(clip.keypoints.xy, other.keypoints.xy)
    assert clip.camera == motion_sequences()[NAME].shot.camera
    assert len(list(tmp_path.glob("fits/*/*/*/fit.key"))) == 2


WRONG = {
    "half": ([*ARGUMENTS, "--half", "untouched"], "this half has no backflip_1"),
    "preset": (["motion", "--presets", "best"], "best"),
    "setting": (["motion", "--set", "weight=1"], "weight"),
    "preset of acted": (["acted", "--presets", "best"], "no best"),
    "sequence of acted": (["acted", "--sequences", "dancing"], "no dancing"),
    "jobs of acted": (["acted", "--jobs", "0"], "--jobs is 0"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_options(kind: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.chdir(tmp_path)
    arguments, said = WRONG[kind]
    assert main(arguments) == 2
    assert said in capsys.readouterr().err and not list(tmp_path.iterdir())


# --- acted ---


@pytest.fixture
def short_suite(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """One sequence, cut to two frames, whose fits are their truth; the list counts them."""
    fitted: list[str] = []
    whole = suite.make_sequence(SEQUENCES["simple_1"])
    frames = slice(0, 2)
    truth = replace(whole.truth, params=whole.truth.params[frames])
    cut = replace(whole, clip=replace(whole.clip, keypoints=whole.clip.keypoints[frames]), truth=truth)

    def fit(clip: Clip, body: BodyModel, config: FitConfig) -> FitResult:
        fitted.append(clip.name)
        result = fit_result(truth.params)
        return replace(result, phases=result.phases[:1]) if config.last_phase == 1 else result

    monkeypatch.setattr(suite_runs, "make_sequence", lambda sequence: cut)
    monkeypatch.setattr(suite_runs, "fit_clip", fit)
    return fitted


@pytest.mark.thorough
def test_the_suite_is_not_fitted_twice(short_suite: list[str], tmp_path: Path, capsys: pytest.CaptureFixture):
    arguments = ["acted", "--sequences", "simple_1", "--presets", "smplifyx", "tcfit", "--every", "3"]
    arguments += ["--out", str(tmp_path)]
    assert main(arguments) == 0 and len(short_suite) == 2
    assert [r["method"] for r in records_in(tmp_path)] == ["SMPLify-X", "tcfit, phase 1", "tcfit"]
    assert main(arguments) == 0 and len(short_suite) == 2
    assert main([*arguments, "--every", "1"]) == 0 and len(short_suite) == 2
    (tmp_path / "fits/tcfit/simple_1/fit.key").write_text("of older settings")
    (tmp_path / "fits/tcfit/simple_1/records.json").write_text("{broken")
    assert main(arguments) == 0 and len(short_suite) == 3
    assert "SMPLify-X" in capsys.readouterr().out
