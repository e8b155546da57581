"""The rows of a list: what they say, and that they follow the disk."""

import json
import resource
import shutil
import time
from dataclasses import replace
from pathlib import Path

import pytest

from fitting_core.body.model import BodyModel
from tcfit_app.fitting.process_queue import Work
from tcfit_app.home.catalogue import Catalogue, busy
from tcfit_app.home.messages import Row
from tcfit_app.home.pictures import picture_of
from tcfit_app.project.picture import NAME
from tcfit_app.project.project import Project
from tcfit_app.project.storage.clip_review import reviewed
from tcfit_app.project.storage.lock import Holder
from tests.samples.media import write_video
from tests.samples.people_projects import two_people
from tests.samples.project_samples import sample_clip
from tests.tcfit_app.conftest import FinishedRun
from tests.tcfit_app.home.lists import folder_of_clips


@pytest.fixture
def root(tmp_path: Path, free_body: BodyModel) -> Path:
    return folder_of_clips(tmp_path / "corpus", free_body)


def by_place(rows: list[Row]) -> dict[str, Row]:
    return {row.place: row for row in rows}


def test_rows_say_what_projects_hold(root: Path):
    changed, gone = Catalogue(root).refresh()
    rows = by_place(changed)
    assert list(rows) == ["a new.tcfit", "set/b fitted.tcfit", "set/c reviewed.tcfit", "set/d approved.tcfit"]
    assert [row.state for row in rows.values()] == ["new", "fitted", "in review", "approved"] and gone == []
    last = rows["set/d approved.tcfit"]
    assert (last.reviewer, last.note, last.score, last.left) == ("bert", "good hands", 0.0, 0)
    reviewed = rows["set/c reviewed.tcfit"]
    assert (reviewed.frame, reviewed.words) == (10, "left wrist is 42 px off")
    assert rows["set/b fitted.tcfit"].score is None


def test_only_what_changes_is_read_again(root: Path, monkeypatch: pytest.MonkeyPatch):
    catalogue = Catalogue(root)
    catalogue.refresh()
    assert catalogue.refresh() == ([], [])
    with reviewed(root / "a new.tcfit") as review:
        review.set_note("blurred")
    changed, gone = catalogue.refresh()
    assert [(row.name, row.note) for row in changed] == [("a new", "blurred")] and gone == []
    key = changed[0].key
    shutil.rmtree(root / "a new.tcfit")
    assert catalogue.refresh() == ([], [key]) and catalogue.get(key) is None


def test_who_has_a_project_open_is_shown(root: Path):
    catalogue = Catalogue(root)
    catalogue.refresh()
    with Project.open(root / "a new.tcfit") as project:
        project.tell_who_works("anna")
        assert [row.busy for row in catalogue.refresh()[0]] == ["anna"]
    assert [row.busy for row in catalogue.refresh()[0]] == [""]
    assert busy(Holder(process="1", computer="lab-3")) == "another tcfit (process 1 on lab-3)"


def test_what_is_done_in_the_background_is_shown(root: Path):
    work: dict[str, Work] = {}
    catalogue = Catalogue(root, work.get)
    catalogue.refresh()
    key = catalogue.rows()[0].key
    work[key] = Work(step="Phase 1 of 3", share=0.5)
    assert [row.work for row in catalogue.refresh_some([key])] == [work[key]]
    assert catalogue.refresh_some([key, "000000000000"]) == []


def test_videos_are_listed_until_they_have_a_project(tmp_path: Path):
    root = tmp_path / "corpus"
    root.mkdir()
    video = write_video(root / "walk.mp4", frames=6)
    catalogue = Catalogue(root)
    rows, _ = catalogue.refresh()
    assert [(row.kind, row.name, row.frames) for row in rows] == [("video", "walk", 0)]
    entry = catalogue.get(rows[0].key)
    assert entry is not None and picture_of(entry, catalogue).startswith(b"\xff\xd8")
    assert [row.frames for row in catalogue.refresh_some([rows[0].key])] == [6]
    Project.create(root / "walk.tcfit", replace(sample_clip(), source=video)).close()
    rows, gone = catalogue.refresh()
    assert [row.kind for row in rows] == ["project"] and gone == [entry.found.key]


