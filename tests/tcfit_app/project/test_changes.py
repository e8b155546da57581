"""Changes of corrections: they count as long as the edits stand to which they were fitted."""

import shutil
from pathlib import Path

import pytest

from fitting_core.results.fit_result import FitResult
from tcfit_app.project.project import Project
from tcfit_app.project.storage.changes import Frames
from tests.samples.project_samples import BODY, CONFIG, assert_same_fit, random_edit, sample_clip, sample_fit


def changed(project: Project, fit: FitResult, window: range, seed: int) -> FitResult:
    """Change frames of the run 2 of corrections, which is made if it is missing; the fit with them."""
    seen = project.last_edit
    frames = Frames.of(sample_fit(seed), (window,), seen)

    def change(changes):
        changes.add(frames, seen=seen, edits={seen: True})

    if len(project.runs.all()) == 1:
        parent = project.runs.get(1)
        project.runs.start(
            fit.config, fit=fit, body=BODY, edits_seen=0, kind="corrections", parent=parent.id, change=change
        )
    else:
        project.runs.change(2, change)
    return frames.put_into(fit)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Project.create(tmp_path / "walk.tcfit", sample_clip()).close()
    return tmp_path / "walk.tcfit"


def test_changes_that_a_killed_process_left_are_not_those_of_the_next_run(folder: Path):
    """A kill between the first change of a run of corrections and the run's row leaves the change alone."""
    with Project.open(folder) as project:
        project.runs.start(CONFIG, fit=sample_fit(0), body=BODY, edits_seen=0)
        project.append(random_edit(1))
        changed(project, sample_fit(0), range(0, 3), 1)
        shutil.copytree(folder / "runs" / "000002", folder / "runs" / "000003")
    with Project.open(folder) as project:
        run = project.runs.start(CONFIG, body=BODY, edits_seen=1)
        assert run.id == 3
        project.runs.finish(run.id, sample_fit(2))
        assert_same_fit(project.runs.load(run.id), sample_fit(2))


def test_the_log_says_which_changes_count(folder: Path):
    with Project.open(folder) as project:
        fits = [sample_fit(0)]
        project.runs.start(CONFIG, fit=fits[0], body=BODY, edits_seen=0)
        for number, window in enumerate((range(0, 3), range(2, 5), range(1, 2)), 1):
            project.append(random_edit(number))
            fits.append(changed(project, fits[-1], window, number))
    with Project.open(folder) as project:
        for left in (2, 1, 0):
            project.undo()
            assert_same_fit(project.runs.load(2), fits[left])
            assert project.runs.get(2).edits_seen == left and project.runs.get(2).emptied == (left == 0)
            assert [run.id for run in project.runs.all()] == ([1, 2] if left else [1])
        for left in (1, 2, 3):
            project.redo()
            assert_same_fit(project.runs.load(2), fits[left])
        assert_same_fit(project.runs.load(2, 1), fits[1])
        for _ in range(3):
            project.undo()
        project.append(random_edit(4))
        project.runs.changes(2).forget_undone()
    assert not list((folder / "runs" / "000002").iterdir())
