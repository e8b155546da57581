"""A project that an earlier tcfit made opens, is reviewed and exported, with everything that is in it."""

import sqlite3
import zipfile
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import viser

from fitting_core.config.schema import SolverSettings
from fitting_core.keypoints import INDEX
from fitting_core.results.fit_result import FitResult
from tcfit_app.cli.main import main
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.edit_log import Undo
from tcfit_app.project.edits.kinds import MarkBad, SwapSides
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import NAME
from tcfit_app.review.shared.drawing_data import FrameBody
from tests.drivers.lone_page import lone_page
from tests.samples.project_samples import FRAMES, assert_same_fit, random_edit, same_keypoints, sample_fit

PACKED = Path(__file__).parents[2] / "samples" / "projects" / "before-the-first-release.tcfit.zip"
"""Of `sample_clip` with images, five edits of which the last was undone, four runs, of which one was deleted and one
was under way when its process died, and marks. Only ever added to: projects of all versions exist."""
_ARM = ("shoulder", "elbow", "wrist")
FORMATS = ("npz", "fit", "summary", "figures", "openpose", "elan")
"""What depends on how a project was kept, rather than on the body alone."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with zipfile.ZipFile(PACKED) as archive:
        archive.extractall(tmp_path / "walk.tcfit")
    return tmp_path / "walk.tcfit"


@pytest.fixture
def project(folder: Path) -> Iterator[Project]:
    with Project.open(folder) as opened:
        yield opened


def _older(fit: FitResult) -> FitResult:
    """As versions wrote it that knew neither lifter nor ground nor starts from other results nor whose noise keypoints
    have nor silhouettes nor error bars nor the person's size, noted no provenance and started each frame anew."""
    weights = replace(fit.config.weights, relative_position=(0,) * 5, held_position=(0,) * 5)
    settings = {"key_frames_every": 1, "widened_start": True, "start_deviation": None, "settings": SolverSettings()}
    config = replace(fit.config, **settings, weights=weights, keypoint_noise="equal", silhouettes=False)
    phases = tuple(replace(phase, provenance=None, error_bars=None) for phase in fit.phases)
    return replace(fit, phases=phases, config=config, grounding=None, size=None)


def test_all_that_it_holds_is_there(project: Project):
    clip = project.clip
    assert (clip.name, clip.frame_rate, clip.first_frame, len(clip)) == ("walk", 29.97, 7, FRAMES)
    assert clip.notes == ("gap in 3", "größer") and not project.media.problem
    assert clip.detector == ""  # OpenPose's, as all were then
    *edits, undo = [entry.action for entry in project.log]
    expected = [random_edit(seed) for seed in range(5)]
    # Arms were swapped with their shoulders then: what was done stays as it was done.
    arms = tuple(INDEX[f"{side}_{joint}"] for side in ("left", "right") for joint in _ARM)
    expected[3] = SwapSides(frames=expected[3].frames, joints=arms)
    assert edits == expected and undo == Undo(edit=5)
    assert project.corrected.edited.any() and not same_keypoints(clip.keypoints, project.detections)
    assert project.redo() is not None
    marks = project.marks.all()
    assert {frame: mark.state for frame, mark in marks.items()} == {1: "checked", 2: "checked", 4: "flag"}
    assert marks[4].author == "tab 1"


def test_edits_of_removed_kinds_stay_in_the_file_and_are_ignored(folder: Path):
    taken = '{"kind":"take_rotations","frames":[1],"joints":[4],"source":"A","packed":"eJxjYGD4DwABAgEA"}'
    rows = [("2026-01-01T00:00:00+00:00", "a", action) for action in (taken, '{"kind":"undo","edit":7}')]
    with closing(sqlite3.connect(folder / NAME)) as connection, connection:
        connection.executemany("INSERT INTO edits (time, author, action) VALUES (?, ?, ?)", rows)
    for count in (6, 7):
        with Project.open(folder) as project:
            assert len(project.log) == count and not project.damage
            project.append(MarkBad(frames=(1,), joints=(4,)))
            assert not project.standing.stood(7), "it neither stands nor was undone"
    with closing(sqlite3.connect(folder / NAME)) as connection:
        assert connection.execute("SELECT action FROM edits WHERE id = 7").fetchall() == [(taken,)]


def test_its_runs_are_there_and_go_on(project: Project):
    runs = project.runs
    found = [(run.id, run.name, run.kind, run.state, run.parent, run.edits_seen) for run in runs.all()]
    assert found == [
        (2, "fit 1", "fit", "finished", None, 1),
        (3, "fit 1 with corrections", "corrections", "finished", 2, 3),
        (4, "died", "fit", "interrupted", None, 3),
    ]
    assert [run.name for run in runs.all(deleted=True)] == ["fit 0"]
    for number, seed, last_phase in ((1, 0, 1), (2, 1, 3), (3, 2, 1)):
        assert_same_fit(runs.load(number), _older(sample_fit(seed, last_phase=last_phase)))
    runs.undelete(1)
    new = runs.start(runs.get(2).config, body=runs.get(2).body, edits_seen=project.last_edit)
    runs.finish(new.id, sample_fit(3))
    assert new.id == 5 and runs.get(5).moment > runs.get(3).moment


def test_it_is_reviewed(panel_server: viser.ViserServer, project: Project):
    with lone_page(panel_server, project) as tested:
        tab = tested.page.tab
        shown = tab.session.fits.show(FitChoice(run=2))
        assert shown is not None and shown.phase == 3
        assert np.isfinite(tab.data.vertices(FrameBody(shown=shown, frame=0))).all()
        html = tested.html()
        assert "fit 1 with corrections" in html and "interrupted" in html


def test_it_is_exported(folder: Path, tmp_path: Path):
    out = tmp_path / "out"
    arguments = ["export", str(folder), "--out", str(out), "--run", "2", "--formats", *FORMATS]
    assert main(arguments) == 0
    assert len(list(out.iterdir())) == len(FORMATS)
