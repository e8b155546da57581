"""The runs of a project: from start to end, their names, what comes back of a fit, and the files beside their rows."""

import io
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.errors import InputError
from fitting_core.results.given_start import GivenStart, StartRecord
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_files import read_run, write_run
from tcfit_app.project.storage.run_record import Given, Run, Source, by_name, named
from tests.samples.project_samples import BODY, CONFIG, FRAMES, assert_same_fit, random_edit, sample_clip, sample_fit


def started(project: Project, name: str = "") -> Run:
    return project.runs.start(CONFIG, body=BODY, edits_seen=project.last_edit, name=name)


def again(project: Project) -> Project:
    """The project, closed and opened."""
    project.close()
    return Project.open(project.folder)


def test_a_run_from_start_to_end(project: Project):
    project.append(random_edit(0))
    config = replace(PRESETS["paper"], hand_components=45, robust_at_height=None, pose_prior="/gone/vposer")
    first = project.runs.start(config, body=BODY, edits_seen=1)
    assert (first.name, first.state, first.ended, first.stored) == ("Fit 1", "running", None, False)
    fit = replace(sample_fit(3, components=45), config=config)
    first = project.runs.finish(first.id, fit, summary={"jitter": {"phase3": 1.5}, "lost": None})
    window = project.runs.start(
        CONFIG, body=BODY, edits_seen=1, parent=first.id, frames=range(2, 4), name=" elbow fixed "
    )
    with again(project) as project:
        assert [run.id for run in project.runs.all()] == [1, 2]
        found = project.runs.get(1)
        assert found == first and found.config == config and found.body == BODY and found.edits_seen == 1
        assert found.state == "finished" and found.stored and found.ended and found.ended >= found.started
        assert found.summary == {"jitter": {"phase3": 1.5}, "lost": None} and found.frames is None
        assert_same_fit(project.runs.load(1), fit)
        assert (window.name, window.parent, window.frames) == ("elbow fixed", 1, range(2, 4))
        assert project.runs.get(2).frames == range(2, 4)
        with pytest.raises(InputError, match="There is no run 3"):
            project.runs.load(3)
        with pytest.raises(InputError, match="There is no run 9"):
            project.runs.start(CONFIG, body=BODY, edits_seen=0, parent=9)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("last_phase", [1, 2, 3])
def test_every_phase_comes_back_to_the_last_bit(last_phase: int, dtype: torch.dtype, tmp_path: Path):
    fit = sample_fit(5, last_phase=last_phase)
    phases = tuple(replace(p, params=p.params.to(dtype=dtype)) for p in fit.phases)
    shared = replace(phases[-1].params, betas=phases[-1].params.betas[:1].expand(FRAMES, -1))
    fit = replace(fit, phases=(*phases[:-1], replace(phases[-1], params=shared)))
    write_run(tmp_path / "1.npz", fit)
    assert_same_fit(read_run(tmp_path / "1.npz", CONFIG), fit)
    assert [p.name for p in tmp_path.iterdir()] == ["1.npz"]


def test_what_a_fit_began_with_comes_back(tmp_path: Path):
    about = StartRecord(
        source="wham_output.pkl",
        format="WHAM result",
        person=3,
        frames=2,
        clip_frames=FRAMES,
        focal=(900.0, 900.0),
        focal_source="WHAM's",
        off=0.04,
        notes=("It has 2 people.",),
    )
    params = replace(
        sample_fit(4).last.params, left_hand_pose=torch.ones(FRAMES, 45), right_hand_pose=torch.zeros(FRAMES, 45)
    )
    rng = np.random.default_rng(0)
    points = rng.normal(size=(FRAMES, 25, 3))
    points[0, 3] = np.nan
    start = GivenStart(
        params=params, there=rng.random(FRAMES) > 0.5, points=points, off=rng.random((FRAMES, 25)), about=about
    )
    write_run(tmp_path / "1.npz", replace(sample_fit(1), start=start))
    found = read_run(tmp_path / "1.npz", CONFIG).start
    assert found is not None and found.about == about
    for name in ("there", "points", "off"):
        np.testing.assert_array_equal(getattr(found, name), getattr(start, name))
    for name, value in vars(start.params).items():
        assert torch.equal(getattr(found.params, name), value)
    arrays = dict(np.load(tmp_path / "1.npz", allow_pickle=False))
    np.savez(tmp_path / "3.npz", allow_pickle=False, **(arrays | {"start_points": points[1:]}))
    with pytest.raises(InputError, match="start_points has the shape"):
        read_run(tmp_path / "3.npz", CONFIG)
    write_run(tmp_path / "2.npz", sample_fit(1))
    assert read_run(tmp_path / "2.npz", CONFIG).start is None


def test_a_run_of_an_earlier_version_opens(tmp_path: Path):
    """It tells nothing of where frames came from nor of the ground, and has a number that nothing reads any more."""
    fit = sample_fit(1)
    before = replace(fit, phases=tuple(replace(p, provenance=None) for p in fit.phases), grounding=None, size=None)
    write_run(tmp_path / "1.npz", before)
    arrays = dict(np.load(tmp_path / "1.npz", allow_pickle=False))
    assert not [name for name in arrays if name.endswith(("start", "stopped"))] and "gravity" not in arrays
    arrays["about"] = np.array(str(arrays["about"])[:-1] + ',"sharpness":1.0}')
    np.savez(tmp_path / "2.npz", allow_pickle=False, **arrays)
    assert_same_fit(read_run(tmp_path / "2.npz", CONFIG), before)
    # A given height was then the fit's own from the beginning, beside the 1.71 m of the lifter's people.
    assert read_run(tmp_path / "2.npz", replace(CONFIG, height=180.0)).size == pytest.approx(1.80 / 1.71)


