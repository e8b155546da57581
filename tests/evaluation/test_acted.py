"""`python -m evaluation acted`: each sequence is fitted once."""

from dataclasses import replace
from pathlib import Path

import pytest

from evaluation import suite_runs
from evaluation.__main__ import main
from evaluation.synthetic import suite
from evaluation.synthetic.suite import SEQUENCES
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.results.fit_result import FitResult
from tests.tcfit_app.cli.test_evaluate_command import fit_result, records_in

pytestmark = pytest.mark.thorough


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
