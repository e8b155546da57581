"""SIGKILL at random moments of everything that writes, and full disks: nothing acknowledged is lost, nothing
half-written shows under its name, and what was left beside it is gone after the next start."""

import shutil
import sqlite3
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.io.result_files import read_fit, write_result
from tcfit_app.batch import clip_fit
from tcfit_app.batch.manifest import ClipTask, Complaints, read_manifest
from tcfit_app.batch.outcome import done_before
from tcfit_app.cli.main import main, parse
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.imports.results import import_run, project_of_result
from tcfit_app.project.project import Project
from tcfit_app.project.storage import database
from tcfit_app.project.storage.clip_review import reviewed
from tests.drivers.processes import killed_after, needs_fork, succeeded
from tests.samples.batch_clips import CHEAP, write_clip, write_list
from tests.samples.media import write_images
from tests.samples.project_samples import BODY, CONFIG, assert_same_fit, random_edit, sample_clip, sample_fit
from tests.samples.waving import waving_fit, waving_project
from tests.tcfit_app.conftest import FRAMES

pytestmark = [needs_fork, pytest.mark.thorough]
resource = pytest.importorskip("resource", reason="this system has no limits on files")
Report = Callable[[str], None]
EXPORTED = {"npz": "walk.smplx.npz", "bvh": "walk-bvh", "fit": "walk.fit.npz", "openpose": "walk-keypoints"}
LONGEST = 0.4
"""Seconds that a process lives at most: some ten operations."""


@dataclass(frozen=True)
class World:
    """A folder in which everything is written, and what it is written from."""

    folder: Path
    body: BodyModel

    @property
    def sources(self) -> Path:
        """Which nobody writes to."""
        return self.folder / "sources"

    def at(self, kind: str, number: int) -> Path:
        """Where an operation writes that makes something new each time."""
        return self.folder / "made" / f"{kind}-{number}"

    @property
    def walk(self) -> Path:
        """The project that is worked on."""
        return self.folder / "walk.tcfit"

    @property
    def out(self) -> Path:
        """Where exports go, over those of before."""
        return self.folder / "out"


@pytest.fixture
def world(tmp_path: Path, free_body: BodyModel, monkeypatch: pytest.MonkeyPatch) -> World:
    made = World(tmp_path, free_body)
    for folder in (tmp_path / "tmp", tmp_path / "made", made.out, made.sources):
        folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    monkeypatch.setattr(clip_fit, "_body", lambda path: free_body)
    monkeypatch.setattr(clip_fit, "_run_fit", lambda *given: waving_fit(0.0))
    monkeypatch.setattr(clip_fit, "prepare_solver", lambda config, threads: None)
    images = write_images(made.sources / "images", *(f"{n}.png" for n in range(FRAMES)))
    waving_project(made.sources / "waving.tcfit", free_body)
    with Project.open(made.sources / "waving.tcfit") as project:
        project.append(random_edit(1))
        write_result(made.sources / "result", waving_fit(0.0), project.clip, free_body)
    _make_older(made.sources / "waving.tcfit", made.sources / "older.tcfit")
    write_clip(made.sources / "keypoints", free_body, frames=FRAMES)
    Project.create(made.walk, replace(sample_clip(), source=images)).close()
    return made


def _make_older(source: Path, folder: Path) -> None:
    shutil.copytree(source, folder)
    with closing(sqlite3.connect(folder / database.NAME)) as connection, connection:
        later = (("clip", "height"), ("runs", "given"), ("runs", "moment"))
        for table, column in (*later, ("marks", "last_edit"), ("marks", "last_moment")):
            connection.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
        for table in ("review", "views"):
            connection.execute(f"DROP TABLE {table}")
        connection.execute("PRAGMA user_version = 3")


# --- what is done: each does one thing, and says what is to be found afterwards ---


def _new(world: World, number: int) -> None:
    images = world.sources / "images"
    Project.create(world.at("new", number), replace(sample_clip(), source=images), copy_media=True).close()


def _edit(world: World, number: int) -> None:
    with Project.open(world.walk) as project:
        project.append(random_edit(number), author=str(number))