def test_phases_are_kept_while_a_run_goes_on(project: Project):
    run = started(project)
    for last in (1, 2):
        project.runs.store(run.id, sample_fit(0, last_phase=last))
        assert_same_fit(project.runs.load(run.id), sample_fit(0, last_phase=last))
    assert project.runs.get(run.id).state == "running"
    ended = project.runs.end(run.id, "failed", "no\nmemory \udc80")
    assert (ended.state, ended.message, ended.stored) == ("failed", "no\nmemory ?", True)
    with again(project) as project:
        assert project.runs.get(run.id) == ended and project.runs.load(run.id).last.phase == 2


def test_only_what_runs_can_end_and_only_what_has_ended_can_go(project: Project):
    run = started(project)
    with pytest.raises(InputError, match="Fit 1 is running; cancel it first"):
        project.runs.delete(run.id)
    project.runs.end(run.id, "cancelled")
    for call in (lambda: project.runs.finish(run.id, sample_fit(0)), lambda: project.runs.end(run.id, "failed")):
        with pytest.raises(InputError, match="Fit 1 is cancelled; expected running"):
            call()
    with pytest.raises(InputError, match=r"000001\.npz: is missing; expected the result of a run"):
        project.runs.load(run.id)


def test_deleted_runs_can_come_back_until_they_are_purged(project: Project):
    for seed in (1, 2):
        project.runs.finish(started(project).id, sample_fit(seed))
    project.runs.delete(1)
    assert [r.id for r in project.runs.all()] == [2] and [r.id for r in project.runs.all(deleted=True)] == [1]
    project.runs.undelete(1)
    assert [r.id for r in project.runs.all()] == [1, 2]
    project.runs.delete(2)
    assert project.runs.purge() == [2] and project.runs.purge() == []
    assert [p.name for p in (project.folder / "runs").iterdir()] == ["000001.npz"]
    with again(project) as project:
        assert [r.id for r in project.runs.all()] == [1] and project.runs.all(deleted=True) == []
        assert started(project).id == 3, "numbers are not used twice"


def test_opening_tidies_up_after_a_process_that_died(project: Project):
    folder = project.folder / "runs"
    for seed in (1, 2, 3):
        started(project)
        project.runs.store(seed, sample_fit(seed, last_phase=2))
    (folder / "000002.npz").unlink()
    project.runs.finish(3, sample_fit(3))
    project.close()
    for left in (folder / ".000003.npz.partial", project.folder / ".detections.npz.partial"):
        left.mkdir()
        for name in ("tcfit-draft.lock", left.stem[1:]):
            (left / name).write_bytes(b"half")
    (folder / "000044.npz").write_bytes(b"half")
    with Project.open(project.folder, read_only=True) as reader:
        assert reader.runs.get(1).state == "running", "somebody may be writing it"
    with Project.open(project.folder) as project:
        assert [(r.state, r.stored) for r in project.runs.all()] == [
            ("interrupted", True), ("interrupted", False), ("finished", True),
        ]  # fmt: skip
        assert_same_fit(project.runs.load(1), sample_fit(1, last_phase=2))
        assert_same_fit(project.runs.load(3), sample_fit(3))
        left = sorted(p.name for p in folder.iterdir())
        assert left == ["000001.npz", "000003.npz", "orphans"], "what was no draft is set aside, not deleted"
        assert [p.read_bytes() for p in (folder / "orphans").iterdir()] == [b"half"]
        assert not list(project.folder.glob(".*"))


def _flipped(content: bytes) -> bytes:
    """With another bit in the middle of its largest array."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        largest = max(archive.infolist(), key=lambda member: member.compress_size)
    at = largest.header_offset + largest.compress_size // 2
    return content[:at] + bytes([content[at] ^ 4]) + content[at + 1 :]


BROKEN = {
    "cut off": lambda content: content[: len(content) // 2],
    "empty": lambda content: b"",
    "text": lambda content: b"hello" * 100,
    "a flipped bit": _flipped,
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_reported(name: str, project: Project):
    project.runs.finish(started(project).id, sample_fit(1))
    path = project.folder / "runs" / "000001.npz"
    path.write_bytes(BROKEN[name](path.read_bytes()))
    with pytest.raises(InputError, match=r"000001\.npz: not a complete result of a run"):
        project.runs.load(1)


def test_a_file_of_wrong_content_is_reported(tmp_path: Path):
    write_run(tmp_path / "a.npz", sample_fit(1))
    with np.load(tmp_path / "a.npz") as archive:
        arrays = dict(archive)
    changes = {
        "phase2_betas": (arrays["phase2_betas"][:, :9], "not a complete result"),
        "observed": (arrays["observed"][:3], "not a complete result"),
        "phase3_objective": (np.ones(7), "not a complete result"),
        "about": (np.array(str(arrays["about"]).replace("run 1", "run 2")), "not a complete result"),
        "phase3_start": (arrays["phase3_start"][1:], "phase3_start has the shape"),
        "contacts": (np.ones((2, 2), bool), "contacts has the shape"),
        "gravity": (np.zeros(3), "expected a unit vector"),
    }
    for name, (value, said) in changes.items():
        np.savez(tmp_path / "b.npz", **(arrays | {name: value}))
        with pytest.raises(InputError, match=said):
            read_run(tmp_path / "b.npz", CONFIG)
    del arrays["phase1_jaw_pose"]
    np.savez(tmp_path / "b.npz", **arrays)
    with pytest.raises(InputError, match="phase1_jaw_pose"):
        read_run(tmp_path / "b.npz", CONFIG)


# --- names ---


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