def test_a_clip_is_listed_as_its_result_until_it_has_a_project(tmp_path: Path):
    folder = tmp_path / "fits" / "c000"
    folder.mkdir(parents=True)
    (folder / "fit.npz").write_bytes(b"x")
    (tmp_path / "walk.mp4").write_bytes(b"x")
    summary = {
        "frames": 90,
        "frame_rate": 30.0,
        "reprojection_px": {"phase1": {"median": 9.0}, "phase3": {"median": 2.5}},
        "video": "../../walk.mp4",
    }
    (folder / "summary.json").write_text(json.dumps(summary))
    catalogue = Catalogue(tmp_path)
    (row,) = catalogue.refresh()[0]
    assert (row.kind, row.state, row.frames, row.seconds, row.off) == ("result", "fitted", 90, 3.0, {"all": 2.5})
    (folder / "summary.json").write_text("{")
    result, video = catalogue.refresh()[0]
    assert "cannot be read" in result.problem and video.kind == "video"
    (folder / "summary.json").write_text(json.dumps(summary))
    Project.create(tmp_path / "fits" / "c000.tcfit", sample_clip()).close()
    assert row.key in catalogue.refresh()[1]
    assert sorted(row.kind for row in catalogue.rows()) == ["project", "video"], "it has no video"


def test_a_result_has_a_picture_of_its_keypoints(tmp_path: Path, finished: FinishedRun):
    folder = Path(shutil.copytree(finished.folder, tmp_path / "wave"))
    catalogue = Catalogue(tmp_path)
    (row,) = catalogue.refresh()[0]
    entry = catalogue.get(row.key)
    assert entry is not None and picture_of(entry, catalogue).startswith(b"\xff\xd8")
    assert sorted(path.name for path in folder.iterdir()) == sorted(path.name for path in finished.folder.iterdir())


def test_the_people_of_a_clip_are_named_and_grouped(tmp_path: Path, free_body: BodyModel):
    two_people(tmp_path / "duet", free_body)
    rows = Catalogue(tmp_path).refresh()[0]
    assert [(row.name, row.group) for row in rows] == [("talk - person 1", "duet"), ("talk - person 2", "duet")]
    (tmp_path / "duet" / "people.json").write_text("{")
    assert "people.json" in Catalogue(tmp_path).refresh()[0][0].problem


def test_a_damaged_project_is_a_row_that_says_so(root: Path):
    (root / "a new.tcfit" / "project.sqlite").write_bytes(b"nonsense" * 1000)
    rows = by_place(Catalogue(root).refresh()[0])
    assert "is damaged" in rows["a new.tcfit"].problem and len(rows) == 4


def test_pictures_are_kept_in_the_projects(root: Path):
    catalogue = Catalogue(root)
    catalogue.refresh()
    entry = catalogue.get(catalogue.rows()[0].key)
    assert entry is not None
    made = picture_of(entry, catalogue)  # of the keypoints, for there is no video
    assert made.startswith(b"\xff\xd8") and (entry.found.path / NAME).read_bytes() == made
    (entry.found.path / NAME).write_bytes(b"kept")
    assert picture_of(entry, catalogue) == b"kept"


@pytest.mark.slow
def test_a_thousand_projects(tmp_path: Path):
    first = tmp_path / "corpus" / "c0000.tcfit"
    first.parent.mkdir()
    Project.create(first, sample_clip()).close()
    for number in range(1, 1000):
        shutil.copytree(first, tmp_path / "corpus" / f"set{number % 20}" / f"c{number:04}.tcfit")
    before, begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    catalogue = Catalogue(tmp_path / "corpus")
    assert len(catalogue.refresh()[0]) == 1000
    assert time.process_time() - begun < 10.0, "3 s on a computer that does nothing else"
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 30 << 10, "kilobytes"