def _run(world: World, number: int) -> None:
    with Project.open(world.walk) as project:
        run = project.runs.start(CONFIG, body=BODY, edits_seen=project.last_edit, name=f"run {number}")
        project.runs.store(run.id, sample_fit(number, last_phase=1))
        project.runs.finish(run.id, sample_fit(number))


def _import(world: World, number: int) -> None:
    with Project.open(world.walk) as project:
        import_run(project, Bodies(), world.sources / "result" / "fit.npz", name=f"import {number}")


def _result(world: World, number: int) -> None:
    project_of_result(world.sources / "result", world.at("result", number))


def _say(world: World, number: int) -> None:
    """Of the clip, as the list does while nobody has it open."""
    with reviewed(world.walk) as review:
        review.set_note(str(number))
        review.approve(str(number))


def _export(world: World, number: int) -> None:
    kind = list(EXPORTED)[number % len(EXPORTED)]
    command = ["export", str(world.sources / "waving.tcfit"), "--out", str(world.out), "--overwrite", "--formats", kind]
    assert main(command) == 0


def _migrate(world: World, number: int) -> None:
    Project.open(_older(world, number)).close()


def _older(world: World, number: int) -> Path:
    """A project of an earlier version, which is whole whenever it shows."""
    folder = world.at("older", number)
    if not folder.exists():
        shutil.copytree(world.sources / "older.tcfit", folder.with_name(f"copy of {folder.name}"), dirs_exist_ok=True)
        folder.with_name(f"copy of {folder.name}").rename(folder)
    return folder


def _fit(world: World, number: int) -> None:
    write_result(world.out / "result", waving_fit(float(number % 5)), sample_clip(), world.body)


def _batch(world: World, number: int) -> None:
    task = _task(world, number)
    outcome = done_before(task) or clip_fit.fit_clip(task)
    assert outcome.state.startswith("done"), outcome.reason


def _task(world: World, number: int) -> ClipTask:
    lists = world.folder / "batch" / str(number)
    clip = {"keypoints": str(world.sources / "keypoints"), "out": str(world.at("batch", number))}
    lists.mkdir(parents=True, exist_ok=True)
    manifest = write_list(lists, [clip])
    options = parse(["batch", str(manifest), *CHEAP])
    (task,) = read_manifest(options, Complaints(manifest))
    return task


DEEDS = {f.__name__[1:]: f for f in (_new, _edit, _run, _import, _result, _say, _export, _migrate, _fit, _batch)}


def _work(world: World, first: int) -> Callable[[Report], None]:
    def work(report: Report) -> None:
        rng = np.random.default_rng(first)
        for number in range(first, first + 1000):
            kind = list(DEEDS)[rng.integers(len(DEEDS))]
            report(f"begun {kind} {number}")
            DEEDS[kind](world, number)
            report(f"done {kind} {number}")

    return work


# --- what is found afterwards ---


def _check(world: World, done: set[tuple[str, int]]) -> None:
    """Whatever shows is whole, and whatever was acknowledged shows."""
    with Project.open(world.walk) as project:
        authors = {entry.author: entry.action for entry in project.log}
        runs = {run.name: run for run in project.runs.all()}
        for kind, number in done:
            if kind == "edit":
                assert authors[str(number)] == random_edit(number)
            elif kind == "run":
                assert_same_fit(project.runs.load(runs[f"run {number}"].id), sample_fit(number))
            elif kind == "say":
                assert int(project.review.now.note) >= number and int(project.review.now.approved_by) >= number
            elif kind == "import":
                assert runs[f"import {number}"].state == "finished"
        assert all(project.runs.load(run.id).phases for run in runs.values() if run.stored)
    for folder in (world.folder / "made").iterdir():
        if not folder.name.startswith((".", "copy")):
            _check_made(world, folder)
    assert all(world.at({"migrate": "older"}.get(kind, kind), number).exists() for kind, number in done if kind in NEW)
    assert all(done_before(_task(world, number)) for kind, number in done if kind == "batch")
    for path in world.out.iterdir():
        _check_written(path)


NEW = ("new", "result", "migrate", "batch")
"""Those that make something of their own each time."""


