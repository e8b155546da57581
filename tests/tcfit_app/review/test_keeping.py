"""What a project keeps of the work on it: approval, the worst place."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from tcfit_app.project.glance import glance
from tcfit_app.project.project import Project
from tcfit_app.project.storage.clip_review import Worst
from tcfit_app.review.app import Keeping
from tcfit_app.review.gestures.actions import ACTIONS
from tests.drivers.lone_page import LonePage
from tests.samples.project_samples import sample_clip
from tests.samples.sessions import OneBody
from tests.samples.waving import waving_project


@pytest.fixture
def folder(tmp_path: Path, free_body: BodyModel) -> Path:
    return waving_project(tmp_path / "walk.tcfit", free_body)


@pytest.fixture
def lone(folder: Path, page_of: Callable[..., LonePage], free_body: BodyModel) -> LonePage:
    return page_of(folder, bodies=OneBody(free_body))


def test_a_clip_is_approved_by_a_key_and_that_is_taken_back(lone: LonePage):
    gestures, project = lone.page.gestures, lone.page.tab.session.project
    ACTIONS["approve"].do(gestures)
    assert gestures.reviewing.approved == project.review.now.approved_by != ""
    ACTIONS["approve"].do(gestures)
    assert gestures.reviewing.approved == "" and project.review.now.approved is None


def test_what_has_no_fit_or_cannot_be_written_is_not_approved(
    folder: Path, tmp_path: Path, page_of: Callable[..., LonePage], free_body: BodyModel
):
    new = Project.create(tmp_path / "new.tcfit", sample_clip())
    for project, said in ((new, "no finished fit"), (Project.open(folder, read_only=True), "read-only")):
        with pytest.raises(InputError, match=said):
            ACTIONS["approve"].do(page_of(project, bodies=OneBody(free_body)).page.gestures)


def test_there_is_no_other_clip_where_one_was_opened(lone: LonePage):
    for name in ("next_clip", "previous_clip", "list"):
        assert "tcfit review FOLDER" in ACTIONS[name].obstacle(lone.page.gestures)


def test_the_worst_place_of_the_newest_run_is_kept(lone: LonePage, folder: Path):
    Keeping().keep([lone.page.tab.data], last=True)
    lone.until(lambda: lone.page.gestures.reviewing.suspects is not None)
    found = lone.page.gestures.reviewing.suspects
    assert found is not None
    worst = lone.page.tab.session.project.review.now.worst
    assert worst is not None and worst == Worst(
        run=2,
        left=len(found),
        score=round(found[0].score, 2) if found else 0.0,
        frame=found[0].frame if found else 0,
        words=found[0].reason if found else "",
        off=worst.off,
    )
    assert worst.off["body"] >= 0 and worst.off == glance(folder).off


def test_a_fit_that_cannot_be_read_has_no_worst_place(
    folder: Path, page_of: Callable[..., LonePage], free_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("tcfit_app.review.app._PATIENCE", math.inf)  # it is not waited for
    for file in (folder / "runs").glob("*"):
        file.write_bytes(b"damaged")
    data = page_of(folder, bodies=OneBody(free_body)).page.tab.data
    Keeping().keep([data], last=True)
    assert data.session.project.review.now.worst is None
