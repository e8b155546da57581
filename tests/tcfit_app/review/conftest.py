"""Fixtures for tests of the review app."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from fitting_core.body.model import BodyModel
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.project.project import Project
from tcfit_app.review.browser.page_events import Hello
from tcfit_app.review.session.session import Session
from tests.drivers.lone_page import LonePage, sample_project
from tests.drivers.review_page import QUICK
from tests.samples.sessions import OneBody, idle


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
def fitted_page(fitted_walk: Path, tmp_path: Path, tiny_body: BodyModel, page_of: Callable[..., LonePage]) -> LonePage:
    """A page of a copy of the project with a fit."""
    return page_of(Path(shutil.copytree(fitted_walk, tmp_path / "walk.tcfit")), bodies=OneBody(tiny_body))


@pytest.fixture
def sample_page(page_of: Callable[..., LonePage], tmp_path: Path) -> LonePage:
    """A page of a sample project with one run."""
    return page_of(sample_project(tmp_path / "walk.tcfit", "first"))


@pytest.fixture
def tested(fitted_page: LonePage) -> LonePage:
    """A page of a project of the tiny body, with a fit and no panels, that has told its size."""
    fitted_page.only()
    fitted_page.page.receive(Hello("me", 1000, 700))
    return fitted_page
