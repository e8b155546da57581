"""Fixtures for tests of the review app."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser

from fitting_core.body.model import BodyModel
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.project.project import Project
from tcfit_app.review.session.session import Session
from tests.drivers.lone_page import LonePage, lone_page
from tests.drivers.review_page import QUICK
from tests.samples.sessions import OneBody, idle, small_clip


@pytest.fixture(scope="session")
def fitted_folder(
    tiny_body: BodyModel, tmp_path_factory: pytest.TempPathFactory, panel_server: viser.ViserServer
) -> Path:
    """A project of the tiny body with one whole fit; not to be changed."""
    folder = tmp_path_factory.mktemp("fitted") / "walk.tcfit"
    with (
        Project.create(folder, small_clip(tiny_body)) as project,
        lone_page(panel_server, project, bodies=OneBody(tiny_body)) as made,
    ):
        made.fit()
    return folder


@pytest.fixture(scope="session")
def fitted_demo(demo_project: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo project with a whole fit; not to be changed."""
    folder = Path(shutil.copytree(demo_project, tmp_path_factory.mktemp("fitted") / "demo.tcfit"))
    with Project.open(folder) as project:
        session = Session(project, Bodies())
        session.fit_everything(QUICK, kind="smplx", gender="neutral")
        idle(session)
        session.close()
    return folder


@pytest.fixture
def fitted_page(
    fitted_folder: Path, tmp_path: Path, tiny_body: BodyModel, panel_server: viser.ViserServer
) -> Iterator[LonePage]:
    """A page of a copy of that project."""
    folder = Path(shutil.copytree(fitted_folder, tmp_path / "walk.tcfit"))
    with Project.open(folder) as project, lone_page(panel_server, project, bodies=OneBody(tiny_body)) as made:
        yield made
