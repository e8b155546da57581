"""What a project keeps of the work on it: approval, the worst place."""

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from tcfit_app.project.glance import glance
from tcfit_app.project.project import Project
from tcfit_app.project.storage.clip_review import Worst
from tcfit_app.review.app import Keeping
from tcfit_app.review.gestures.actions import ACTIONS
from tests.drivers.lone_page import LonePage, lone_page
from tests.samples.project_samples import sample_clip
from tests.samples.sessions import OneBody
from tests.samples.waving import waving_project


@pytest.fixture
def folder(tmp_path: Path, free_body: BodyModel) -> Path:
    return waving_project(tmp_path / "walk.tcfit", free_body)


@pytest.fixture
def lone(folder: Path, panel_server: viser.ViserServer, free_body: BodyModel) -> Iterator[LonePage]:
    with Project.open(folder) as project, lone_page(panel_server, project, bodies=OneBody(free_body)) as made:
        yield made


def test_a_clip_is_approved_by_a_key_and_that_is_taken_back(lone: LonePage):
    gestures, project = lone.page.gestures, lone.page.tab.session.project
    ACTIONS["approve"].do(gestures)
    assert gestures.reviewing.approved == project.review.now.approved_by != ""
    ACTIONS["approve"].do(gestures)
    assert gestures.reviewing.approved == "" and project.review.now.approved is None


def test_what_has_no_fit_or_cannot_be_written_is_not_approved(
    folder: Path, tmp_path: Path, panel_server: viser.ViserServer, free_body: BodyModel
):
    with (
        Project.create(tmp_path / "new.tcfit", sample_clip()) as project,
        lone_page(panel_server, project, bodies=OneBody(free_body)) as lone,
        pytest.raises(InputError, match="no finished fit"),
    ):
        ACTIONS["approve"].do(lone.page.gestures)
    copied = Path(shutil.copytree(folder, tmp_path / "copy.tcfit"))
    with (
        Project.open(copied, read_only=True) as project,
        lone_page(panel_server, project, bodies=OneBody(free_body)) as lone,
        pytest.raises(InputError, match="read-only"),
    ):
        ACTIONS["approve"].do(lone.page.gestures)


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
    folder: Path, panel_server: viser.ViserServer, free_body: BodyModel
):
    for file in (folder / "runs").glob("*"):
        file.write_bytes(b"damaged")
    with Project.open(folder) as project, lone_page(panel_server, project, bodies=OneBody(free_body)) as lone:
        begun = time.monotonic()
        Keeping().keep([lone.page.tab.data], last=True)
        assert project.review.now.worst is None and time.monotonic() - begun < 4
