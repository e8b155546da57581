"""Each example runs on a small synthetic clip, and prints what it found."""

import runpy
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import viser

from fitting_core.config.schema import PRESETS
from fitting_core.keypoints import INDEX
from tcfit_app.cli import review_command
from tcfit_app.review import panels
from tcfit_app.review.gestures.actions import ACTIONS
from tests.drivers.lone_page import lone_page, sample_project
from tests.samples.posed_clips import CAMERA, clip_of, motion
from tests.test_docs import QUICK, ROOT, filmed

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PRINTED = {
    "fit_video": (["walk.mp4", "walk-fit"], "6 frames, wrote walk-fit/fit.npz"),
    "refit_range": (["walk.mp4", "1", "3", "1000"], "w_T 100 to 1000 in frames 1 to 3"),
    "correct_keypoints": (["walk.mp4", "corrected-fit"], "right_wrist corrected in frames [4], wrote corrected-fit"),
    "compare_smplifyx": (["walk.mp4"], "Jitter, mm/frame²"),
    "read_fit": (["walk-fit/fit.npz"], "the picture shows how the right elbow bends in 100% of the frames"),
}


def run(name: str, arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """As a user runs it from a terminal."""
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="__main__")


def test_examples_are_short_and_all_run_here():
    assert {path.stem for path in EXAMPLES} == {*PRINTED, "own_panel"}
    assert all(20 <= len(path.read_text().splitlines()) <= 50 for path in EXAMPLES)


def test_examples_of_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(PRESETS, "tcfit", QUICK)
    keypoints = clip_of(motion(6), noise=2.0).keypoints
    xy = keypoints.xy.copy()
    xy[4, INDEX["right_wrist"]] += 0.2 * CAMERA.size[1]  # it jumps once
    filmed(tmp_path / "walk.mp4", replace(keypoints, xy=xy), monkeypatch)
    for name, (arguments, expected) in PRINTED.items():
        run(name, arguments, monkeypatch)
        assert expected in capsys.readouterr().out, name


def test_a_panel_of_one_s_own(tmp_path: Path, panel_server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch):
    sample_project(tmp_path / "walk.tcfit", "Fit 1").close()
    shown: list[str] = []

    def review(project, options) -> None:
        with lone_page(panel_server, project) as tested:
            (own,) = [panel for panel in panels.PANELS if panel.title == "Way"]
            tested.only(own)
            tested.draw()
            shown.append(tested.html())
            tested.click("Go there")
            shown.append(f"now in frame {tested.page.tab.state.frame}")

    known = [*panels.PANELS]
    for name in (*ACTIONS, "panel_way"):
        monkeypatch.setitem(ACTIONS, name, ACTIONS.get(name))
    monkeypatch.setattr(review_command, "review", review)
    try:
        run("own_panel", [str(tmp_path / "walk.tcfit")], monkeypatch)
    finally:
        panels.PANELS[:] = known
    fastest = shown[0].split("fastest in frame ")[1].split("<")[0]
    assert "Fit 1" in shown[0] and shown[1] == f"now in frame {fastest}"
