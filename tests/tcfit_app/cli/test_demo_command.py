"""`tcfit demo`: the clip's own camera, and errors against the truth that are what they say."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from evaluation.synthetic.demo_clip import DemoClip
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.io.truth import Truth
from tcfit_app.cli import demo_command
from tcfit_app.cli.demo_command import joint_errors
from tcfit_app.cli.fit_command import Outcome
from tcfit_app.cli.main import main
from tests.tcfit_app.conftest import CAMERA, FRAMES, QUICK, motion


@pytest.fixture
def demo(keypoint_folder: Path, free_body: BodyModel, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Truth:
    """The tiny clip in place of the demo's."""
    video = tmp_path / "images"
    video.mkdir()
    for i in range(FRAMES):
        cv2.imwrite(str(video / f"{i}.png"), np.zeros((480, 640, 3), np.uint8))
    params = motion()
    truth = Truth(
        params=params,
        joints=joints_in_space(free_body, params),
        keypoints=np.zeros((FRAMES, 137, 2)),
        visible=np.ones((FRAMES, 137), bool),
        exists=np.ones(137, bool),
        camera=CAMERA,
        frame_rate=25.0,
        body_hash=free_body.hash,
    )
    clip = DemoClip(video=video, keypoints=keypoint_folder, truth=tmp_path / "t.npz", camera=CAMERA)
    monkeypatch.setattr(demo_command, "demo_clip", lambda: clip)
    monkeypatch.setattr(demo_command, "read_truth", lambda path: truth)
    return truth


def test_demo_fits_writes_and_compares(demo: Truth, tmp_path: Path, capsys: pytest.CaptureFixture):
    out = tmp_path / "out"
    assert main(["demo", "--no-review", "--out", str(out), "--no-overlay", *QUICK]) == 0
    told = capsys.readouterr()
    assert "Focal length 800.0 px" in told.err and f"into {out}" in told.out
    assert told.err.splitlines()[-1].endswith("tcfit review VIDEO --fit")
    assert sorted(path.name for path in out.iterdir()) == ["fit.npz", "summary.json"]
    header, first, last, truth = told.out.splitlines()[-4:]
    assert "in the camera" in header and truth.split()[0] == "truth"
    assert [line.split()[:2] for line in (first, last)] == [["phase", "1"], ["phase", "3"]]
    assert 0 < float(last.split()[3]) < 300


def test_errors_are_in_millimetres(demo: Truth, free_body: BodyModel):
    outcome = Outcome(fit=None, body=free_body, summary={})  # pyright: ignore[reportArgumentType]
    absolute, aligned, pa, _ = joint_errors(outcome, demo.params, demo)
    assert max(absolute, aligned, pa) < 1e-6
    shift = torch.tensor([0.03, 0.0, 0.04])
    moved = replace(demo.params, camera_translation=demo.params.camera_translation + shift)
    absolute, aligned, pa, _ = joint_errors(outcome, moved, demo)
    assert absolute == pytest.approx(50) and aligned < 1e-6 and pa < 1e-6


def test_wrong_options_are_found_first(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture):
    def never(*_: object) -> None:
        raise AssertionError("the clip was read")

    monkeypatch.setattr(demo_command, "read_clip", never)
    assert main(["demo", "--out", str(tmp_path / "out"), "--set", "solver=adam"]) == 2
    (tmp_path / "mine").write_text("x")
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert "expected one of lm" in capsys.readouterr().err
