"""Fixtures for tests of the review app."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser

from fitting_core.body.model import BodyModel
from tcfit_app.project.project import Project
from tests.drivers.lone_page import LonePage, lone_page
from tests.samples.sessions import OneBody, small_clip


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


@pytest.fixture
def fitted_page(
    fitted_folder: Path, tmp_path: Path, tiny_body: BodyModel, panel_server: viser.ViserServer
) -> Iterator[LonePage]:
    """A page of a copy of that project."""
    folder = Path(shutil.copytree(fitted_folder, tmp_path / "walk.tcfit"))
    with Project.open(folder) as project, lone_page(panel_server, project, bodies=OneBody(tiny_body)) as made:
        yield made
