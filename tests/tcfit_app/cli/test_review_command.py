"""`tcfit review`: which project it opens or makes, and what it says."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.detect.detectors import DETECTORS
from tcfit_app.cli.ending import INPUT_ERROR
from tcfit_app.cli.main import main
from tcfit_app.project.project import Project
from tcfit_app.review.app import ReviewApp
from tcfit_app.review.session.session import Session
from tests.samples.media import write_video
from tests.samples.project_samples import BODY, sample_fit
from tests.tcfit_app.conftest import FRAMES


@pytest.fixture(autouse=True)
def served(monkeypatch: pytest.MonkeyPatch) -> list[Session]:
    """Sessions that were served; Ctrl-C comes at once."""
    seen: list[Session] = []

    def run(app: ReviewApp) -> None:
        seen.append(app.session)
        raise KeyboardInterrupt

    monkeypatch.setattr(ReviewApp, "run", run)
    return seen


def reviewed(*arguments: Any) -> int:
    return main(["review", *map(str, arguments), "--port", "0", "--no-browser"])


def test_a_clip_becomes_a_project_which_is_opened_again(
    clip_arguments: list[str], tmp_path: Path, served: list[Session], capsys: pytest.CaptureFixture
):
    folder = tmp_path / "wave.tcfit"
    assert reviewed(*clip_arguments, "--out", folder) == 0
    told = capsys.readouterr()
    assert "Review: http://127.0.0.1:" in told.out and f"Made the project {folder}" in told.out
    assert f"Everything is saved in {folder}" in told.out
    with Project.open(folder) as project:
        assert len(project.clip) == FRAMES and not project.runs.all()
        project.marks.set([2], "flag")
    assert reviewed(*clip_arguments, "--out", folder) == 0
    assert "Opening the existing project" in capsys.readouterr().err
    assert reviewed(folder) == 0
    assert len(served) == 3 and [s.project.folder for s in served] == [folder] * 3
    with Project.open(folder) as project:
        assert list(project.marks.all()) == [2]


def test_what_can_be_reviewed_is_said(tmp_path: Path, capsys: pytest.CaptureFixture):
    for given, said in (([], "expected a project, a video"), ([tmp_path / "no.tcfit"], "no.tcfit does not")):
        assert reviewed(*given) == INPUT_ERROR
        assert said in capsys.readouterr().err


def test_a_second_process_is_told_and_opens_it_read_only(
    clip_arguments: list[str], tmp_path: Path, served: list[Session], capsys: pytest.CaptureFixture
):
    folder = tmp_path / "wave.tcfit"
    reviewed(*clip_arguments, "--out", folder)
    with Project.open(folder):
        assert reviewed(folder) == 0
    told = capsys.readouterr().out
    assert "is open in another tcfit" in told and "opens read-only here" in told
    assert served[-1].project.read_only
    assert reviewed(folder, "--read-only") == 0 and served[-1].project.read_only


def test_a_first_fit_starts_if_asked_for(
    clip_arguments: list[str], tmp_path: Path, served: list[Session], monkeypatch: pytest.MonkeyPatch
):
    started: list[FitConfig] = []
    monkeypatch.setattr(Session, "fit_everything", lambda self, config, **body: started.append(config))
    folder = tmp_path / "wave.tcfit"
    reviewed(*clip_arguments, "--out", folder)
    assert not started
    reviewed(folder, "--fit")
    assert started == [PRESETS["tcfit"]]
    reviewed(folder, "--height", "182.5")
    reviewed(folder, "--fit")
    assert started[1:] == [replace(PRESETS["tcfit"], height=182.5)], "the project has kept it"


def test_a_fit_that_is_asked_for_and_cannot_begin_is_told(
    clip_arguments: list[str],
    tmp_path: Path,
    served: list[Session],
    capsys: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
):
    def told(*arguments: str | Path) -> str:
        capsys.readouterr()
        assert reviewed(*arguments, "--fit") == 0
        lines = [line for line in capsys.readouterr().out.splitlines() if "--fit" in line]
        return lines[0] if lines else ""

    alone, folder = tmp_path / "alone.tcfit", tmp_path / "wave.tcfit"
    no_keypoints = "--fit: no fit was started, because alone.tcfit has no keypoints. Detect them in the panel Start"
    assert no_keypoints in told(write_video(tmp_path / "a.mp4"), "--keypoints", "none", "--out", alone)
    found = []
    monkeypatch.setattr(Session, "find_and_fit", lambda self, detector, config, person: found.append(detector))
    known = DETECTORS["mediapipe"]
    monkeypatch.setitem(DETECTORS, "mediapipe", replace(known, is_here=lambda: False))
    assert told(alone).endswith("is not installed. Download it in the panel Start.") and not found
    monkeypatch.setitem(DETECTORS, "mediapipe", replace(known, is_here=lambda: True))
    assert told(alone) == "" and found == ["mediapipe"], "they are found without being asked twice"
    reviewed(*clip_arguments, "--out", folder)
    assert told(folder, "--read-only").endswith("wave.tcfit is open read-only.")
    with Project.open(folder) as project:
        project.runs.start(PRESETS["tcfit"], body=BODY, edits_seen=0)
    started = []
    monkeypatch.setattr(Session, "fit_everything", lambda self, config, **body: started.append(config))
    assert told(folder) == "" and started == [PRESETS["tcfit"]], "the first fit was cancelled: it begins again"
    with Project.open(folder) as project:
        run = project.runs.start(PRESETS["tcfit"], body=BODY, edits_seen=0)
        project.runs.finish(run.id, sample_fit(0, frames=len(project.clip)))
    assert told(folder).endswith("wave.tcfit has fits already.")


def test_what_is_wrong_is_said(clip_arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture):
    folder = tmp_path / "wave.tcfit"
    reviewed(*clip_arguments, "--out", folder)
    capsys.readouterr()
    assert reviewed(folder, "--keypoints", tmp_path) == 2
    assert "--keypoints can only be given for a new project" in capsys.readouterr().err
    assert reviewed(tmp_path / "nothing.mp4") == 2
    assert "nothing.mp4" in capsys.readouterr().err
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").write_text("x")
    assert reviewed(*clip_arguments, "--out", tmp_path / "other") == 2
    assert "mine.txt" in capsys.readouterr().err
    assert reviewed(folder, "--files", tmp_path / "nowhere") == 2
    assert "--files" in capsys.readouterr().err
