"""The names of runs."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fitting_core.config.schema import FitConfig
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Given, Run, Source, by_name, named
from tests.samples.project_samples import BODY, CONFIG, sample_clip

Start = Callable[..., Run]


@pytest.fixture
def project(tmp_path: Path):
    with Project.create(tmp_path / "walk.tcfit", sample_clip()) as project:
        yield project


@pytest.fixture
def start(project: Project) -> Start:
    def start(config: FitConfig = CONFIG, **given: Any) -> Run:
        return project.runs.start(config, body=BODY, edits_seen=project.last_edit, **given)

    return start


def smoothing(weight: float, config: FitConfig = CONFIG) -> FitConfig:
    return replace(config, temporal=replace(config.temporal, weight=weight))


def test_whole_fits_are_counted_and_name_what_they_began_with(project: Project, start: Start):
    runs = [start(), start(kind="frames", parent=1, frames=range(2, 4)), start(name="mine"), start()]
    assert [run.name for run in runs] == ["Fit 1", "Frames 9–10 again", "mine", "Fit 3"]
    start(name="GVHMR: walk", kind="imported")
    assert start(given=Given(start=Source(run=5))).name == "Fit 4 from GVHMR: walk"
    assert start(given=Given(start=Source(path="results/walk.npz"))).name == "Fit 5 from walk.npz"
    project.runs.end(1, "cancelled")
    project.runs.delete(1)
    assert project.runs.get(4).name == "Fit 3", "a deleted fit keeps its number, because it can be restored"
    project.runs.rename(4, "better")
    assert (project.runs.get(4).name, project.runs.get(4).own_name) == ("better", "better")


def test_re_runs_say_what_differs(start: Start):
    start(smoothing(100.0))
    frames = {"kind": "frames", "parent": 1, "frames": range(2, 4)}
    window = replace(smoothing(100.0), temporal=replace(smoothing(100.0).temporal, mode="sliding_window"))
    solved = replace(smoothing(30.0), solver="lbfgs", hip_weight=0.3, neck_weight=0.3)
    collision = replace(CONFIG.weights, collision=(0.0, 0.0, 0.0, 0.5, 1.0))
    names = [
        start(smoothing(1000.0), **frames).name,
        start(smoothing(30.0), **frames).name,
        start(window, **frames).name,
        start(solved, **frames).name,
        start(smoothing(100.0), **frames).name,
        start(smoothing(100.0), **frames).name,
        start(smoothing(1000.0), **frames).name,
        start(replace(smoothing(100.0), weights=collision), **frames | {"frames": range(1)}).name,
        start(smoothing(100.0), kind="shape", parent=1).name,
        start(smoothing(100.0), kind="shape", parent=1, given=Given(shape=Source(path="kate.npz"))).name,
    ]
    size = CONFIG.shape_sample.size
    assert names == [
        "Frames 9–10, smoother (w_T 1000)",
        "Frames 9–10, less smooth (w_T 30)",
        "Frames 9–10, mode sliding window",
        "Frames 9–10, 4 settings changed",
        "Frames 9–10 again",
        "Frames 9–10 again 2",
        "Frames 9–10, smoother (w_T 1000) again",
        "Frame 7, collision weight 0, 0, 0, 0.5, 1",
        f"Fit 1, new shape ({size} frames)",
        "Fit 1, a given shape",
    ]
    start()
    assert start(kind="frames", parent=12, frames=range(2, 4)).name == "Frames 9–10 of Fit 2 again"


def test_names_made_by_earlier_versions_count_as_none(project: Project, start: Start):
    start(name="Run 1")
    start(name="Run 1 corrected", kind="corrections", parent=1)
    start(name="Run 2")
    assert [run.name for run in project.runs.all()] == ["Fit 1", "Fit 1 with corrections", "Run 2"]
    assert named(project.runs.all(), "Run 1").id == 1, "as its number"


def test_runs_of_one_name_get_their_number_in_lists(start: Start):
    runs = [start(name="a"), start(name="a"), start(name="b")]
    assert list(by_name(runs)) == ["a (#1)", "a (#2)", "b"]


def test_a_removed_parent_is_said(project: Project, start: Start):
    start()
    frames = start(kind="frames", parent=1, frames=range(2, 4))
    project.runs.end(1, "cancelled")
    project.runs.delete(1)
    project.runs.purge()
    assert project.runs.get(frames.id).name == "Frames 9–10 of a removed fit again"
    assert start().name == "Fit 1"