def _check_made(world: World, folder: Path) -> None:
    kind = folder.name.partition("-")[0]
    if kind == "batch":
        assert not (folder / "fit.npz").exists() or len(read_fit(folder).params) == FRAMES
    else:
        with Project.open(folder) as project:
            assert (len(project.clip) == len(sample_clip()) and not project.media.problem) or kind != "new"
            assert not project.damage
            finished = {"new": 0, "result": 1, "older": 2}[kind]
            assert [project.runs.load(run.id).last.phase for run in project.runs.all()] == [3] * finished


def _check_written(path: Path) -> None:
    if path.name.startswith("."):
        return
    if path.suffix == ".zip":
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None and archive.namelist()
    elif path.suffix == ".npz":
        with np.load(path) as arrays:
            assert all(arrays[name] is not None for name in arrays.files)
    elif path.name == "result":
        assert not (path / "fit.npz").exists() or isinstance(read_fit(path).params.betas.shape, tuple)
    else:
        expected = {"walk-bvh": 2, "walk-keypoints": FRAMES + 1}[path.name]
        assert len([file for file in path.iterdir() if file.stat().st_size]) == expected


def _hidden(world: World) -> Iterator[Path]:
    """What is left of anything that was not finished."""
    yield from (path for path in world.folder.rglob(".*"))
    yield from (world.folder / "tmp").iterdir()


def _killed_often(world: World, rounds: int, seed: int) -> None:
    rng, done, cut_off = np.random.default_rng(seed), set[tuple[str, int]](), set[str]()
    for number in range(rounds):
        lines = [line.split() for line in killed_after(rng.uniform(0, LONGEST), _work(world, 1000 * (number + 1)))]
        done |= {(kind, int(n)) for how, kind, n in lines if how == "done"}
        assert all(how in ("begun", "done") for how, *_ in lines), lines
        _check(world, done)
        how, kind, n = lines[-1]
        if how == "begun":
            cut_off.add(kind)
            _again(world, kind, int(n))
            done.add((kind, int(n)))
            _check(world, done)
        assert not list(_hidden(world)), "the next start leaves nothing"
        shutil.rmtree(world.folder / "made")
        (world.folder / "made").mkdir()
        done = {deed for deed in done if deed[0] not in NEW}
    assert cut_off if rounds < 100 else cut_off == set(DEEDS), "some are killed before their end"


def _again(world: World, kind: str, number: int) -> None:
    """The next start of what was cut off, which may have been through already."""
    if kind in ("new", "result", "unpack") and world.at(kind, number).exists():
        number += 500
    DEEDS[kind](world, number)


def test_killed_at_anything(world: World):
    _killed_often(world, rounds=6, seed=1)


@pytest.mark.slow
def test_killed_two_hundred_times(world: World):
    _killed_often(world, rounds=200, seed=2)


# --- full disks ---


def _on_a_full_disk(world: World, kind: str, number: int, most: int) -> bool:
    """Whether it could be done where no file may have more bytes, or else was refused in words."""

    def work(report: Report) -> None:
        if kind == "migrate":
            _older(world, number)
        elif kind == "batch":
            _task(world, number)  # its list is the user's
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
        try:
            DEEDS[kind](world, number)
            report("done")
        except InputError as error:
            report("refused" if "cannot" in str(error) else f"refused without a word of why: {error}")
        except AssertionError:  # a command, which has said it itself
            report("refused")

    (found,) = succeeded(work)
    assert found in ("done", "refused"), (kind, most, found)
    return found == "done"


def _full_often(world: World, rounds: int, seed: int) -> None:
    rng, done, refused = np.random.default_rng(seed), set[tuple[str, int]](), set[str]()
    for number in range(rounds):
        kind, most = list(DEEDS)[rng.integers(len(DEEDS))], int(2 ** rng.uniform(0, 19))
        if _on_a_full_disk(world, kind, number, most):
            done.add((kind, number))
        else:
            refused.add(kind)
            assert not list(_hidden(world)), (kind, most, list(_hidden(world)))
        _check(world, done)
        if (kind, number) not in done:
            _again(world, kind, number)
            done.add((kind, number))
    _check(world, done)
    assert refused if rounds < 100 else refused == set(DEEDS)


def test_full_disks(world: World):
    _full_often(world, rounds=10, seed=3)


@pytest.mark.slow
def test_two_hundred_full_disks(world: World):
    _full_often(world, rounds=200, seed=4)
