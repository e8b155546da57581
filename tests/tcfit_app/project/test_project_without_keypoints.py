"""Projects that are made of a video alone, and get their keypoints later."""

import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, Keypoints
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.project.edits.kinds import SWAPPABLE, MoveKeypoint, SwapSides
from tcfit_app.project.project import Project
from tcfit_app.project.storage import clip as clip_storage
from tcfit_app.project.storage.database import Database
from tcfit_app.review.session.session import Session
from tests.drivers.processes import killed_after, needs_fork
from tests.samples.project_samples import FRAMES, same_keypoints, sample_clip, sample_keypoints


def empty_clip() -> Clip:
    nothing = Keypoints(xy=np.zeros((FRAMES, COUNT, 2)), confidence=np.zeros((FRAMES, COUNT)))
    return replace(sample_clip(), keypoints=nothing)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Project.create(tmp_path / "walk.tcfit", empty_clip()).close()
    return tmp_path / "walk.tcfit"


def test_nothing_is_corrected_before_there_is_something(folder: Path):
    with Project.open(folder) as project:
        session = Session(project, Bodies())
        with pytest.raises(InputError, match="no keypoints yet: detect them first"):
            session.edit(SwapSides(frames=(0,), joints=SWAPPABLE["arms"]), author="test")
        session.close()
        assert not project.log


def test_a_project_takes_its_keypoints_once(folder: Path):
    found = sample_keypoints(seed=3)
    with Project.open(folder) as project:
        assert not project.has_detections
        project.take_detections(found, ("Person: found.",), detector="mediapipe")
        assert project.clip.detector == "mediapipe"
        assert project.has_detections and same_keypoints(project.detections, found)
        assert same_keypoints(project.clip.keypoints, found) and project.clip.notes[-1] == "Person: found."
        with pytest.raises(InputError, match="already has keypoints"):
            project.take_detections(sample_keypoints(seed=4))
        with pytest.raises(ValueError, match="read-only"):
            project.detections.xy[:] = 0
    with Project.open(folder) as project:
        assert same_keypoints(project.detections, found) and project.clip.notes == (
            *empty_clip().notes,
            "Person: found.",
        )
        assert project.clip.detector == "mediapipe"
    assert sorted(p.name for p in folder.iterdir() if p.suffix == ".npz") == ["detections.npz"]


def test_keypoints_placed_by_hand_before_stay(folder: Path):
    found = sample_keypoints(seed=3)
    with Project.open(folder) as project:
        project.append(MoveKeypoint(frames=(2,), joints=(4,), xy=(((10.0, 20.0),),)))
        project.take_detections(found)
        assert project.clip.keypoints.xy[2, 4].tolist() == [10, 20]
        project.undo()
        assert same_keypoints(project.clip.keypoints, found)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (sample_keypoints(FRAMES - 1), f"keypoints of {FRAMES - 1} frames; expected {FRAMES}"),
        (empty_clip().keypoints, "No keypoints were found in any"),
    ],
)
def test_keypoints_that_do_not_fit_the_clip(folder: Path, found: Keypoints, words: str):
    with Project.open(folder) as project:
        with pytest.raises(InputError, match=words):
            project.take_detections(found)
        assert not project.has_detections
    with Project.open(folder, read_only=True) as project, pytest.raises(InputError, match="read-only"):
        project.take_detections(sample_keypoints())


def _die(*_: object, **__: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


DEATHS = {
    "while the file is written": ("_write_detections", _die, False),
    "before the transaction": ("_sha256", _die, False),
    "before the file takes its place": ("os", None, True),
}


@needs_fork
@pytest.mark.parametrize(("name", "death", "taken"), DEATHS.values(), ids=DEATHS)
def test_a_process_that_dies_leaves_all_or_nothing(folder: Path, name: str, death: Any, taken: bool):
    found = sample_keypoints(seed=5)

    def work(report: Any) -> None:
        project = Project.open(folder)
        report("opened")
        with pytest.MonkeyPatch.context() as patched:
            if name == "os":
                patched.setattr(
                    os, "replace", lambda a, b: _die() if b.name == clip_storage.DETECTIONS else os.rename(a, b)
                )
            else:
                patched.setattr(clip_storage, name, death)
            project.take_detections(found, ("new",))

    assert killed_after(10, work) == ["opened"]
    with Project.open(folder, read_only=True) as project:
        assert project.has_detections == taken
    with Project.open(folder) as project:
        assert project.has_detections == taken and ("new" in project.clip.notes) == taken
        assert not taken or same_keypoints(project.detections, found)
    assert [p.name for p in folder.glob("detections*")] == ["detections.npz"]


def test_new_detections_that_cannot_get_their_name_count(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """They are on the disk and in the database: to say that the old ones are still there would be wrong."""

    def refused(*_: object) -> None:
        raise OSError(5, "Input/output error")

    found = sample_keypoints(seed=3)
    with monkeypatch.context() as patched, Project.open(folder) as project:
        replace_file = os.replace
        patched.setattr(os, "replace", lambda a, b: refused() if b.name == "detections.npz" else replace_file(a, b))
        project.take_detections(found, ("new",))
        assert project.has_detections and same_keypoints(project.clip.keypoints, found)
        project.append(MoveKeypoint(frames=(2,), joints=(4,), xy=(((10.0, 20.0),),)))
        project.close()
        with Project.open(folder) as again:
            assert again.clip.keypoints.xy[2, 4].tolist() == [10, 20] and again.clip.notes[-1] == "new"
    with Project.open(folder) as project:
        assert same_keypoints(project.detections, found)
    assert [p.name for p in folder.glob("detections*")] == ["detections.npz"]


def test_a_full_disk_leaves_the_project_as_it_was(folder: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with Project.open(folder) as project:
        monkeypatch.setattr(clip_storage, "_write_detections", full)
        with pytest.raises(InputError, match="No space left"):
            project.take_detections(sample_keypoints())
        monkeypatch.undo()
        assert not project.has_detections
        monkeypatch.setattr(Database, "transaction", full)
        with pytest.raises(InputError):
            project.take_detections(sample_keypoints())
        monkeypatch.undo()
        project.take_detections(sample_keypoints())
    with Project.open(folder) as project:
        assert same_keypoints(project.detections, sample_keypoints())
