"""Processes that die or are refused at any moment: what was reported as saved is there, and the project opens."""

import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting_core.errors import InputError
from tcfit_app.project.edits.edit_log import EditHistory, Redo, Undo
from tcfit_app.project.project import Project
from tcfit_app.project.storage.runs import Runs
from tests.drivers.processes import killed_after, needs_fork, succeeded
from tests.samples.project_samples import (
    BODY,
    CONFIG,
    applied,
    assert_same_fit,
    random_edit,
    same_keypoints,
    sample_clip,
    sample_fit,
)

pytestmark = needs_fork
resource = pytest.importorskip("resource", reason="this system has no limits on files")
Report = Callable[[str], None]


def _work_on(folder: Path, seed: int) -> Callable[[Report], None]:
    """Opens a project and goes on editing and fitting, reporting what is done: "edit id seed", "run id seed"."""

    def work(report: Report) -> None:
        rng = np.random.default_rng(seed)
        project = Project.open(folder)
        report("opened")
        while True:
            chance, number = rng.random(), int(rng.integers(1 << 30))
            if chance < 0.7:
                report(f"edit {project.append(random_edit(number)).id} {number}")
            elif chance < 0.8 and project.undo():
                report(f"undo {project.last_edit} 0")
            elif chance < 0.85 and project.redo():
                report(f"redo {project.last_edit} 0")
            else:
                run = project.runs.start(CONFIG, body=BODY, edits_seen=project.last_edit)
                project.runs.store(run.id, sample_fit(number, last_phase=1))
                project.runs.finish(run.id, sample_fit(number))
                report(f"run {run.id} {number}")

    return work


def _check(folder: Path, reported: list[str], before: int) -> int:
    """Everything that was reported is there, at most one edit more is, and nothing is half done.

    Args:
        folder: The project.
        reported: What all processes so far said to have saved.
        before: How many entries the log had before the last of them.

    Returns:
        How many it has now.
    """
    with Project.open(folder) as project:
        log = {entry.id: entry.action for entry in project.log}
        assert list(log) == list(range(1, len(log) + 1)), "no gap"
        last = 0
        for kind, number, seed in (line.split() for line in reported if line != "opened"):
            if kind == "run":
                assert project.runs.get(int(number)).state == "finished"
                assert_same_fit(project.runs.load(int(number)), sample_fit(int(seed)))
                continue
            last = int(number)
            kinds = {"undo": Undo, "redo": Redo}
            assert isinstance(log[last], kinds[kind]) if kind in kinds else log[last] == random_edit(int(seed))
        assert len(log) <= max(last, before) + 1
        assert same_keypoints(project.clip.keypoints, applied(project.detections, project.log))
        assert same_keypoints(project.detections, sample_clip().keypoints)
        for run in project.runs.all():
            assert run.state in ("finished", "interrupted")
            assert not run.stored or project.runs.load(run.id).phases
        assert not list(folder.rglob("*.partial*")) and not (folder / "runs" / "orphans").exists()
        return len(log)


def _kill_often(folder: Path, rounds: int, seed: int) -> None:
    Project.create(folder, sample_clip()).close()
    rng, reported, length = np.random.default_rng(seed), [], 0
    for number in range(rounds):
        lines = killed_after(rng.uniform(0, 0.15), _work_on(folder, 1000 * seed + number))
        assert lines[:1] == ["opened"], "opens without repair, and the dead process holds no lock"
        reported += lines
        length = _check(folder, reported, length)
    done = {line.split()[0] for line in reported}
    assert done >= {"edit", "run"}, "no process lived long enough to do anything"


@pytest.mark.thorough
def test_what_was_saved_survives_a_kill(tmp_path: Path):
    _kill_often(tmp_path / "walk.tcfit", rounds=10, seed=1)


@pytest.mark.slow
def test_what_was_saved_survives_fifty_kills(tmp_path: Path):
    _kill_often(tmp_path / "walk.tcfit", rounds=50, seed=2)


