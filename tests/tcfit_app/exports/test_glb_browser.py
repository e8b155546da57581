"""The GLB in three.js: what it shows is the fit."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.io.motion.glb import write_glb
from fitting_core.motion import Motion
from tcfit_app.review.panels import PANELS
from tests.drivers.review_page import reviewing
from tests.drivers.three_page import ThreePage
from tests.fitting_core.io.motion.motions import meshes, swinging
from tests.samples.waving import waving_fit, waving_project

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def upright(free_body: BodyModel) -> Motion:
    return swinging(free_body).in_axes("y-up")


@pytest.fixture(scope="module")
def shown(browser: "Browser", upright: Motion, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ThreePage]:
    path = tmp_path_factory.mktemp("glb") / "swing.glb"
    write_glb(path, upright)
    page = ThreePage(browser, path)
    yield page
    assert not page.complaints


def test_three_loads_skeleton_and_animation(shown: ThreePage, upright: Motion):
    assert shown.about["bones"] == 55 and shown.about["relative"]
    assert shown.about["duration"] == pytest.approx(6 / 29.97, abs=1e-6)


@pytest.mark.parametrize("frame", [0, 2, 5])
def test_three_poses_the_fit_s_mesh(shown: ThreePage, upright: Motion, frame: int):
    off = np.linalg.norm(shown.vertices(frame / upright.frame_rate) - meshes(upright)[frame], axis=1)
    assert off.max() < 1e-3


def test_it_is_drawn_where_the_video_has_it(shown: ThreePage, upright: Motion):
    """The file's camera, at frames that differ; the principal point is the image's middle, which glTF assumes."""
    pictures = {}
    for frame in (1, 5):
        image = cv2.imdecode(np.frombuffer(shown.picture(frame / upright.frame_rate), np.uint8), cv2.IMREAD_COLOR)
        body = np.argwhere(abs(image.astype(int) - image[240, 2]).max(-1) > 12)
        mesh = meshes(upright)[frame]
        rows = 240 - 910.0 * mesh[:, 1] / -mesh[:, 2]
        inside = np.clip([rows.min(), rows.max()], 0, 479)
        assert np.allclose([body[:, 0].min(), body[:, 0].max()], inside, atol=2)
        pictures[frame] = image.astype(int)
    assert abs(pictures[1] - pictures[5]).max(-1).mean() > 1


def test_the_app_s_download_opens(browser: "Browser", free_body: BodyModel, tmp_path: Path):
    folder = waving_project(tmp_path / "walk.tcfit", free_body)
    with reviewing(folder, browser) as review:
        review.tab.get_by_role("tab").nth([panel.title for panel in PANELS].index("Export")).click()
        with review.tab.expect_download(timeout=60_000) as download:
            review.tab.locator("[data-tcfit='export.begin'][data-value=glb]").first.click()
        assert download.value.suggested_filename == "walk.glb"
        download.value.save_as(tmp_path / "got.glb")
        review.tab.get_by_text("downloaded").wait_for()
        assert not review.complaints
    page = ThreePage(browser, tmp_path / "got.glb")
    expected = Mesh(free_body)(waving_fit(2.0).last.params[3:4])[0].numpy() * (1, -1, -1)
    assert np.linalg.norm(page.vertices(3 / 29.97) - expected, axis=1).max() < 1e-3
