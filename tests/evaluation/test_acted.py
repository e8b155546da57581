"""`python -m evaluation acted`: fitted once, varied one setting at a time, and what is said about wrong options."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from evaluation import ablations, suite_runs
from evaluation.__main__ import main
from evaluation.ablations import variations
from evaluation.synthetic import suite
from evaluation.synthetic.suite import SEQUENCES
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig, SolverSettings
from fitting_core.config.toml import as_plain
from fitting_core.results.fit_result import FitResult
from tests.tcfit_app.cli.test_evaluate_command import fit_result, records_in

pytestmark = pytest.mark.thorough

WRONG = {
    "level": (["--level", "worst"], "no worst"),
    "preset": (["--presets", "best"], "no best"),
    "sequence": (["--sequences", "dancing"], "no dancing"),
    "jobs": (["--jobs", "0"], "--jobs is 0"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_options(kind: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.chdir(tmp_path)
    arguments, said = WRONG[kind]
    assert main(["acted", *arguments]) == 2
    assert said in capsys.readouterr().err and not list(tmp_path.iterdir())


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

    monkeypatch.setattr(suite_runs, "make_sequence", lambda sequence, level: cut)
    monkeypatch.setattr("evaluation.acted.make_sequence", lambda sequence, level: cut)
    monkeypatch.setattr(suite_runs, "fit_clip", fit)
    return fitted


def test_the_suite_is_not_fitted_twice(short_suite: list[str], tmp_path: Path, capsys: pytest.CaptureFixture):
    arguments = ["acted", "--sequences", "simple_1", "--presets", "smplifyx", "tcfit", "--every", "3"]
    arguments += ["--out", str(tmp_path), "--pictures", "0"]
    assert main(arguments) == 0 and len(short_suite) == 2
    assert [r["method"] for r in records_in(tmp_path)] == ["SMPLify-X", "tcfit, phase 1", "tcfit"]
    assert main(arguments) == 0 and len(short_suite) == 2
    assert main([*arguments[:-2], "--pictures", "1", "--every", "1"]) == 0 and len(short_suite) == 2
    (tmp_path / "fits/normal/tcfit/simple_1/fit.key").write_text("of older settings")
    (tmp_path / "fits/normal/tcfit/simple_1/records.json").write_text("{broken")
    assert main(arguments) == 0 and len(short_suite) == 3
    assert "SMPLify-X" in capsys.readouterr().out


def test_ablations_vary_one_setting_at_a_time(short_suite: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    base = replace(PRESETS["tcfit"], settings=SolverSettings(iterations=2))
    whole = variations(base)
    assert [len(v.values) for v in whole] == [6, 9, 5]
    for variation in whole:
        settings = [as_plain(config) for *_, config in variation.values]
        assert all(one != other for i, one in enumerate(settings) for other in settings[:i]), variation.title
    few = tuple(replace(v, values=v.values[:n]) for v, n in zip(whole, (1, 0, 2), strict=True) if n)
    monkeypatch.setattr(ablations, "variations", lambda base: few)
    arguments = ["acted", "--ablations", "--sequences", "simple_1", "--presets", "tcfit"]
    assert main([*arguments, "--every", "3", "--pictures", "0", "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "ablations.json").read_bytes())
    assert [len(a["trials"]) for a in found] == [1, 2]
    assert len(short_suite) == 2, "the preset, and one phase 1 for all variations"
    seconds = found[1]["trials"][0]["errors"]["Phase 3, CPU s a frame"]
    assert seconds > 0
    assert found[1]["trials"][0]["errors"]["Vertex-to-surface error, cm"] is not None
    assert "Settings varied one at a time" in (tmp_path / "report.html").read_text()