def _die(*_: object, **__: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _half_written(draft: Path, **_: object) -> None:
    draft.write_bytes(b"half")
    _die()


DEATHS = {
    "while the result is written": (np, "savez", _half_written, 2),
    "between file and database": (Runs, "_update", _die, 3),
}


@pytest.mark.parametrize(("owner", "name", "death", "phase"), DEATHS.values(), ids=DEATHS)
def test_a_run_keeps_what_it_had_stored(owner: Any, name: str, death: Any, phase: int, tmp_path: Path):
    folder = tmp_path / "walk.tcfit"
    Project.create(folder, sample_clip()).close()

    def work(report: Report) -> None:
        project = Project.open(folder)
        run = project.runs.start(CONFIG, body=BODY, edits_seen=0)
        project.runs.store(run.id, sample_fit(4, last_phase=2))
        setattr(owner, name, death)
        report("stored")
        project.runs.finish(run.id, sample_fit(4))

    assert killed_after(10, work) == ["stored"]
    _check(folder, [], 0)
    with Project.open(folder) as project:
        assert project.runs.get(1).state == "interrupted"
        assert_same_fit(project.runs.load(1), sample_fit(4, last_phase=phase))


def test_an_edit_is_stored_before_it_shows(tmp_path: Path):
    folder = tmp_path / "walk.tcfit"
    Project.create(folder, sample_clip()).close()

    def work(report: Report) -> None:
        project = Project.open(folder)
        EditHistory.add = _die
        report("opened")
        project.append(random_edit(1))

    assert killed_after(10, work) == ["opened"]
    with Project.open(folder) as project:
        assert [entry.action for entry in project.log] == [random_edit(1)]


def test_a_project_is_there_whole_or_not_at_all(tmp_path: Path):
    """Killed while it is made; the next attempt succeeds, or finds it made."""
    video = tmp_path / "walk.mp4"
    video.write_bytes(bytes(3_000_000))
    rng, made = np.random.default_rng(0), 0
    for number in range(10):
        folder = tmp_path / "projects" / str(number)

        def work(report: Report, folder: Path = folder) -> None:
            report("begun")
            clip = sample_clip()
            Project.create(folder, replace(clip, source=video), copy_media=True)
            report("made")
            signal.pause()

        reported = killed_after(rng.uniform(0, 0.06), work)
        if folder.exists():
            made += 1
        else:
            assert "made" not in reported
            Project.create(folder, sample_clip()).close()
        _check(folder, [], 0)
    assert sorted(p.name for p in (tmp_path / "projects").iterdir()) == sorted(map(str, range(10)))


def test_a_full_disk_is_reported_and_loses_nothing(tmp_path: Path):
    folder = tmp_path / "walk.tcfit"
    with Project.create(folder, sample_clip()) as project:
        project.append(random_edit(0))

    def starved(report: Report) -> None:
        project = Project.open(folder)
        run = project.runs.start(CONFIG, body=BODY, edits_seen=0)
        size = max(p.stat().st_size for p in folder.rglob("*") if p.is_file())
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 20_000, size + 20_000))
        for seed in range(1, 500):
            before, length = project.clip.keypoints, len(project.log)
            try:
                project.append(random_edit(seed))
            except InputError as error:
                assert same_keypoints(project.clip.keypoints, before) and len(project.log) == length
                report(f"{length} {error}")
                break
        with pytest.raises(InputError, match=r"runs/.*cannot be read or written") as refused:
            project.runs.finish(run.id, sample_fit(0, frames=500))
        report(str(refused.value))
        assert project.runs.get(run.id).state == "running" and not list(folder.rglob("*.partial*"))

    full, unwritten = succeeded(starved)
    length = int(full.split()[0])
    assert "project.sqlite: cannot be written" in full and "Free space" in full and "Free space" in unwritten
    with Project.open(folder) as project:
        assert len(project.log) == length > 1
        project.append(random_edit(1))


@pytest.fixture
def public_folder() -> Iterator[Path]:
    """A folder in which everybody may write, and which everybody may reach."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o777)
    yield folder
    for path in [folder, *folder.rglob("*")]:
        if path.is_dir():
            path.chmod(0o777)
    shutil.rmtree(folder)


def _as_nobody() -> None:
    """Root may write everywhere; nobody else may."""
    if os.geteuid() == 0:
        os.setgid(65534)
        os.setuid(65534)


def test_what_may_not_be_written_is_reported(public_folder: Path):
    folder = public_folder / "walk.tcfit"

    def work(report: Report) -> None:
        _as_nobody()
        with Project.create(folder, sample_clip()) as project:
            project.append(random_edit(1))
            project.runs.finish(project.runs.start(CONFIG, body=BODY, edits_seen=1).id, sample_fit(1))
        for path in (folder / "runs", folder):
            path.chmod(0o555)
        (folder / "project.sqlite").chmod(0o444)
        (folder / "project.lock").chmod(0o444)
        with pytest.raises(InputError, match=r"walk\.tcfit: cannot be read or written \(Permission denied\)"):
            Project.open(folder)
        with Project.open(folder, read_only=True) as project:
            assert len(project.log) == 1
            assert_same_fit(project.runs.load(1), sample_fit(1))
        assert sorted(p.name for p in folder.iterdir()) == ["detections.npz", "project.lock", "project.sqlite", "runs"]
        with pytest.raises(InputError, match="Permission denied"):
            Project.create(folder / "runs" / "inner", sample_clip())
        folder.chmod(0)
        for read_only in (False, True):
            with pytest.raises(InputError, match="Permission denied"):
                Project.open(folder, read_only=read_only)
        report("done")

    assert succeeded(work) == ["done"]


def test_a_file_in_the_place_of_a_folder_is_reported(tmp_path: Path):
    (tmp_path / "file").touch()
    for call in (Project.open, lambda folder: Project.create(folder, sample_clip())):
        with pytest.raises(InputError, match="file"):
            call(tmp_path / "file" / "walk.tcfit")
