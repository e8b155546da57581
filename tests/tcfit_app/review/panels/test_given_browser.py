"""In Chromium: what a fit starts from, whose shape it has, and the camera file."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tcfit_app.project.storage.run_record import Given, Source
from tests.drivers.lone_page import sample_project
from tests.drivers.review_page import Reviewing, reviewing, until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory, browser: "Browser") -> Iterator[Reviewing]:
    folder = tmp_path_factory.mktemp("given") / "walk.tcfit"
    sample_project(folder, "first", "second").close()
    with reviewing(folder, browser) as found:
        found.tab.wait_for_selector(".tcfit-panel button", timeout=60_000)
        yield found


def test_a_start_and_a_shape_are_chosen_and_stay_after_a_reload(opened: Reviewing, tmp_path: Path):
    state = lambda: opened.page.tab.state.settings  # noqa: E731 - the page is another one after the reload
    opened.panel("Fit")
    opened.tab.get_by_text("All settings").click()
    opened.choose("Start from", "second")
    opened.choose("Same person as", "first")
    until(lambda: state().given == Given(start=Source(run=2), shape=Source(run=1)))
    opened.tab.get_by_text("and uses the shape of first").wait_for()
    opened.choose("Same person as", "a file")
    opened.tab.get_by_text("Path of the shape is empty").wait_for()
    path = tmp_path / "her.json"
    path.write_text(json.dumps({"betas": [0.5] * 10}))
    opened.field("Path of the shape").fill(str(path))
    until(lambda: state().given.shape == Source(path=str(path)) and not state().problems)
    opened.tab.reload()
    opened.panel("Fit")
    opened.tab.get_by_text("and uses the shape of her.json").wait_for()
    assert state().given.start == Source(run=2)


def test_a_camera_file_is_read_and_its_problems_are_told(opened: Reviewing, tmp_path: Path):
    width, height = opened.session.project.clip.camera.size
    path = tmp_path / "scene.json"
    opened.panel("Fit")
    use = opened.tab.get_by_role("button", name="Use this camera")
    if not use.is_visible():
        opened.tab.get_by_text("▸ Camera").click()
    opened.field("Camera file").fill(str(path))
    use.click()
    opened.tab.get_by_text("scene.json: does not exist").wait_for()
    matrix = [[700.0, 0.0, width / 2], [0.0, 700.0, height / 2], [0.0, 0.0, 1.0]]
    path.write_text(json.dumps({"camera_matrix": matrix, "image_width": width, "image_height": height}))
    use.click()
    opened.tab.get_by_text("The project's camera: 700.0 px, camera file scene.json").wait_for()
    assert opened.session.project.clip.camera.focal == (700.0, 700.0)
