"""Whatever says that something is saved: files were synced before they got their names, and the names before it says
so; SQLite waits for the disk at the end of every transaction."""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.io.result_files import write_result
from fitting_core.keypoints import Keypoints
from fitting_core.measure.references.files import read_reference
from tcfit_app.cli.main import main
from tcfit_app.project.project import Project
from tcfit_app.project.storage import database
from tests.drivers.syncs import Syncs, recorded_syncs
from tests.samples.media import write_images
from tests.samples.project_samples import BODY, CONFIG, random_edit, sample_clip, sample_fit, sample_keypoints
from tests.samples.waving import waving_fit, waving_project

# --- files ---


def _new(folder: Path, body: BodyModel) -> Path:
    images = write_images(folder / "images", "1.png", "2.png")
    Project.create(folder / "new", replace(sample_clip(), source=images), copy_media=True).close()
    (folder / "new" / "project.lock").unlink()  # both come when it is opened, and hold nothing
    (folder / "new" / "runs").rmdir()
    return folder / "new"


def _run(folder: Path, body: BodyModel) -> Path:
    waving_project(folder / "walk.tcfit", body)
    return folder / "walk.tcfit" / "runs" / "000002.npz"


def _detections(folder: Path, body: BodyModel) -> Path:
    clip, found = sample_clip(), sample_keypoints()
    nothing = Keypoints(xy=found.xy, confidence=np.zeros_like(found.confidence))
    with Project.create(folder / "new", replace(clip, keypoints=nothing)) as project:
        project.take_detections(found)
    return folder / "new" / "detections.npz"


def _reference(folder: Path, body: BodyModel) -> Path:
    points = np.random.default_rng(0).normal(0, 0.2, (20, 4, 3))
    np.savez(folder / "points.npz", points=points, names=np.array(["LShoulder", "RShoulder", "LHip", "RHip"]))
    with Project.create(folder / "new", sample_clip()) as project:
        project.set_reference(read_reference(folder / "points.npz"))
    return folder / "new" / "reference.npz"


def _result(folder: Path, body: BodyModel) -> Path:
    write_result(folder / "out", waving_fit(0.0), sample_clip(), body)
    return folder / "out" / "summary.json"


def _import(folder: Path, body: BodyModel) -> Path:
    write_result(folder / "out", waving_fit(0.0), sample_clip(), body)
    Project.create(folder / "new", sample_clip()).close()
    assert main(["import", str(folder / "new"), str(folder / "out" / "fit.npz")]) == 0
    return folder / "new" / "runs" / "000001.npz"


def _export(kind: str, name: str) -> Callable[[Path, BodyModel], Path]:
    def export(folder: Path, body: BodyModel) -> Path:
        project = waving_project(folder / "walk.tcfit", body)
        assert main(["export", str(project), "--out", str(folder / "out"), "--formats", kind]) == 0
        return folder / "out" / name

    return export


WRITES: dict[str, Callable[[Path, BodyModel], Path]] = {
    "new": _new,
    "a run": _run,
    "detections": _detections,
    "a reference": _reference,
    "the result of a fit": _result,
    "import": _import,
    "export of a file": _export("npz", "walk.smplx.npz"),
    "export of a folder": _export("smplifyx", "walk-smplifyx"),
    "export of keypoints": _export("openpose", "walk-keypoints"),
}


@pytest.fixture
def syncs(monkeypatch: pytest.MonkeyPatch) -> Iterator[Syncs]:
    with recorded_syncs(monkeypatch) as recorded:
        yield recorded


@pytest.mark.parametrize("name", WRITES)
def test_files_are_on_the_disk_when_they_are_said_to_be(name: str, syncs: Syncs, tmp_path: Path, free_body: BodyModel):
    syncs.check(WRITES[name](tmp_path, free_body))


# --- the database ---


CHANGES: dict[str, Callable[[Project], object]] = {
    "edits": lambda project: (project.append(random_edit(1)), project.undo()),
    "marks": lambda project: project.marks.set([1], "flag"),
    "rename": lambda project: project.runs.rename(1, "other"),
    "delete": lambda project: project.runs.delete(1),
    "restore": lambda project: (project.runs.delete(1), project.runs.undelete(1)),
    "purge": lambda project: (project.runs.delete(1), project.runs.purge()),
    "relink": lambda project: project.relink(write_images(project.folder.parent / "other", "1.png")),
}


@contextmanager
def _watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[tuple[str, int]]]:
    """How each transaction is kept: journal and synchronous, as SQLite has them."""
    kept, transaction = [], database._transaction

    @contextmanager
    def noted(connection: sqlite3.Connection) -> Iterator[None]:
        with transaction(connection):
            yield
        pragmas = (connection.execute(f"PRAGMA {name}") for name in ("journal_mode", "synchronous"))
        kept.append(tuple(found.fetchone()[0] for found in pragmas))

    with monkeypatch.context() as patch:
        patch.setattr(database, "_transaction", noted)
        yield kept


DURABLE = ("wal", 2)
"""The log is synced at the end of each transaction."""


@pytest.mark.parametrize("name", CHANGES)
def test_changes_wait_for_the_disk(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with _watched(monkeypatch) as kept:
        with Project.create(tmp_path / "walk.tcfit", sample_clip()) as project:
            project.runs.finish(project.runs.start(CONFIG, body=BODY, edits_seen=0).id, sample_fit(1))
            before = len(kept)
            CHANGES[name](project)
        assert len(kept) > before and set(kept) == {DURABLE}


def test_a_migration_waits_for_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    Project.create(tmp_path / "walk.tcfit", sample_clip()).close()
    with monkeypatch.context() as patch, _watched(monkeypatch) as kept:
        patch.setattr(database, "MIGRATIONS", (*database.MIGRATIONS, lambda connection: None))
        Project.open(tmp_path / "walk.tcfit").close()
        assert kept and set(kept) == {DURABLE}


def test_files_of_runs_are_gone_from_the_disk_before_their_rows(tmp_path: Path, syncs: Syncs):
    with Project.create(tmp_path / "walk.tcfit", sample_clip()) as project:
        project.runs.finish(project.runs.start(CONFIG, body=BODY, edits_seen=0).id, sample_fit(1))
        project.runs.delete(1)
        syncs.events.clear()
        project.runs.purge()
    runs = (tmp_path / "walk.tcfit" / "runs").stat().st_ino
    assert [content[0] for kind, content in syncs.events if kind == "sync"] == [runs]
